"""The compiled pass over all lanes: exact between contact events, events located inside an interval.

States and inputs together are one vector z whose rate is linear in it, ż = N·z, in every contact state: the motor's
motion is a polynomial (each derivative's rate is the next), constants stay, forces given as curves change at a
constant rate within an interval. The first n rows of exp(N·h) carry the state over a whole interval. Where a
contact state changes within it, the Taylor series of z gives the time of the event, and the rest of the interval is
done in the new contact state. Contact states of a gap: 0 lower flank, 1 in the gap, 2 upper flank.
"""

from __future__ import annotations

import numpy as np

from service.dynamics.compiled import compiled
from service.recording import FloatArray

ORDER = 36
"""Terms of a Taylor series over at most REACH time constants: 4^37/37! is 1e-21."""

REACH = 4.0

HOPELESS = 1e4
"""Time constants per interval from which on a parameter set is no machine; its states are NaN."""

EVENTS = 8
"""Contact events within one piece of an interval; more is chatter below the sensor's noise."""

J = 5


@compiled
def rate_matrix(A, B, approach, push, law, modes, Q, X):
    """N's first n rows: A, B and the flanks in contact."""
    n, U = B.shape
    N = np.zeros((n, n + U))
    N[:, :n] = A
    N[:, n:] = B
    for g in range(approach.shape[0]):
        if modes[g] == 1:
            continue
        side = 0 if modes[g] == 0 else 1
        row = force_row(A, approach[g, side], law[g], n, Q, X)
        for i in range(n):
            if push[g, side, i] != 0.0:
                N[i] += push[g, side, i] * row
    return N


@compiled
def rate_of(row, A, n, Q, X):
    """The rate of a linear form of positions, as a linear form."""
    out = np.zeros_like(row)
    U = len(row) - n
    for i in range(n):
        if row[i] != 0.0:
            out[:n] += row[i] * A[i]
    for x in range(X):
        for j in range(J - 1):
            out[n + x * J + j + 1] += row[n + x * J + j]
    for q in range(Q):
        out[n + U - Q + q] += row[n + U - 2 * Q + q]
    return out


@compiled
def force_row(A, row, law, n, Q, X):
    """k·δ + d·δ̇ of a flank as a linear form; without a damper δ may be a form of speeds too."""
    if law[1] == 0.0:
        return law[0] * row
    return law[0] * row + law[1] * rate_of(row, A, n, Q, X)


@compiled
def inputs_rate(z, n, Q, X, out):
    """The rates of z's inputs, which no state drives, into out[n:]."""
    U = len(z) - n
    out[n:] = 0.0
    for x in range(X):
        for j in range(J - 1):
            out[n + x * J + j] = z[n + x * J + j + 1]
    for q in range(Q):
        out[n + U - 2 * Q + q] = z[n + U - Q + q]


@compiled
def terms(reach):
    """How many terms a series over `reach` time constants needs, at most ORDER."""
    size, order = 1.0, 0
    while size > 1e-15 and order < ORDER:
        order += 1
        size *= reach / order
    return max(order, J + 1)


@compiled
def shifted_inputs(B, n, Q, X):
    """B times the inputs' own rate matrix, in place: each input's column moves on to the input that drives it."""
    U = B.shape[1]
    for i in range(n):
        for x in range(X):
            for j in range(J - 1, 0, -1):
                B[i, x * J + j] = B[i, x * J + j - 1]
            B[i, x * J] = 0.0
        for k in range(X * J, U - 2 * Q):
            B[i, k] = 0.0
        for q in range(Q):
            B[i, U - Q + q] = B[i, U - 2 * Q + q]
            B[i, U - 2 * Q + q] = 0.0


@compiled
def exponential(N, n, Q, X, dt, order):
    """First n rows of exp(N·dt) by its series; positions' rates are the speeds that follow them."""
    W = N.shape[1]
    E, term, new = np.zeros((n, W)), np.zeros((n, W)), np.zeros((n, W))
    for i in range(n):
        term[i, i] = 1.0
        E[i, i] = 1.0
    drive, size = N[:, n:].copy(), 1.0
    for k in range(1, order + 1):
        for i in range(0, n, 2):
            new[i] = term[i + 1]
            new[i + 1] = 0.0
            for r in range(n):
                if N[i + 1, r] != 0.0:
                    for w in range(W):
                        new[i + 1, w] += N[i + 1, r] * term[r, w]
        if k <= J + 1:
            for i in range(n):
                for w in range(W - n):
                    new[i, n + w] += drive[i, w] * size
            shifted_inputs(drive, n, Q, X)
            size *= dt / k
        for i in range(n):
            for w in range(W):
                term[i, w] = new[i, w] * (dt / k)
                E[i, w] += term[i, w]
    return E


