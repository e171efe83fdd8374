"""The compiled pass over all lanes: exact between contact events, events located inside an interval.

The first n rows of exp(N·h) carry states and inputs z over a whole interval (``driven_exponential``). Where a contact
state changes within it, halves are looked at down to the piece in which it does; there the Taylor series of z gives the
time of the event, and the rest is done in the new contact state (``driven_contact``), in halves that grow again.
Nothing is allocated here: all room comes from ``driven_propagation``.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from service.dynamics.compiled import lean, once, within
from service.dynamics.driven_contact import (
    contact_modes,
    crossing,
    lesser,
    parted,
    polynomials_of,
    same,
)
from service.dynamics.driven_exponential import (
    J,
    halvings,
    later_inputs,
    series,
    state_at,
    terms,
)
from service.dynamics.driven_store import emptied, make, slot_of
from service.recording import FloatArray

Arrays = tuple[NDArray[Any], ...]

HOPELESS = 100.0
"""Time constants per interval from which on a parameter set is no machine; its states are NaN. Stiff pinions have 10 to
20."""

EVENTS = 8
"""Contact events within one piece of an interval; more is chatter below the sensor's noise."""


@within
def product(E, slot, level, z, n, out):
    """The states a time later, into out."""
    for i in range(n):
        total = 0.0
        for w in range(len(z)):
            total += E[slot, level, i, w] * z[w]
        out[i] = total


@within
def curve_value(curves, q, z):
    """A curve at the present state, straight between its points, held beyond its ends."""
    place, many, size, extent, table = curves
    value = 0.0
    for m in range(many[q]):
        value += size[q, m] * z[place[q, m]]
    at = (value - extent[q, 0]) / extent[q, 1]
    last = table.shape[1] - 1
    if not at > 0.0:
        return table[q, 0]
    if at >= last:
        return table[q, last]
    i = int(at)
    return table[q, i] + (at - i) * (table[q, i + 1] - table[q, i])


@lean
def unlike(arrays, s, other):
    """Whether two sets have different machines."""
    A, B, push, law, forced = arrays
    n, G, W = A.shape[1], push.shape[1], forced.shape[3]
    differs = False
    for i in range(n):
        for w in range(n):
            differs = differs or A[s, i, w] != A[other, i, w]
        for w in range(W - n):
            differs = differs or B[s, i, w] != B[other, i, w]
    for g in range(G):
        differs = differs or law[s, g, 0] != law[other, g, 0] or law[s, g, 1] != law[other, g, 1]
        for side in range(2):
            for i in range(n):
                differs = differs or push[s, g, side, i] != push[other, g, side, i]
            for w in range(W):
                differs = differs or forced[s, g, side, w] != forced[other, g, side, w]
    return differs


@lean
def propagate(
    machines: Arrays,
    flanks: Arrays,
    curves: Arrays,
    motion: Arrays,
    h: float,
    fastest: FloatArray,
    stores: tuple[Arrays, Arrays],
    scratch: tuple[Arrays, Arrays, Arrays, bool],
    out: FloatArray,
) -> None:
    """States of all lanes into out (S, T, K + 1, n).

    Sets that differ from the first, or from the one before, in their initial states or inputs only have its
    exponentials.

    Parameters
    ----------
    machines : A (S, n, n), B (S, n, U), push (S, G, 2, n), law (S, G, 2) being k and d, and the forms of the flanks'
        forces over k (S, G, 2, W)
    flanks : entries of the forms of approach and force: place and many of all sets, both forms' (S, 2·G, M); the gap
        of which each one is a piece (G,), the next deeper piece (G,), its depth (S, G)
    curves : entries of their forms: place (Q, M) and many (Q,) of all sets, sizes (S, Q, M); first point and spacing
        (S, Q, 2) and tables (S, Q, P)
    motion : x0 (S, T, n), c (S, T, K, X·J), constants (T, C)
    h, fastest : interval [s], bound of each set's fastest rate (S,) [1/s]
    stores : of the first set's and of another's exponentials: the listed contact states' numbers (-1: free place) and
        slots, how many, and by slot the highest level that is made, the rate matrix, and by level the exponentials
        over a piece and its doublings
    scratch : of one_machine, of the exponentials, of events, and whether a form sees an input that changes
    """
    place, many, delta, force, first, deeper, depth = flanks
    bent_place, bent_many, bent_size, extent, table = curves
    for s in range(len(out)):
        store = stores[0]
        if unlike(machines, s, 0):
            store = stores[1]
            if unlike(machines, s, s - 1):
                emptied(store)
        if fastest[s] * h < HOPELESS:
            one_machine(
                (machines[0][s], machines[1][s], machines[2][s], machines[3][s], machines[4][s]),
                (place, many, delta[s], force[s], first, deeper, depth[s]),
                (bent_place, bent_many, bent_size[s], extent[s], table[s]),
                (motion[0][s], motion[1][s], motion[2]),
                (h, fastest[s]),
                store,
                scratch,
                out[s],
            )
        else:
            out[s] = float("nan")


