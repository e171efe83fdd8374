"""The compiled pass over all lanes: exact between contact events, events located inside an interval.

The first n rows of exp(N·h) carry states and inputs z over a whole interval (``driven_exponential``). Where a contact
state changes within it, the Taylor series of z gives the time of the event, and the rest of the interval is done in the
new contact state (``driven_contact``).
"""

from __future__ import annotations

import numpy as np

from service.dynamics.compiled import compiled, lean, within
from service.dynamics.driven_contact import (
    contact_modes,
    entries,
    mode_number,
    same,
    through_piece,
)
from service.dynamics.driven_exponential import (
    REACH,
    J,
    doubled,
    exponential,
    rate_matrix,
    rate_of,
    terms,
)
from service.recording import FloatArray

HOPELESS = 1e4
"""Time constants per interval from which on a parameter set is no machine; its states are NaN."""

KNOWN = 32
"""Contact states whose exponentials are kept; when there are more, they are found again."""


@within
def product(E, which, z, n, out):
    """The states a time later, into out."""
    for i in range(n):
        total = 0.0
        for w in range(len(z)):
            total += E[which, i, w] * z[w]
        out[i] = total


@within
def later_inputs(z, n, Q, X, dt, out):
    """The inputs a time dt later, into out."""
    for x in range(X):
        for j in range(J - 1):
            total = z[n + x * J + J - 1]
            for i in range(J - 2, j - 1, -1):
                total = total * dt / (i - j + 1) + z[n + x * J + i]
            out[n + x * J + j] = total
        out[n + x * J + J - 1] = z[n + x * J + J - 1]
    values = len(z) - 2 * Q
    for q in range(Q):
        out[values + q] = z[values + q] + dt * z[values + Q + q]
        out[values + Q + q] = z[values + Q + q]


@within
def curve_value(curves, q, z):
    """A curve at the present state, straight between its points, held beyond its ends."""
    place, many, size, range_of, table = curves
    value = 0.0
    for m in range(many[q, 0]):
        value += size[q, 0, m] * z[place[q, 0, m]]
    at = (value - range_of[q, 0]) / range_of[q, 1]
    last = table.shape[1] - 1
    if not at > 0.0:
        return table[q, 0]
    if at >= last:
        return table[q, last]
    i = int(at)
    return table[q, i] + (at - i) * (table[q, i + 1] - table[q, i])


@compiled
def alike(first, second):
    """Whether two arrays are the same."""
    a, b = first.ravel(), second.ravel()
    for i in range(len(a)):
        if a[i] != b[i]:
            return False
    return True


@lean
def sees_inputs(place, many, n, constants, values):
    """Whether any of the forms (G, 2, M) has an entry of an input that changes."""
    for g in range(many.shape[0]):
        for side in range(2):
            for m in range(many[g, side]):
                w = place[g, side, m]
                if n <= w < constants or w >= values:
                    return True
    return False


@compiled
def forced_forms(A, approach, law, Q, X):
    """Every flank's force over k as a linear form (G, 2, W): δ + d/k·δ̇."""
    n, forced, rate = A.shape[0], approach.copy(), np.zeros(approach.shape[2])
    for g in range(approach.shape[0]):
        if law[g, 1] != 0.0:
            for side in range(2):
                rate_of(approach[g, side], A, n, Q, X, rate)
                for w in range(len(rate)):
                    forced[g, side, w] += law[g, 1] / law[g, 0] * rate[w]
    return forced


@compiled
def slot_of(machine, modes, sizes, pace, store):
    """Where the exponentials of a contact state are kept; they are found if they are not there yet."""
    A, B, push, law, forced = machine
    n, Q, X, order = sizes
    dt, halvings = pace
    slots, count, part, whole = store
    number = mode_number(modes)
    if slots[number] < 0:
        if count[0] == len(part):
            slots[:] = -1
            count[0] = 0
        slot = count[0]
        N = np.zeros((n, part.shape[2]))
        rate_matrix(A, B, push, law, forced, modes, N)
        exponential(N, n, Q, X, dt, order, part[slot])
        whole[slot] = part[slot]
        doubled(whole[slot], n, Q, X, dt, halvings)
        slots[number] = slot
        count[0] += 1
    return slots[number]


@compiled
def new_store(G, n, W):
    """An empty store of exponentials: slot of every contact state, how many, over a piece, over a whole interval."""
    room = min(3**G, KNOWN)
    slots, count = np.full(3**G, -1, dtype=np.int64), np.zeros(1, dtype=np.int64)
    return slots, count, np.zeros((room, n, W)), np.zeros((room, n, W))


