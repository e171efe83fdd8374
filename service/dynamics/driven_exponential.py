"""How one contact state carries states and inputs over an interval: exp(N·h), and its Taylor series at one place.

States and inputs together are one vector z (W,) whose rate is linear in it, ż = N·z: the motor's motion is a polynomial
(each derivative's rate is the next), constants stay, forces given as curves change at a constant rate within an
interval. Of N and of its exponential only the states' n rows are kept.
"""

from __future__ import annotations

from service.dynamics.compiled import lean, within

ORDER = 18
"""Terms of a Taylor series over at most REACH time constants: 1/19! is 1e-17."""

REACH = 1.0
"""Time constants of a piece: doubling it costs less than the terms of a longer series."""

SMALLEST = 1e-18
"""Term of a speed over the speed at which a series ends: a hundredth of what rounding leaves of it."""

J = 5
"""Derivatives of the motor's position in one interval, position and speed the first two."""


@lean
def rate_matrix(A, B, push, law, forced, modes, N):
    """N's first n rows into N (n, W): A, B and the flanks in contact, whose forces are k times the forms `forced`."""
    n = A.shape[0]
    for i in range(n):
        for w in range(n):
            N[i, w] = A[i, w]
        for w in range(B.shape[1]):
            N[i, n + w] = B[i, w]
    for g in range(len(modes)):
        if modes[g] == 1:
            continue
        side = modes[g] // 2
        for i in range(n):
            if push[g, side, i] != 0.0:
                size = push[g, side, i] * law[g, 0]
                for w in range(N.shape[1]):
                    N[i, w] += size * forced[g, side, w]


@lean
def halvings(reach: float) -> int:
    """How many times an interval of `reach` time constants is halved to its pieces."""
    times = 0
    while reach > REACH * (1 << times):
        times += 1
    return times


@lean
def terms(reach):
    """How many terms a series over `reach` time constants needs, at most ORDER."""
    size, order = 1.0, 0
    while size > 1e-15 and order < ORDER:
        order += 1
        size *= reach / order
    return max(order, J + 1)


@lean
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


@lean
def exponential(N, n, Q, X, dt, order, E, scratch):
    """First n rows of exp(N·dt) by its series into E; positions' rates are the speeds that follow them.

    scratch : term, new (n, W) and drive (n, U)
    """
    term, new, drive = scratch
    W, size = N.shape[1], 1.0
    for i in range(n):
        for w in range(W):
            term[i, w] = E[i, w] = 0.0
        for w in range(W - n):
            drive[i, w] = N[i, n + w]
        term[i, i] = E[i, i] = 1.0
    for k in range(1, order + 1):
        raised(N, term, n, new)
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


@lean
def raised(N, term, n, new):
    """The states' part of N times a term of the series, into new."""
    W = N.shape[1]
    for i in range(0, n, 2):
        for w in range(W):
            new[i, w] = term[i + 1, w]
            new[i + 1, w] = 0.0
        for r in range(0, n, 2):
            stiff, loss = N[i + 1, r], N[i + 1, r + 1]
            if stiff != 0.0 or loss != 0.0:
                for w in range(W):
                    new[i + 1, w] += stiff * term[r, w] + loss * term[r + 1, w]


@lean
def doubled(E, n, Q, X, dt, out, shares):
    """Rows of exp(N·2·dt) from those of exp(N·dt), into out; `shares` is room (J,)."""
    W = E.shape[1]
    shares[0] = 1.0
    for j in range(1, J):
        shares[j] = shares[j - 1] * dt / j
    for i in range(n):
        for w in range(n):
            out[i, w] = 0.0
        for w in range(n, W):
            out[i, w] = E[i, w]
        for q in range(W - Q, W):
            out[i, q] += dt * E[i, q - Q]
        for x in range(n, n + X * J, J):
            for j in range(1, J):
                total = 0.0
                for before in range(j):
                    total += E[i, x + before] * shares[j - before]
                out[i, x + j] += total
        for r in range(0, n, 2):
            place, speed = E[i, r], E[i, r + 1]
            for w in range(W):
                out[i, w] += place * E[r, w] + speed * E[r + 1, w]


@within
def series(N, z, n, Q, X, reach, order, D):
    """Taylor coefficients of z into D, whose inputs are 0 from row J + 2 on; how many there are, the last being too
    small to matter at the time `reach`."""
    W, power, quiet = len(z), 1.0, 0
    for w in range(W):
        D[0, w] = z[w]
    for i in range(order):
        columns = W if i <= J else n
        if i <= J:
            inputs_rate(D, i, n, Q, X)
        power *= reach
        small = i > J
        for r in range(0, n, 2):
            total = 0.0
            for w in range(columns):
                total += N[r + 1, w] * D[i, w]
            D[i + 1, r] = D[i, r + 1] / (i + 1)
            D[i + 1, r + 1] = total / (i + 1)
            small = small and abs(D[i + 1, r + 1]) * power <= SMALLEST * abs(z[r + 1])
        quiet = quiet + 1 if small else 0
        if quiet == 2:
            return i + 2
    return order + 1


@within
def inputs_rate(D, i, n, Q, X):
    """The inputs' coefficients of order i + 1 from those of order i."""
    U = D.shape[1] - n
    for w in range(n, n + U):
        D[i + 1, w] = 0.0
    for x in range(X):
        for j in range(J - 1):
            D[i + 1, n + x * J + j] = D[i, n + x * J + j + 1] / (i + 1)
    for q in range(Q):
        D[i + 1, n + U - 2 * Q + q] = D[i, n + U - Q + q] / (i + 1)


@within
def state_at(D, many, n, Q, X, t, z):
    """The series of `many` terms at the time t, into z."""
    for w in range(n):
        z[w] = 0.0
    for i in range(many - 1, -1, -1):
        for w in range(n):
            z[w] = z[w] * t + D[i, w]
    later_inputs(D[0], n, Q, X, t, z)


@within
def later_inputs(z, n, Q, X, dt, out):
    """The inputs a time dt later, into out; constants are left alone there."""
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
