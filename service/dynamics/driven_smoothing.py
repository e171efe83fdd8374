"""The motor's motion between its samples, by eq. (1) and everything that was recorded of it.

At the output eq. (1) reads a_mot = −φ·F + w: F is the force on the motor per moved mass, which the forward model
knows, φ the moved mass over the motor's inertia, and w what torque and friction make. F jumps at the impact; w does
not, since the controller answers a blow late. So w alone is what a smooth curve may stand for. Its integral is
seen in every speed sample and w itself in every torque sample: values and means together follow the controller
up to the sampling rate, twice as far as either. Both are noisy, so w is the smoothing spline between them: a white
noise of its second derivative is the prior, and how strong it is, and how far the channels are to be trusted, is
where the recording is likeliest.

Shapes: n speed samples, m torque samples, K intervals of the load's grid, B spline coefficients.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline, CubicHermiteSpline, PPoly
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from service.recording import FloatArray, Trace

BEYOND = 2
"""Grid intervals by which the motion is continued at both ends, for a skew that is looked up a little off. Samples
beyond the grid are left out: the force is not known there."""

DEGREE = 4
"""Of the spline of ∫w: its third derivative, which the prior holds, is continuous."""

OF_A_SAMPLE = 0.5
"""Knot distance over that of the speed samples: as many coefficients as there are values of speed and torque."""

FACTORS = (4.0, 1.5)
"""Of the search for the spreads: first about, then to a third of what the likelihood resolves."""

MOST = 1e6
"""Greatest spread over the least: a model that explains so little needs no better motion."""

LOOSE = 1e-9
"""Weight of the motor's friction against the curve's: some m/s² are free, and the information stays regular."""

EXAMINED = 3
"""Steps whose likelihood chooses the spreads: three hold 200 samples, and the controller is the same in all."""


@dataclass(frozen=True)
class Spreads:
    """Standard deviations: of a speed sample [m/s], of a torque sample [m/s²], and what ∫w's third derivative has
    over one knot interval [m/s]."""

    speed: float
    torque: float
    bend: float


@dataclass(frozen=True)
class Balance:
    """Eq. (1) at the output as found in the recording.

    force : φ, M over the motor's inertia at the output [1]; torque : ψ [m/s² per N m]
    """

    force: float
    torque: float


@dataclass(frozen=True)
class Around:
    """One motor around one step, on the load's grid continued at both ends.

    Attributes
    ----------
    time : (K + 1 + 2·beyond,) [s] of the motor's clock; h its spacing
    speed : (n,) samples [m/s] at the output, at `speed_time`; torque : (m,) [N m], m = 0 where none was recorded
    values, slopes : (…, B) the spline of ∫w on the grid [m/s] and w [m/s²]
    design : (n + m, B + 2) what the samples see: ∫w, and w beside the motor's friction (a constant and a share of
        the speed)
    penalty : (B + 2, B + 2)
    """

    time: FloatArray
    h: float
    beyond: int
    speed_time: FloatArray
    speed: FloatArray
    torque: FloatArray
    values: FloatArray
    slopes: FloatArray
    design: FloatArray
    penalty: FloatArray

    @property
    def n(self) -> int:
        return len(self.speed)

    def weights(self, spreads: Spreads) -> FloatArray:
        """(n + m,) of the samples."""
        m = len(self.torque)
        return np.concatenate((np.full(self.n, spreads.speed**-2.0), np.full(m, spreads.torque**-2.0)))

    def factor(self, spreads: Spreads) -> FloatArray:
        """Cholesky factor of the information on the coefficients, lower."""
        information = (self.design.T * self.weights(spreads)) @ self.design + self.penalty / spreads.bend**2
        return np.asarray(cho_factor(information, lower=True)[0])

    def forced(self, force: FloatArray) -> FloatArray:
        """−∫F on the continued grid for forces (K + 1, …) on the grid."""
        return -cumulative(self.held(force), self.h)

    def held(self, force: FloatArray) -> FloatArray:
        """Forces (K + 1, …) continued by their ends."""
        return np.concatenate(
            (
                np.repeat(force[:1], self.beyond, axis=0),
                force,
                np.repeat(force[-1:], self.beyond, axis=0),
            )
        )

    def seen(self, forced: FloatArray, force: FloatArray) -> FloatArray:
        """−∫F at the times of the speed samples (n, …), by the cubic through values and slopes."""
        return between(forced, -self.held(force), self.h, (self.speed_time - self.time[0]) / self.h)


def around(speed: Trace, transmission: float, torque: Trace | None, time: FloatArray) -> Around:
    """What was recorded of one motor around one step; `time` (K + 1,) is the grid on the motor's clock [s]."""
    period, h = float(np.median(np.diff(speed.time))), float(time[1] - time[0])
    beyond = BEYOND
    v = speed.between(float(time[0]), float(time[-1]))
    t = time[0] + h * np.arange(-beyond, len(time) + beyond)
    width = OF_A_SAMPLE * period
    pieces = int(np.ceil((t[-1] - t[0]) / width - 1e-3))
    spline = BSpline(np.arange(-DEGREE, pieces + DEGREE + 1.0), np.eye(pieces + DEGREE), DEGREE)
    at, heard = (t - t[0]) / width, v
    moment = np.zeros(0)
    if torque is not None:
        heard = torque.between(float(v.time[0]), float(v.time[-1]))
        moment = heard.value
    design = np.zeros((len(v.time) + len(moment), pieces + DEGREE + 2))
    design[: len(v.time), :-2] = spline((v.time - t[0]) / width)
    if len(moment):
        design[len(v.time) :, :-2] = spline((heard.time - t[0]) / width, 1) / width
        design[len(v.time) :, -2] = 1.0
        speeds = np.interp(heard.time, v.time, v.value)
        design[len(v.time) :, -1] = speeds / max(1e-30, float(np.max(np.abs(speeds))))
    return Around(
        t,
        h,
        beyond,
        v.time,
        v.value * transmission,
        moment,
        spline(at),
        spline(at, 1) / width,
        design,
        penalty_of(spline, pieces, free=2),
    )


