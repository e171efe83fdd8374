"""Exact propagation of a piecewise linear system between contact events, many lanes at once.

Within one contact state the machine is linear, ẋ = A·x + Bx·x_mot(t) + Bv·v_mot(t) + B0, and the motor's
measured motion is a polynomial in each grid interval. So a whole interval is one product with a matrix
exponential, and only the intervals in which a flank meets or parts are looked at more closely: there the
state's Taylor series gives the event's time by Newton's method, and the rest of the interval is done in the
new contact state. Nothing depends on a step size, so that the result is smooth in every parameter.

Shapes
------
S : parameter sets, T : steps, L = S·T lanes (lane = set·T + step), K : grid intervals of length h,
n : states, X : axes, M = 3**X contact states (0: lower flank, 1: gap, 2: upper flank; first axis fastest),
J = 5 : coefficients of x_mot in one interval, x_mot(t) = Σ c_j t^j / j!.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.typing import NDArray

from service.recording import FloatArray

IntArray = NDArray[np.int64]

COEFFICIENTS = 5
NEWTON_STEPS = 5
EVENTS_PER_INTERVAL = 6


@dataclass(frozen=True)
class LinearSystem:
    """One linear system per parameter set and contact state, and how its contact states follow.

    Attributes
    ----------
    A : (S, M, n, n)
    Bx, Bv : (S, M, n, X) on motor position [m] and speed [m/s] at the output
    B0 : (S, M, n) constant drive
    Bs : (S, M, n) constant drive times the direction of the step
    relative : (X, n), motor_share : (X,): pinion minus load is relative·x + motor_share·x_mot [m]; positions are
        followed by their speeds, so that its rate is the same one state further on
    half_gap : (S, X) b/2 [m]
    lag : (S, X) damping over stiffness of the contact [s]: a flank parts when its force k·(Δ − b/2) + d·Δ̇ is used
        up, a little before the displacement is, since steel does not pull (eq. (5) read that way)
    """

    A: FloatArray
    Bx: FloatArray
    Bv: FloatArray
    B0: FloatArray
    Bs: FloatArray
    relative: FloatArray
    motor_share: FloatArray
    half_gap: FloatArray
    lag: FloatArray


def taylor_order(A: FloatArray, h: float) -> int:
    """Terms until the exponential's series of the fastest set is exact to about 1e-12."""
    norm = float(np.max(np.sqrt(np.abs(np.linalg.eigvals(A @ A)).max(axis=-1)))) * h
    return int(min(60, 12 + np.ceil(4.0 * norm)))


def transition(A: FloatArray, h: float, order: int) -> tuple[FloatArray, FloatArray]:
    """Φ = exp(A·h): (…, n, n), and Ψ_j = ∫ exp(A(h − t))·t^j/j! dt: (J, …, n, n)."""
    Ah, power = A * h, np.broadcast_to(np.eye(A.shape[-1]), A.shape)
    Phi = np.zeros_like(A)
    Psi = np.zeros((COEFFICIENTS, *A.shape))
    for i in range(order + 1):
        Phi += power / factorial(i)
        for j in range(COEFFICIENTS):
            Psi[j] += power * (h ** (j + 1) / factorial(i + j + 1))
        power = power @ Ah
    return Phi, Psi


def forcing(system: LinearSystem, Psi: FloatArray, c: FloatArray, s: FloatArray) -> FloatArray:
    """What drive and constants add to the state over each interval: (M, K, L, n).

    c : (S, T, K, X, J) coefficients of x_mot; its speed has the coefficients one further on.
    s : (T,) directions.
    """
    S, T, K, X, J = c.shape
    W = np.einsum("jsmab,smbx->smaxj", Psi, system.Bx)
    W[..., 1:] += np.einsum("jsmab,smbx->smaxj", Psi[:-1], system.Bv)
    n, M = W.shape[2], W.shape[1]
    flat = c.reshape(S, T * K, X * J)
    driven = flat[:, None] @ W.reshape(S, M, n, X * J).swapaxes(2, 3)
    constant = (Psi[0] @ system.B0[..., None])[..., 0]
    signed = (Psi[0] @ system.Bs[..., None])[..., 0]
    total = driven.reshape(S, M, T, K, n)
    total += constant[:, :, None, None] + signed[:, :, None, None] * s[:, None, None]
    return np.ascontiguousarray(total.transpose(1, 3, 0, 2, 4).reshape(M, K, S * T, n))


