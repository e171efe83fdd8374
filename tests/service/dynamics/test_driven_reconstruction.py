"""The motor's motion between its samples, against a motor whose motion is known everywhere."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline, PPoly

from service.dynamics.driven_motion import plain_motion
from service.dynamics.driven_reconstruction import (
    Balance,
    Load,
    as_reported,
    behind,
    drive_of,
    echo,
    motor_balance,
    reconstructed_motion,
    torque_courses,
    window,
)
from service.recording import FloatArray, Trace

INERTIA, GAIN, LAG, TRANSMISSION = 300.0, 6e4, 5e-4, 0.003
"""Motor at the output [kg], speed feedback at the output [N/(m/s)], current loop [s], [m/rad]."""

RINGING = 2.0 * np.pi * 170.0
FILTER = 9e-4
"""Time constant of the drive's filter on the speed that it reports [s]."""


@dataclass(frozen=True)
class Known:
    """A motor's true speed [m/s] by time, its samples, and the force on it per moved mass of 400 kg."""

    fine: FloatArray
    v: FloatArray
    speed: Trace
    torque: Trace
    load: Load


def force(t: FloatArray | float) -> FloatArray:
    """A push of 3 m/s², and from 50 ms on a contact that swings at 170 Hz [m/s²]."""
    after = np.maximum(np.asarray(t) - 0.05, 0.0)
    return np.asarray(3.0 - 9.0 * np.exp(-60.0 * after) * np.sin(RINGING * after) * (after > 0.0))


@pytest.fixture(scope="module")
def known() -> Known:
    """Integrated with the drive's lag as a state, sampled at 500 Hz."""

    def rate(t: float, y: FloatArray) -> list[float]:
        v, drive = y
        command = 1500.0 + GAIN * (0.05 + 0.2 * t - v)
        return [(drive - 400.0 * float(force(t))) / INERTIA, (command - drive) / LAG]

    fine = np.arange(0.0, 0.12, 2.5e-5)
    y = solve_ivp(rate, (0.0, 0.12), [0.05, 1200.0], t_eval=fine, rtol=1e-10, atol=1e-9, max_step=1e-4).y
    at = slice(None, None, 80)
    grid = 0.03 + 2.5e-4 * np.arange(241)
    return Known(
        fine,
        y[0],
        Trace(fine[at], y[0][at] / TRANSMISSION),
        Trace(fine[at], y[1][at] * TRANSMISSION),
        (grid, force(grid)),
    )


def speed_error(known: Known, motion: PPoly) -> float:
    """RMS speed error of a motion after the blow [m/s]."""
    inside = (known.fine > 0.05) & (known.fine < 0.085)
    return float(np.sqrt(np.mean((motion(known.fine[inside], 1) - known.v[inside]) ** 2)))


def test_follows_a_contact_that_swings_at_a_third_of_the_rate(known: Known) -> None:
    plain = motion = plain_motion(known.speed, TRANSMISSION)
    for _ in range(4):
        torques = torque_courses([window(known.torque, known.load)], [motion])
        balance = motor_balance(known.speed, TRANSMISSION, [known.load], torques)
        motion = reconstructed_motion(known.speed, TRANSMISSION, known.load, torques[0], balance, motion)
    assert balance.force == pytest.approx(400.0 / INERTIA, rel=0.05)
    assert balance.torque == pytest.approx(1.0 / (INERTIA * TRANSMISSION), rel=0.05)
    assert speed_error(known, motion) < 0.1 * speed_error(known, plain)


@pytest.fixture(scope="module")
def reported(known: Known) -> Trace:
    """The speed behind the drive's filter, integrated as a state of its own, at 1 kHz."""
    v = CubicSpline(known.fine, known.v)
    y = solve_ivp(
        lambda t, y: (v(t) - y) / FILTER,
        (0.0, known.fine[-1]),
        [known.v[0]],
        t_eval=known.fine,
        rtol=1e-10,
        atol=1e-12,
        max_step=1e-4,
    ).y[0]
    return Trace(known.fine[::40], y[::40] / TRANSMISSION)