def penalty_of(spline: BSpline, pieces: int, free: int) -> FloatArray:
    """∫(third derivative)² over all pieces as a quadratic form, exact by two points in each; `free` coefficients that
    it leaves alone are only kept from being undetermined."""
    points = (np.arange(pieces)[:, None] + 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)).ravel()
    third = spline(points, 3)
    B = third.shape[1]
    out = np.zeros((B + free, B + free))
    out[:B, :B] = 0.5 * third.T @ third
    out[range(B, B + free), range(B, B + free)] = LOOSE
    return out


def cumulative(value: FloatArray, h: float) -> FloatArray:
    """Integral from the first point along the first axis, exact for cubics inside."""
    inner = 13.0 * (value[1:-2] + value[2:-1]) - value[:-3] - value[3:]
    ends = (5.0 * value[0] + 8.0 * value[1] - value[2], 5.0 * value[-1] + 8.0 * value[-2] - value[-3])
    pieces = np.concatenate((2.0 * ends[0][None], inner, 2.0 * ends[1][None]))
    return np.concatenate((np.zeros_like(value[:1]), np.cumsum(pieces, axis=0) * h / 24.0))


def between(value: FloatArray, slope: FloatArray, h: float, place: FloatArray) -> FloatArray:
    """Cubic through values and slopes (…,) on a grid of spacing h, at places counted in intervals (n,)."""
    k = np.clip(np.floor(place).astype(int), 0, len(value) - 2)
    u = (place - k).reshape(-1, *(1,) * (value.ndim - 1))
    first, last = value[k], value[k + 1]
    rise, fall = h * slope[k] - (last - first), (last - first) - h * slope[k + 1]
    return np.asarray((1.0 - u) * first + u * last + u * (1.0 - u) * ((1.0 - u) * rise + u * fall))


def gram(step: Around, force: FloatArray, spreads: Spreads) -> tuple[FloatArray, float]:
    """Whitened products (3, 3) of speed, −∫F and torque with the spline profiled out, and log det of its information.

    What is left of (1, −φ, ψ) times the columns is minus twice the logarithm of their likelihood.
    """
    columns = np.zeros((len(step.design), 3))
    columns[: step.n, 0] = step.speed - step.speed[0]
    columns[: step.n, 1] = step.seen(step.forced(force), force)
    columns[step.n :, 2] = step.torque
    weighed = step.weights(spreads)[:, None] * columns
    factor = step.factor(spreads)
    right = step.design.T @ weighed
    left = columns.T @ weighed - right.T @ cho_solve((factor, True), right)
    return left, 2.0 * float(np.sum(np.log(np.diag(factor))))