def contact_state(relative: FloatArray, rate: FloatArray, half_gap: FloatArray, lag: FloatArray) -> IntArray:
    """Which flank touches and pushes, per axis, all (…, X) -> 0, 1 or 2."""
    pushing = relative + lag * rate
    upper = np.minimum(relative, pushing) > half_gap
    lower = np.maximum(relative, pushing) < -half_gap
    return 1 + upper.astype(np.int64) - lower.astype(np.int64)


def mode_number(state: IntArray) -> IntArray:
    """Contact states of all axes (L, X) as one number (L,)."""
    return np.asarray(state @ (3 ** np.arange(state.shape[1])))


class Propagation:
    """All lanes of one simulation: matrices looked up once, then one pass over the grid."""

    def __init__(self, system: LinearSystem, c: FloatArray, s: FloatArray, h: float) -> None:
        S, T, K, X, J = c.shape
        self.system, self.h, self.K, self.T = system, h, K, T
        self.order = taylor_order(system.A, h)
        self.Phi, Psi = transition(system.A, h, self.order)
        self.G = forcing(system, Psi, c, s)
        self.c = c.reshape(S * T, K, X, J)
        self.s = np.tile(s, S)
        self.set = np.repeat(np.arange(S), T)
        self.half_gap, self.lag = system.half_gap[self.set], system.lag[self.set]
        self.rate_row = np.roll(system.relative, 1, axis=1)
        self.lanes = np.arange(S * T)

    def contact(self, x: FloatArray, motor: FloatArray) -> IntArray:
        """Contact states (L, X) from states (L, n) and motor position and speed (L, X, 2)."""
        share = self.system.motor_share
        relative = x @ self.system.relative.T + share * motor[..., 0]
        rate = x @ self.rate_row.T + share * motor[..., 1]
        return contact_state(relative, rate, self.half_gap, self.lag)

    def run(self, x0: FloatArray) -> FloatArray:
        """States at the K + 1 grid points, from x0 (L, n): (K + 1, L, n)."""
        out = np.empty((self.K + 1, *x0.shape))
        out[0] = x = x0
        state = self.contact(x, self.c[:, 0, :, :2])
        mode = mode_number(state)
        Phi = self.Phi[self.set, mode]
        for k in range(self.K):
            new = np.einsum("lij,lj->li", Phi, x) + self.G[mode, k, self.lanes]
            moved = np.flatnonzero((self.contact(new, self.motor_end(k)) != state).any(axis=1))
            if len(moved):
                new[moved], state[moved] = self.through_events(moved, k, x[moved], state[moved])
                mode = mode_number(state)
                Phi[moved] = self.Phi[self.set[moved], mode[moved]]
            out[k + 1] = x = new
        return out

    def motor_end(self, k: int) -> FloatArray:
        """Motor position and speed at the end of interval k: (L, X, 2)."""
        if k + 1 < self.K:
            return self.c[:, k + 1, :, :2]
        return shifted(self.c[:, k], np.full(len(self.c), self.h))[..., :2]

    def through_events(
        self, lanes: IntArray, k: int, x: FloatArray, state: IntArray
    ) -> tuple[FloatArray, IntArray]:
        """States and contact states at the end of interval k of lanes whose flanks meet or part within it."""
        c, left, state = self.c[lanes, k], np.full(len(lanes), self.h), state.copy()
        half, lag = self.half_gap[lanes], self.lag[lanes]
        for _ in range(EVENTS_PER_INTERVAL):
            d = self.series(lanes, mode_number(state), x, c)
            gap = self.relative_series(d, c)
            slope = gap[1:] * np.arange(1, len(gap))[:, None, None]
            end = contact_state(horner(gap, left[:, None]), horner(slope, left[:, None]), half, lag)
            leaving = end != state
            busy = leaving.any(axis=1)
            if not busy.any():
                break
            time, axis = first_event(pushing_series(gap, slope, lag, state, half), (state, end), half, left)
            time = np.where(busy, time, left)
            x, c, left = horner(d, time[:, None]), shifted(c, time), left - time
            state[busy, axis[busy]] = end[busy, axis[busy]]
        return horner(self.series(lanes, mode_number(state), x, c), left[:, None]), state

    def series(self, lanes: IntArray, mode: IntArray, x: FloatArray, c: FloatArray) -> FloatArray:
        """Taylor coefficients d_i/i! of the states, (order + 1, l, n), in the given contact states."""
        of, system = self.set[lanes], self.system
        A, Bx, Bv = system.A[of, mode], system.Bx[of, mode], system.Bv[of, mode]
        d = np.empty((self.order + 1, *x.shape))
        d[0], derivative = x, x
        for i in range(self.order):
            derivative = np.einsum("lij,lj->li", A, derivative)
            if i == 0:
                derivative = derivative + system.B0[of, mode] + system.Bs[of, mode] * self.s[lanes, None]
            if i < COEFFICIENTS:
                derivative = derivative + np.einsum("lix,lx->li", Bx, c[..., i])
            if i + 1 < COEFFICIENTS:
                derivative = derivative + np.einsum("lix,lx->li", Bv, c[..., i + 1])
            d[i + 1] = derivative / factorial(i + 1)
        return d

    def relative_series(self, d: FloatArray, c: FloatArray) -> FloatArray:
        """Taylor coefficients of the relative displacement: (order + 1, l, X)."""
        gap = np.asarray(d @ self.system.relative.T)
        for j in range(COEFFICIENTS):
            gap[j] += self.system.motor_share * c[..., j] / factorial(j)
        return gap