@compiled
def doubled(E, n, Q, X, dt, times):
    """Rows of exp(N·dt·2^times) from those of exp(N·dt)."""
    E = E.copy()
    U = E.shape[1] - n
    low = np.eye(U)
    for x in range(X):
        for j in range(J):
            size = 1.0
            for i in range(j + 1, J):
                size *= dt / (i - j)
                low[x * J + j, x * J + i] = size
    for q in range(Q):
        low[U - 2 * Q + q, U - Q + q] = dt
    for _ in range(times):
        Ex, Eu = np.ascontiguousarray(E[:, :n]), np.ascontiguousarray(E[:, n:])
        E[:, :n] = Ex @ Ex
        E[:, n:] = Ex @ Eu + Eu @ low
        low = low @ low
    return E


@compiled
def form(row, z):
    """A linear form of z; short ones are summed faster here than by a library call."""
    total = 0.0
    for w in range(len(z)):
        total += row[w] * z[w]
    return total


@compiled
def curve_value(of, place, table, z):
    """A curve at the present state, straight between its points, held beyond its ends."""
    at = (form(of, z) - place[0]) / place[1]
    last = len(table) - 1
    if not at > 0.0:
        return table[0]
    if at >= last:
        return table[last]
    i = int(at)
    return table[i] + (at - i) * (table[i + 1] - table[i])


@compiled
def pressed(approach, rates, z):
    """What is positive while a flank touches and pushes: the lesser of its approach and of its force over k."""
    delta = form(approach, z)
    return min(delta, delta + form(rates, z))


@compiled
def contact_modes(approach, rates, z, out):
    """Contact states of all gaps into out."""
    for g in range(len(out)):
        if pressed(approach[g, 1], rates[g, 1], z) > 0.0:
            out[g] = 2
        elif pressed(approach[g, 0], rates[g, 0], z) > 0.0:
            out[g] = 0
        else:
            out[g] = 1


@compiled
def mode_number(modes):
    """Contact states of all gaps as one number."""
    number = 0
    for g in range(len(modes) - 1, -1, -1):
        number = 3 * number + modes[g]
    return number


@compiled
def series(N, z, n, Q, X, order):
    """Taylor coefficients of z: (order + 1, n + U)."""
    W = len(z)
    D = np.zeros((order + 1, W))
    D[0] = z
    for i in range(order):
        inputs_rate(D[i], n, Q, X, D[i + 1])
        for r in range(0, n, 2):
            D[i + 1, r] = D[i, r + 1]
            total = 0.0
            for w in range(W if i <= J else n):
                total += N[r + 1, w] * D[i, w]
            D[i + 1, r + 1] = total
        for w in range(W if i <= J else n):
            D[i + 1, w] /= i + 1
    return D


@compiled
def value_at(coefficients, t):
    """Horner's rule for one polynomial."""
    total = coefficients[-1]
    for i in range(len(coefficients) - 2, -1, -1):
        total = total * t + coefficients[i]
    return total


@compiled
def state_at(D, t, z):
    """Horner's rule for the whole of z, into z."""
    z[:] = D[-1]
    for i in range(len(D) - 2, -1, -1):
        z *= t
        z += D[i]


@compiled
def lesser(delta, force, t):
    """`pressed` from the polynomials of approach and force."""
    return min(value_at(delta, t), value_at(force, t))


@compiled
def crossing(delta, force, left):
    """First time in [0, left] at which `pressed` changes its sign: quarters, then regula falsi and halving."""
    begin = lesser(delta, force, 0.0)
    a, fa = 0.0, begin
    b, fb = left, begin
    for quarter in range(1, 5):
        b = left * quarter / 4.0
        fb = lesser(delta, force, b)
        if (fb > 0.0) != (begin > 0.0):
            break
        a, fa = b, fb
    if (fb > 0.0) == (begin > 0.0):
        return left
    for trial in range(60):
        t = b - fb * (b - a) / (fb - fa) if trial % 3 < 2 else 0.5 * (a + b)
        if not a < t < b:
            t = 0.5 * (a + b)
        f = lesser(delta, force, t)
        if (f > 0.0) == (fb > 0.0):
            b, fb = t, f
            fa *= 0.5
        else:
            a, fa = t, f
            fb *= 0.5
        if b - a <= 1e-10 * left:
            break
    return b


@compiled
def carried(E, z, n, Q, X, dt, out):
    """z a time dt later, in one contact state whose exp(N·dt) has the first n rows E, into out."""
    for i in range(n):
        out[i] = form(E[i], z)
    out[n:] = z[n:]
    for x in range(X):
        for j in range(J - 1):
            total = z[n + x * J + J - 1]
            for i in range(J - 2, j - 1, -1):
                total = total * dt / (i - j + 1) + z[n + x * J + i]
            out[n + x * J + j] = total
    U = len(z) - n
    for q in range(Q):
        out[n + U - 2 * Q + q] += dt * z[n + U - Q + q]