def balance_of(products: FloatArray, heard: int) -> Balance:
    """φ and ψ at which the summed products (3, 3) of `heard` torque samples are likeliest; φ is no negative mass.

    The torque is a measurement, not ψ times it: without the logarithm of ψ a small ψ would make it easy to follow.
    """
    (_, b, d), (_, c, f), (_, _, g) = products
    if heard == 0:
        return Balance(max(0.0, float(b / c)), 0.0)
    linear, square = d - b * f / c, max(g - f * f / c, 1e-12 * g)
    torque = (-linear + float(np.sqrt(linear * linear + 4.0 * square * heard))) / (2.0 * square)
    return Balance(max(0.0, float((b + f * torque) / c)), float(torque))


def likelihood(steps: Sequence[Around], forces: Sequence[FloatArray], spreads: Spreads) -> float:
    """Minus twice the logarithm of the likelihood of the spreads, the balance at its best for them."""
    total, products, free, heard = 0.0, np.zeros((3, 3)), 0, 0
    for step, force in zip(steps, forces, strict=True):
        try:
            left, determinant = gram(step, force, spreads)
        except LinAlgError:
            return np.inf
        products += left
        total += determinant - float(np.sum(np.log(step.weights(spreads))))
        free += step.design.shape[1] - 5
        heard += len(step.torque)
    balance = balance_of(products, heard)
    at = np.array([1.0, -balance.force, balance.torque])
    scale = 2.0 * heard * float(np.log(balance.torque)) if heard else 0.0
    return total + float(at @ products @ at) + 2.0 * free * float(np.log(spreads.bend)) - scale


def likeliest(
    steps: Sequence[Around], forces: Sequence[FloatArray], least: Spreads, begin: Spreads
) -> Spreads:
    """The likeliest spreads by coordinates, in factors of FACTORS; no channel is better than it is at rest."""
    few, seen = steps[:EXAMINED], forces[:EXAMINED]
    best, lowest = begin, likelihood(few, seen, begin)
    for factor in FACTORS:
        for name in ("bend", "torque", "speed", "bend"):
            for towards in (factor, 1.0 / factor):
                while True:
                    floor = getattr(least, name)
                    value = float(np.clip(getattr(best, name) * towards, floor, MOST * floor))
                    trial = replace(best, **{name: value})
                    reached = likelihood(few, seen, trial) if value != getattr(best, name) else np.inf
                    if not reached < lowest - 0.1:
                        break
                    best, lowest = trial, reached
    return best


def balanced(steps: Sequence[Around], forces: Sequence[FloatArray], spreads: Spreads) -> Balance:
    """φ and ψ from all steps."""
    products = (gram(step, force, spreads)[0] for step, force in zip(steps, forces, strict=True))
    return balance_of(np.sum(list(products), axis=0), sum(len(step.torque) for step in steps))


def reaction(step: Around, spreads: Spreads, balance: Balance) -> FloatArray:
    """(K + 1, K + 1): times a force that differs by δF (K + 1,), what changes in the motor's speed [m/s] as it is
    reconstructed."""
    grid = slice(step.beyond, len(step.time) - step.beyond)
    forces = np.eye(grid.stop - grid.start)
    forced = balance.force * step.forced(forces)
    y = np.zeros((len(step.design), len(forces)))
    y[: step.n] = step.seen(forced, balance.force * forces)
    found = cho_solve((step.factor(spreads), True), step.design.T @ (step.weights(spreads)[:, None] * y))
    return np.asarray((forced - step.values @ found[:-2])[grid])


def reconstructed(
    step: Around, force: FloatArray, spreads: Spreads, balance: Balance, recoil: FloatArray, plain: PPoly
) -> PPoly:
    """Position [m] around one step under the force (K + 1,) on the motor, less the recoil (K + 1, 3) under it."""
    forced = step.forced(force)
    y = np.concatenate((step.speed - balance.force * step.seen(forced, force), balance.torque * step.torque))
    found = cho_solve((step.factor(spreads), True), step.design.T @ (step.weights(spreads) * y))[:-2]
    gone = step.held(recoil)
    speed = balance.force * forced + step.values @ found - gone[:, 1]
    acceleration = -balance.force * step.held(force) + step.slopes @ found - gone[:, 2]
    position = CubicHermiteSpline(step.time, speed, acceleration).antiderivative()
    # The two motors of a gantry keep their distance from step to step: the position goes on from the whole run's.
    position.c[-1] += float(plain(step.time[0]))
    return position
