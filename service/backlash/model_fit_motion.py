"""The motors' motion between their samples, made to agree with the forces of the model that they drive.

The reconstruction (driven_smoothing) needs the force on the motor, and the force needs the motion. Taking turns
does not end where the contact swings near half the rate of the samples: there the motion's error comes back
larger than it went. So the answer of the whole loop is taken linear around the present parameters: what the
motors do to a force beyond their recoil is a smooth curve of few coefficients η, the simulation says what each of them
does to the forces, and η is solved for. A fit then moves with the input that its own parameters make, and what the
next reconstruction finds is nearly what it was begun with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline

from service.backlash.model_fit_data import Measured, digital_noise
from service.backlash.model_fit_following import Following, SingleArray
from service.backlash.model_fit_problem import Fit, Point, Problem, course_at
from service.dynamics.driven_motion import between
from service.dynamics.driven_recoil import Recoil
from service.dynamics.driven_smoothing import (
    Around,
    Balance,
    Spreads,
    around,
    balanced,
    likeliest,
    reaction,
    reconstructed,
)
from service.recording import FloatArray

RECOIL = 1.5
"""Ω of the motors' recoil times the period of the speed samples: about where these begin to hold the motion."""

LEAST_BEND = 1e-3
"""Least bend of the curve of ∫w over the noise of a speed sample: below it the curve is a parabola over a step."""

KNOTS = 1e-3
"""Distance of the knots of η [s]: what the samples of speed and torque hold the motor against lies below 500 Hz."""

SLIGHT = 0.03
"""Of the curves, those are left out that are smaller on the grid than this share of the greatest."""

GUARD = 0.1
"""What the answer is kept from growing with: a loop that nearly closes on itself would be followed too far."""

NUDGE = 1e-8
"""Speed by which the motors are moved for the difference quotients [m/s]."""

RUNAWAY = 1e12
"""A slope beyond this is a lane that left the range of numbers; it is left out."""


@dataclass(frozen=True)
class Motor:
    """What was recorded of one motor around every step, the forces on it (T, K + 1), what it is worth; period [s]."""

    steps: list[Around]
    forces: FloatArray
    spreads: Spreads
    balance: Balance
    period: float


def with_following_motors(measured: Measured, problem: Problem, fit: Fit) -> Problem:
    """The problem with the motors' motion between their samples by the fit's forces and the torque, eq. (1), and with
    the motors answering other forces."""
    force = fit.response.force[0]
    speeds, motions = curves(problem.samples, problem.grids[0].h)
    moved, beyond = with_recoiling_motors(measured, problem, fit, speeds)
    return replace(moved, following=following(moved, fit.point, motions, force, beyond))


def with_recoiling_motors(
    measured: Measured, problem: Problem, fit: Fit, speeds: FloatArray
) -> tuple[Problem, SingleArray]:
    """The problem with the motors' motion by the fit's forces, giving way to others; and what the forces on the motors
    make of η beyond that, (T, X·B, X·(K + 1)), for curves with the speeds (K + 1, B)."""
    force, e = fit.response.force[0], fit.response.recoil
    motors = [motor_of(measured, problem, fit, force[:, x], x) for x in range(len(measured.axes))]
    recoil = Recoil(
        measured.axes, tuple(m.balance.force for m in motors), RECOIL / min(m.period for m in motors)
    )
    begun = recoil_of(problem, recoil, force, None if e is None else e[0])
    columns = [
        [
            reconstructed(step, f, motor.spreads, motor.balance, gone, before[x])
            for step, f, gone, before in zip(
                motor.steps, motor.forces, begun[:, x], measured.motion, strict=False
            )
        ]
        for x, motor in enumerate(motors)
    ]
    moved = replace(problem, motion=tuple(zip(*columns, strict=True)), recoil=recoil, following=None)
    return moved, beyond_recoil(moved, recoil, motors, speeds)


def recoil_of(problem: Problem, recoil: Recoil, force: FloatArray, e: FloatArray | None) -> FloatArray:
    """Course (T, X, K + 1, 3) of `recoil` under forces that had the recoil e before."""
    if problem.recoil is None or e is None:
        h, axes = problem.grids[0].h, range(force.shape[1])
        e = np.stack([recoil.under(force[:, x].T, x, h).swapaxes(0, 1) for x in axes], axis=1)
    else:
        e = e * (np.array(recoil.force) / np.maximum(problem.recoil.force, 1e-9))[:, None, None]
    return np.stack([recoil.course(own, f) for own, f in zip(e, force, strict=True)])


def motor_of(measured: Measured, problem: Problem, fit: Fit, force: FloatArray, x: int) -> Motor:
    """One motor by the forces (T, K + 1) on it."""
    axis, least = measured.axes[x], noise_of_motor(measured, x)
    speed, torque = (measured.recording.trace(axis, c) for c in ("motor_speed", "motor_torque"))
    assert speed is not None
    transmission = measured.recording.axis(axis).transmission
    skew = fit.value(problem.model, f"{axis}.skew")
    steps = [around(speed, transmission, torque, g.time + skew) for g in problem.grids]
    return Motor(steps, force, *balance_in(steps, list(force), least), float(np.median(np.diff(speed.time))))