@once
def one_machine(machine, flanks, curves, motion, pace, store, scratch, out):
    """All steps of one parameter set, into out (T, K + 1, n)."""
    x0, c, constants = motion
    h, fastest = pace
    vectors, _, _, watched = scratch
    z, new = vectors[0], vectors[1]
    n, Q, X = x0.shape[1], curves[3].shape[0], c.shape[2] // J
    times = halvings(fastest * h)
    dt = h / (1 << times)
    sizes = (n, Q, X, terms(fastest * dt))
    for t in range(len(c)):
        for i in range(n):
            z[i] = out[t, 0, i] = x0[t, i]
        for w in range(X * J):
            z[n + w] = c[t, 0, w]
        for w in range(constants.shape[1]):
            z[n + X * J + w] = new[n + X * J + w] = constants[t, w]
        one_step(machine, flanks, curves, sizes, (h, dt, times, watched), store, scratch, c[t], out[t])


@once
def one_step(machine, flanks, curves, sizes, pace, store, scratch, c, out):
    """All intervals of one step from the states in the first of the vectors on, into out (K + 1, n)."""
    n, Q, X, _ = sizes
    h, dt, times, watched = pace
    (z, new, modes, end), rooms, _, _ = scratch
    made, powers = store[3], store[5]
    values, slopes = len(z) - 2 * Q, len(z) - Q
    contact_modes(flanks, z, modes)
    slot = slot_of(machine, modes, store)
    for k in range(len(c)):
        if made[slot] < times:
            make(slot, times, sizes, dt, store, rooms)
        for w in range(X * J):
            z[n + w] = c[k, w]
        for q in range(Q):
            z[values + q] = curve_value(curves, q, z)
            z[slopes + q] = 0.0
        product(powers, slot, times, z, n, new)
        if watched:
            later_inputs(z, n, Q, X, h, new)
        for q in range(Q):
            z[slopes + q] = (curve_value(curves, q, new) - z[values + q]) / h
        for q in range(Q):
            for i in range(n):
                new[i] += powers[slot, times, i, slopes + q] * z[slopes + q]
        contact_modes(flanks, new, end)
        if not same(modes, end):
            slot = through_interval(machine, flanks, sizes, pace, slot, store, scratch)
        for i in range(n):
            z[i] = out[k + 1, i] = new[i]


@once
def through_interval(machine, flanks, sizes, pace, slot, store, scratch):
    """From the beginning of an interval, z, to its end, into new, where the contact state at its end is another one;
    the new one's exponentials. Blocks of pieces at whose end it is not are passed in one, others halved."""
    n, Q, X, _ = sizes
    _, dt, times, _ = pace
    (z, new, modes, end), rooms, _, _ = scratch
    made, powers = store[3], store[5]
    copied(z, new)
    at, level, changes = 0, times, True
    while at < 1 << times:
        if changes and level == 0:
            slot = through_piece(machine, flanks, sizes, pace, slot, store, scratch)
            at, changes = at + 1, False
            continue
        if changes:
            level -= 1
        else:
            level = 0
            while at % (2 << level) == 0:
                level += 1
        if made[slot] < level:
            make(slot, level, sizes, dt, store, rooms)
        product(powers, slot, level, new, n, z)
        later_inputs(new, n, Q, X, dt * (1 << level), z)
        contact_modes(flanks, z, end)
        if same(modes, end):
            copied(z, new)
            at += 1 << level
        else:
            changes = True
    return slot


@within
def copied(vector, into):
    """A copy of a vector."""
    for w in range(len(vector)):
        into[w] = vector[w]


@once
def through_piece(machine, flanks, sizes, pace, slot, store, scratch):
    """Over one piece of an interval, from new on and into it, through the contact events in it; the exponentials of
    the contact state at its end."""
    n, Q, X, order = sizes
    (_, z, modes, end), _, (D, course), _ = scratch
    left, rates = pace[1], store[4]
    for event in range(EVENTS + 1):
        many = series(rates[slot], z, n, Q, X, left, order, D)
        state_at(D, many, n, Q, X, left, z)
        contact_modes(flanks, z, end)
        if event == EVENTS or same(modes, end):
            break
        g, t = first_event(flanks, modes, end, D, many, left, course)
        state_at(D, many, n, Q, X, t, z)
        modes[g] = 1 if modes[g] != 1 else end[g]
        if modes[g] == 1:
            parted(flanks[5], g, modes)
        slot = slot_of(machine, modes, store)
        left -= t
        if left <= 0.0:
            break
    return slot


@within
def first_event(flanks, modes, end, D, many, left, course):
    """The gap whose contact state changes first along a series at whose end it is another one, and when."""
    first, at = left, -1
    for g in range(len(modes)):
        if end[g] == modes[g]:
            continue
        side = modes[g] // 2 if modes[g] != 1 else end[g] // 2
        polynomials_of(flanks, modes, g, side, D, many, course)
        touched = lesser(course, many, 0.0) > 0.0
        t = crossing(course, many, left) if touched == (modes[g] != 1) else 0.0
        if at < 0 or t < first:
            first, at = t, g
    return at, first