@compiled
def through_piece(A, B, approach, rates, push, law, z, modes, left, Q, X, order):
    """Carry z over a piece of an interval through the contact events in it; z and modes change in place."""
    n = A.shape[0]
    end = modes.copy()
    for _ in range(EVENTS):
        N = rate_matrix(A, B, approach, push, law, modes, Q, X)
        D = series(N, z, n, Q, X, order)
        state_at(D, left, z)
        contact_modes(approach, rates, z, end)
        first, at = left, -1
        for g in range(len(modes)):
            if end[g] == modes[g]:
                continue
            side = modes[g] // 2 if modes[g] != 1 else end[g] // 2
            delta = D @ approach[g, side]
            force = delta + D @ rates[g, side]
            touching = lesser(delta, force, 0.0) > 0.0
            t = crossing(delta, force, left) if touching == (modes[g] != 1) else 0.0
            if at < 0 or t < first:
                first, at = t, g
        if at < 0:
            return
        state_at(D, first, z)
        modes[at] = 1 if modes[at] != 1 else end[at]
        left -= first
        if left <= 0.0:
            return
    N = rate_matrix(A, B, approach, push, law, modes, Q, X)
    state_at(series(N, z, n, Q, X, order), left, z)


@compiled
def same(first, second):
    """Whether all contact states are the same."""
    return bool(np.all(first == second))


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
    curves their linear forms (S, Q, n + U), first point and spacing (S, Q, 2) and tables (S, Q, P)."""
    S, T, K = c.shape[:3]
    n = A.shape[1]
    out = np.empty((S, T, K + 1, n))
    for s in range(S):
        if fastest[s] * h < HOPELESS:
            machine = (A[s], B[s], approach[s], push[s], law[s])
            one_machine(
                machine,
                (curves[0][s], curves[1][s], curves[2][s]),
                (x0[s], c[s], constants),
                h,
                fastest[s],
                out[s],
            )
        else:
            out[s] = np.nan
    return out


@compiled
def learn(machine, modes, number, part, whole, pace, Q, X):
    """The exponentials of one contact state over a piece and over a whole interval, into the stores."""
    A, B, approach, push, law = machine
    dt, halvings, order = pace
    N = rate_matrix(A, B, approach, push, law, modes, Q, X)
    part[number] = exponential(N, A.shape[0], Q, X, dt, order)
    whole[number] = doubled(part[number], A.shape[0], Q, X, dt, halvings)


@compiled
def one_machine(machine, curves, motion, h, fastest, out):
    """All steps of one parameter set, into out (T, K + 1, n)."""
    A, B, approach, push, law = machine
    of, place, table = curves
    x0, c, constants = motion
    T, K = c.shape[:2]
    n, U = B.shape
    G, Q, X = approach.shape[0], of.shape[0], c.shape[2] // J
    values, slopes = n + U - 2 * Q, n + U - Q
    halvings = 0
    while fastest * h > REACH * 2.0**halvings:
        halvings += 1
    pieces = 2**halvings
    dt = h / pieces
    order = terms(fastest * dt)
    rates = np.zeros((G, 2, n + U))
    for g in range(G):
        for side in range(2):
            if law[g, 1] != 0.0:
                rates[g, side] = law[g, 1] / law[g, 0] * rate_of(approach[g, side], A, n, Q, X)
    whole, part = np.zeros((3**G, n, n + U)), np.zeros((3**G, n, n + U))
    known = np.zeros(3**G, dtype=np.bool_)
    pace = (dt, halvings, order)
    modes, end = np.zeros(G, dtype=np.int64), np.zeros(G, dtype=np.int64)
    z, new = np.zeros(n + U), np.zeros(n + U)
    for t in range(T):
        z[:n] = x0[t]
        z[n : n + X * J] = c[t, 0]
        z[n + X * J : values] = constants[t]
        out[t, 0] = x0[t]
        contact_modes(approach, rates, z, modes)
        for k in range(K):
            number = mode_number(modes)
            if not known[number]:
                learn(machine, modes, number, part, whole, pace, Q, X)
                known[number] = True
            z[n : n + X * J] = c[t, k]
            for q in range(Q):
                z[values + q] = curve_value(of[q], place[q], table[q], z)
                z[slopes + q] = 0.0
            carried(whole[number], z, n, Q, X, h, new)
            for q in range(Q):
                z[slopes + q] = (curve_value(of[q], place[q], table[q], new) - z[values + q]) / h
            for q in range(Q):
                for i in range(n):
                    new[i] += whole[number, i, slopes + q] * z[slopes + q]
            contact_modes(approach, rates, new, end)
            if not same(modes, end):
                new[:] = z
                for _ in range(pieces):
                    number = mode_number(modes)
                    if not known[number]:
                        learn(machine, modes, number, part, whole, pace, Q, X)
                        known[number] = True
                    carried(part[number], new, n, Q, X, dt, z)
                    contact_modes(approach, rates, z, end)
                    if same(modes, end):
                        new[:] = z
                    else:
                        through_piece(A, B, approach, rates, push, law, new, modes, dt, Q, X, order)
            z[:n] = new[:n]
            out[t, k + 1] = new[:n]