def test_a_speed_behind_a_filter_follows_the_force_behind_it(known: Known, reported: Trace) -> None:
    """Undone, the filter sharpens what a spline of its samples gets wrong; force and torque tell what lies between."""

    def undone(motion: PPoly) -> PPoly:
        fine = known.fine[(known.fine >= known.load[0][0]) & (known.fine <= known.load[0][-1])]
        return CubicSpline(fine, motion(fine, 1) + FILTER * motion(fine, 2)).antiderivative()

    def found(lag: float) -> PPoly:
        motion, load = plain, as_reported(known.load, lag)
        for _ in range(4):
            torques = torque_courses([window(known.torque, load)], [motion], lag)
            balance = motor_balance(reported, TRANSMISSION, [load], torques)
            motion = reconstructed_motion(reported, TRANSMISSION, load, torques[0], balance, motion)
        return motion

    plain = plain_motion(reported, TRANSMISSION)
    error = speed_error(known, undone(found(FILTER)))
    assert error < 0.3 * speed_error(known, undone(plain))
    assert error < 0.1 * speed_error(known, undone(found(0.0)))


def test_a_lag_answers_a_step_in_its_time_constant_and_none_is_none() -> None:
    step = np.ones((50, 2)) * (np.arange(50) > 0)[:, None]
    answer = behind(step, 1e-4, 1e-3)
    assert np.allclose(behind(step, 1e-4, 0.0), step)
    # Straight between its points, the step rises over one interval: the closed form of a ramp, then of a step.
    risen = 1.0 - 10.0 * (1.0 - np.exp(-0.1))
    closed = 1.0 - (1.0 - risen) * np.exp(-0.1 * np.arange(49))
    assert np.allclose(answer[1:, 0], closed) and np.allclose(answer[:, 0], answer[:, 1])


def test_knows_the_drive_that_answers_the_speed(known: Known) -> None:
    true = CubicSpline(known.fine, known.v).antiderivative()
    drive = drive_of([window(known.torque, known.load)], [true])
    assert drive.gain == pytest.approx(GAIN * TRANSMISSION, rel=0.1)
    assert drive.lag == pytest.approx(LAG, rel=0.5)


@pytest.mark.parametrize("lag", [0.0, FILTER])
def test_echo_is_what_another_force_changes(known: Known, lag: float) -> None:
    time, pushed = known.load
    plain = plain_motion(known.speed, TRANSMISSION)
    torques = torque_courses([window(known.torque, known.load)], [plain])
    balance = motor_balance(known.speed, TRANSMISSION, [known.load], torques)
    other = 0.4 * np.exp(-(((time - 0.06) / 0.004) ** 2)) * np.sin(900.0 * time)
    first, second = (
        reconstructed_motion(
            known.speed, TRANSMISSION, as_reported((time, f), lag), torques[0], balance, plain
        )
        for f in (pushed, pushed + other)
    )
    predicted = echo(known.speed, known.load, balance, lag=lag).of(other[None])
    for nu in (0, 1, 2):
        changed = second(time, nu) - first(time, nu)
        assert np.max(np.abs(predicted[nu][0] - changed)) < 0.02 * np.max(np.abs(changed))


def test_an_echo_on_the_same_times_differs_in_size_and_on_others_is_found_again(known: Known) -> None:
    before = echo(known.speed, known.load, Balance(0.7, 0.0))
    (time, pushed), other = known.load, Balance(0.4, 0.0)
    forces = np.random.default_rng(1).normal(0.0, 1.0, (2, len(time)))
    for load in (known.load, (time + 3e-4, pushed)):
        again, anew = echo(known.speed, load, other, before=before), echo(known.speed, load, other)
        assert np.allclose(again.of(forces), anew.of(forces), rtol=1e-12, atol=0.0)
    assert not np.allclose(anew.of(forces), replace(before, size=anew.size).of(forces), rtol=1e-2)