def noise_of_motor(measured: Measured, x: int) -> Spreads:
    """What a sample of the speed [m/s] and of the torque [N m] is worth at rest, with the least bend [m/s]."""
    recording, axis = measured.recording, measured.axes[x]
    speed, torque = (recording.trace(axis, c) for c in ("motor_speed", "motor_torque"))
    assert speed is not None
    of_speed = digital_noise(speed, recording.moves) * recording.axis(axis).transmission
    of_torque = 1.0 if torque is None else digital_noise(torque, recording.moves)
    return Spreads(of_speed, of_torque, LEAST_BEND * of_speed)


def balance_in(
    steps: Sequence[Around], forces: Sequence[FloatArray], least: Spreads
) -> tuple[Spreads, Balance]:
    """Spreads and balance at which the recording is likeliest; the torque's noise becomes one of acceleration."""
    begin = Spreads(least.speed, 1.0, 10.0 * least.speed)
    if len(steps[0].torque):
        about = balanced(steps, forces, replace(begin, torque=1e-2))
        begin = replace(begin, torque=about.torque * least.torque)
    spreads = likeliest(steps, forces, replace(begin, bend=least.bend), begin)
    return spreads, balanced(steps, forces, spreads)


def curves(samples: int, h: float) -> tuple[FloatArray, FloatArray]:
    """The curves that η counts, orthonormal on the grid: their speed (K + 1, B), and their motion (B, K, 5)."""
    pieces = int(np.ceil(samples * h / KNOTS))
    spline = BSpline(np.arange(-4, pieces + 5.0), np.eye(pieces + 4), 4)
    width = samples * h / pieces
    u = np.arange(samples + 1) / samples * pieces
    x, v, a = spline.antiderivative()(u) * width, spline(u), spline(u, 1) / width
    left, size, right = np.linalg.svd(v, full_matrices=False)
    clear = size > SLIGHT * size[0]
    whole = right[clear].T / size[clear]
    x, v, a = x @ whole, left[:, clear], a @ whole
    return v, between((x - x[0]).T, v.T, a.T, h)


def beyond_recoil(
    problem: Problem, recoil: Recoil, motors: Sequence[Motor], speeds: FloatArray
) -> SingleArray:
    """What forces on the motors make of η beyond the recoil, (T, X·B, X·(K + 1))."""
    T, X, K, B = len(problem.grids), len(motors), problem.samples, speeds.shape[1]
    out = np.zeros((T, X, B, X, K + 1), np.float32)
    for x, motor in enumerate(motors):
        gone = recoil.under(np.eye(K + 1), x, problem.grids[0].h)[..., 1]
        for t, step in enumerate(motor.steps):
            out[t, x, :, x] = speeds.T @ (reaction(step, motor.spreads, motor.balance) - gone)
    return out.reshape(T, X * B, -1)


def following(
    problem: Problem, at: Point, motions: FloatArray, force: FloatArray, beyond: SingleArray
) -> Following:
    """How the motors follow forces other than `force` around a point, beyond their recoil; `beyond` is what these make
    of the curves (B, K, 5), and the answer takes its place."""
    slopes = sensitivities(problem, at, motions)
    for t, own in enumerate(beyond):
        P = own.astype(np.float64)
        loop = np.eye(len(P)) - P @ slopes.forces[t]
        beyond[t] = np.linalg.solve(loop.T @ loop + GUARD**2 * np.eye(len(P)), loop.T @ P)
    return replace(slopes, force=force, answer=beyond)


def sensitivities(problem: Problem, at: Point, motions: FloatArray) -> Following:
    """What every curve (B, K, 5) of every motor does to accelerations, forces and recoil, by difference quotients."""
    X, (B, K) = at.local.shape[1], motions.shape[:2]
    shifts = np.zeros((1 + X * B, K, X, 5))
    for x in range(X):
        shifts[1 + x * B : 1 + (x + 1) * B, :, x] = NUDGE * motions
    still = answers(problem, at, shifts[:1])
    slopes = [np.empty((*part.shape[1:], X * B), np.float32) for part in still]
    for k in range(1, 1 + X * B, problem.together):
        ways = shifts[k : k + problem.together]
        for slope, moved, before in zip(slopes, answers(problem, at, ways), still, strict=True):
            change = np.moveaxis((moved - before) / NUDGE, 0, -1)
            slope[..., k - 1 : k - 1 + len(ways)] = np.where(np.abs(change) < RUNAWAY, change, 0.0)
    said = (slope.reshape(len(slope), -1, X * B) for slope in slopes)
    return Following(np.zeros(0), np.zeros(0, np.float32), *said)


def answers(problem: Problem, at: Point, shifts: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Accelerations, forces and recoil (S, T, …) with the motors moved by `shifts` (S, K, X, 5)."""
    S = len(shifts)
    course = course_at(problem, np.tile(at.shared, (S, 1)), np.tile(at.local, (S, 1, 1, 1)), shifts[:, None])
    recoil = course.recoil()
    assert recoil is not None
    return course.acceleration(), course.force(), recoil