@compiled
def propagate(
    A: FloatArray,
    B: FloatArray,
    approach: FloatArray,
    push: FloatArray,
    law: FloatArray,
    curves: tuple[FloatArray, FloatArray, FloatArray],
    x0: FloatArray,
    c: FloatArray,
    constants: FloatArray,
    h: float,
    fastest: FloatArray,
) -> FloatArray:
    """States (S, T, K + 1, n) of all lanes; arguments as in driven_propagation.run, law (S, G, 2) being k and d, and
    curves their linear forms (S, Q, n + U), first point and spacing (S, Q, 2) and tables (S, Q, P).

    Sets that differ from the first in their initial states or inputs only have its exponentials.
    """
    S, T, K = c.shape[:3]
    n, U = B.shape[1], B.shape[2]
    out = np.empty((S, T, K + 1, n))
    of_first, of_other = new_store(push.shape[1], n, n + U), new_store(push.shape[1], n, n + U)
    for s in range(S):
        store = of_first
        if s > 0 and not (
            alike(A[s], A[0])
            and alike(B[s], B[0])
            and alike(approach[s], approach[0])
            and alike(push[s], push[0])
            and alike(law[s], law[0])
        ):
            store = of_other
            store[0][:] = -1
            store[1][0] = 0
        if fastest[s] * h < HOPELESS:
            machine = (A[s], B[s], approach[s], push[s], law[s])
            one_machine(
                machine,
                (curves[0][s], curves[1][s], curves[2][s]),
                (x0[s], c[s], constants),
                (h, fastest[s]),
                store,
                out[s],
            )
        else:
            out[s] = np.nan
    return out


@compiled
def one_machine(given, tables, motion, pace, store, out):
    """All steps of one parameter set, into out (T, K + 1, n)."""
    A, B, approach, push, law = given
    of, range_of, table = tables
    x0, c, constants = motion
    h, fastest = pace
    T, K = c.shape[:2]
    n, U = B.shape
    G, Q, X = approach.shape[0], of.shape[0], c.shape[2] // J
    moving, values, slopes = n + X * J, n + U - 2 * Q, n + U - Q
    halvings = 0
    while fastest * h > REACH * 2.0**halvings:
        halvings += 1
    pieces = 2**halvings
    dt = h / pieces
    order = terms(fastest * dt)
    forced = forced_forms(A, approach, law, Q, X)
    machine, sizes, pieced = (A, B, push, law, forced), (n, Q, X, order), (dt, halvings)
    flanks = entries(approach, forced)
    bent = np.zeros((Q, 2, n + U))
    bent[:, 0] = of
    bent_place, bent_many, bent_size, _ = entries(bent, bent)
    curves = (bent_place, bent_many, bent_size, range_of, table)
    watched = sees_inputs(flanks[0], flanks[1], n, moving, values) or sees_inputs(
        bent_place, bent_many, n, moving, values
    )
    modes, end = np.zeros(G, dtype=np.int64), np.zeros(G, dtype=np.int64)
    z, new = np.zeros(n + U), np.zeros(n + U)
    course = np.zeros((order + 1, 2))
    scratch = (np.zeros((n, n + U)), np.zeros((order + 1, n + U)), course, np.zeros(G, dtype=np.int64))
    whole, part = store[3], store[2]
    for t in range(T):
        z[:n] = x0[t]
        z[n:moving] = c[t, 0]
        z[moving:values] = constants[t]
        new[moving:values] = constants[t]
        out[t, 0] = x0[t]
        contact_modes(flanks, z, modes)
        slot = slot_of(machine, modes, sizes, pieced, store)
        for k in range(K):
            for w in range(moving - n):
                z[n + w] = c[t, k, w]
            for q in range(Q):
                z[values + q] = curve_value(curves, q, z)
                z[slopes + q] = 0.0
            product(whole, slot, z, n, new)
            if watched:
                later_inputs(z, n, Q, X, h, new)
            for q in range(Q):
                z[slopes + q] = (curve_value(curves, q, new) - z[values + q]) / h
            for q in range(Q):
                for i in range(n):
                    new[i] += whole[slot, i, slopes + q] * z[slopes + q]
            contact_modes(flanks, new, end)
            if not same(modes, end):
                new[:] = z
                for _ in range(pieces):
                    product(part, slot, new, n, z)
                    later_inputs(new, n, Q, X, dt, z)
                    contact_modes(flanks, z, end)
                    if same(modes, end):
                        new[:] = z
                    else:
                        through_piece(machine, flanks, sizes, new, modes, dt, scratch)
                        slot = slot_of(machine, modes, sizes, pieced, store)
            for i in range(n):
                z[i] = new[i]
                out[t, k + 1, i] = new[i]