def horner(series: FloatArray, time: FloatArray) -> FloatArray:
    """Σ series[i]·time^i over the first axis."""
    total = series[-1]
    for term in series[-2::-1]:
        total = total * time + term
    return np.asarray(total)


def shifted(c: FloatArray, time: FloatArray) -> FloatArray:
    """The polynomials c (l, X, J) of x_mot seen from `time` (l,) on."""
    out = np.zeros_like(c)
    for j in range(COEFFICIENTS):
        for i in range(j, COEFFICIENTS):
            out[..., j] += c[..., i] * (time ** (i - j) / factorial(i - j))[:, None]
    return out


def pushing_series(
    gap: FloatArray, slope: FloatArray, lag: FloatArray, state: IntArray, half: FloatArray
) -> FloatArray:
    """What crosses half the backlash at the next event: the displacement where a flank is to meet, the
    displacement that counts for the force where it is to part, or to push again."""
    by_force = (state != 1) | (np.abs(gap[0]) > half)
    out = gap.copy()
    out[:-1] += np.where(by_force, lag, 0.0) * slope
    return out


def first_event(
    course: FloatArray, states: tuple[IntArray, IntArray], half: FloatArray, left: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Time (l,) and axis (l,) of the first flank that meets or parts, by Newton's method within [0, left].

    course : (order, l, X) series of what crosses its border; states : before and at the end of the interval
    """
    state, end = states
    border = np.where((state == 2) | ((state == 1) & (end == 2)), half, -half)
    limit = np.broadcast_to(left[:, None], border.shape)
    slope = course[1:] * np.arange(1, len(course))[:, None, None]
    span = horner(course, limit) - course[0]
    time = np.clip((border - course[0]) / np.where(span == 0.0, 1.0, span), 0.0, 1.0) * limit
    for _ in range(NEWTON_STEPS):
        rate = horner(slope, time)
        time = np.clip(time - (horner(course, time) - border) / np.where(rate == 0.0, 1.0, rate), 0.0, limit)
    time = np.where(state != end, time, np.inf)
    axis = np.argmin(time, axis=1)
    return np.take_along_axis(time, axis[:, None], axis=1)[:, 0], axis
