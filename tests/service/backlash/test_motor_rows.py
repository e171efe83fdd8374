"""Eq. (1) at the motor as rows of a fit, on motions whose force and torque are given by formula."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from service.backlash.motor_rows import EXACT, OWN, MotorRows, motor_rows
from service.recording import FloatArray, Trace

DURATION, REST, RATIO = 0.08, 0.2, 0.003
FORCE, TORQUE, VISCOUS, COULOMB = 0.8, 1.3, 0.5, 0.1
"""Load over the motor's inertia, m/s² per N m, 1/s and m/s² of the motor's own friction."""
STARTS = tuple(0.3 + k * (DURATION + REST) for k in range(8))
GAP = (0.5, 0.62)
"""Where in a move no flank touches, as shares of it."""


def speed_at(time: FloatArray) -> FloatArray:
    """Of the motor at the output [m/s]: sin² in every move, rest between them."""
    into = (time - STARTS[0]) % (DURATION + REST)
    running = (time > STARTS[0]) & (into < DURATION)
    return np.where(running, 0.08 * np.sin(np.pi * into / DURATION) ** 2, 0.0)


def acceleration_at(time: FloatArray) -> FloatArray:
    """Its derivative [m/s²]."""
    into = (time - STARTS[0]) % (DURATION + REST)
    running = (time > STARTS[0]) & (into < DURATION)
    return np.where(running, 0.08 * np.pi / DURATION * np.sin(2.0 * np.pi * into / DURATION), 0.0)


def touching(time: FloatArray) -> FloatArray:
    """1 where a flank touches, 0 in the gap, smooth between."""
    share = ((time - STARTS[0]) % (DURATION + REST)) / DURATION
    return 1.0 - 0.5 * (np.tanh((share - GAP[0]) / 0.01) - np.tanh((share - GAP[1]) / 0.01))


def force_at(time: FloatArray) -> FloatArray:
    """On the motor per moved mass [m/s²]: a load that the flanks push, and rubs."""
    rubbing = 0.4 * np.tanh(speed_at(time) / 0.002)
    return np.asarray(touching(time) * (acceleration_at(time) + rubbing))


def rows_of_a_motor(
    noise: float,
    told: tuple[float, float] | None = None,
    lost: tuple[float, float] = (0.0, 0.0),
    back: float = 0.0,
    unsure: float = 0.0,
) -> tuple[list[MotorRows], list[FloatArray]]:
    """The rows of all moves, told the true force, and the times of their grids; `noise` of the speed in rad/s, which
    the rows are told, or other noise of speed and torque; samples of the speed `lost` between two times; the motor
    swings `back` after a move, by such a share of it; the force is `unsure` by such a standard deviation [m/s²]."""
    rng = np.random.default_rng(4)
    time = np.arange(0.0, STARTS[-1] + DURATION + REST, 1e-3)
    v = speed_at(time) - back * speed_at(time - DURATION)
    a = acceleration_at(time) - back * acceleration_at(time - DURATION)
    torque = (a + FORCE * force_at(time) + VISCOUS * v + COULOMB * np.sign(v)) / TORQUE
    speed = v / RATIO + noise * rng.standard_normal(len(time))
    grids = [np.arange(start - 0.002, start + DURATION + 0.03, 2.5e-4) for start in STARTS]
    motion = CubicSpline(time, v).antiderivative()
    there = (time < lost[0]) | (time >= lost[1])
    rows = motor_rows(
        Trace(time[there], speed[there]),
        Trace(time, torque),
        np.ones(np.count_nonzero(there)),
        RATIO,
        [(grid, force_at(grid)) for grid in grids],
        [motion] * len(grids),
        noise=told or (noise, 0.0),
        off=[np.full((4, len(grid)), 0.5 * unsure) for grid in grids],
    )
    return rows, grids


def told(rows: list[MotorRows], forces: list[FloatArray], more: list[FloatArray]) -> tuple[float, float]:
    """How much of `more` the force has by the rows, by least squares, and the standard deviation of that."""
    at = np.concatenate([one.of(f[None])[0] for one, f in zip(rows, forces, strict=True)])
    off = np.concatenate(
        [one.of((f + 0.01 * m)[None])[0] for one, f, m in zip(rows, forces, more, strict=True)]
    )
    slope = (off - at) / 0.01
    return -float(slope @ at / (slope @ slope)), float(1.0 / np.sqrt(slope @ slope))


def rms_of(rows: list[MotorRows], forces: list[FloatArray], beside: list[FloatArray] | None = None) -> float:
    """RMS of the rows by forces, or of what they are apart from those by others."""
    parts = [one.of(f[None])[0] for one, f in zip(rows, forces, strict=True)]
    if beside is not None:
        parts = [part - one.of(f[None])[0] for part, one, f in zip(parts, rows, beside, strict=True)]
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def test_nothing_is_left_of_the_balance_with_the_force_that_acted() -> None:
    rows, grids = rows_of_a_motor(0.0003)
    without_the_gap = [force_at(grid) / np.maximum(touching(grid), 1e-3) for grid in grids]
    pulling = [-force_at(grid) for grid in grids]
    none = [np.zeros_like(grid) for grid in grids]
    left = rms_of(rows, [force_at(grid) for grid in grids])
    assert left < 0.2 * rms_of(rows, without_the_gap)
    assert rms_of(rows, pulling) == pytest.approx(rms_of(rows, none))
    assert left < 0.2 * rms_of(rows, none)


def test_the_motors_own_friction_turns_over_where_it_swings_back() -> None:
    rows, _ = rows_of_a_motor(0.003, back=0.3)
    rubbing = rows[0].weight * np.sign(np.gradient(rows[0].place))
    assert min(rubbing) < 0.0 < max(rubbing)
    np.testing.assert_allclose(rows[0].without_own(rubbing[None]), 0.0, atol=1e-9 * max(rubbing))


def test_the_torque_tells_what_rubs_only_where_the_flanks_touch() -> None:
    rows, grids = rows_of_a_motor(0.003)
    forces = [force_at(grid) for grid in grids]
    rubbing = [touching(grid) * np.tanh(speed_at(grid) / 0.002) for grid in grids]
    less = [f - 0.1 * m for f, m in zip(forces, rubbing, strict=True)]
    found, spread = told(rows, less, rubbing)
    assert spread < 0.03, "of a friction of 0.4 m/s²"
    assert found == pytest.approx(0.1, abs=3.5 * spread)


def test_what_the_motor_may_have_of_its_own_is_not_told() -> None:
    rows, grids = rows_of_a_motor(0.003)
    forces = [force_at(grid) for grid in grids]
    as_its_own = [f + 3.0 * speed_at(grid) for f, grid in zip(forces, grids, strict=True)]
    as_the_loads = [f + 3.0 * speed_at(grid) * touching(grid) for f, grid in zip(forces, grids, strict=True)]
    assert rms_of(rows, as_its_own, forces) < 0.05 * rms_of(rows, as_the_loads, forces)


def test_a_force_that_is_zero_or_no_number_leaves_the_motors_own_balance() -> None:
    rows, grids = rows_of_a_motor(0.003)
    forces = np.stack([np.zeros_like(grids[0]), np.full_like(grids[0], np.nan)])
    none, ran_away = rows[0].of(forces)
    np.testing.assert_allclose(none, rows[0].acceleration)
    assert np.any(np.isnan(ran_away))


def test_over_the_noise_the_true_force_leaves_one_and_a_wrong_one_more() -> None:
    """The rows of a move have lost six of its numbers; white noise of the speed is all that is left of the others."""
    rows, grids = rows_of_a_motor(0.01, told=(0.01, 0.0))
    moving = sum(np.count_nonzero(one.weight) for one in rows) - OWN * len(rows)
    share = sum(len(one.weight) for one in rows) / moving
    left = rms_of(rows, [force_at(grid) for grid in grids]) * np.sqrt(share)
    assert left == pytest.approx(1.0, abs=0.1)
    less = [force_at(grid) - 0.4 * touching(grid) * np.tanh(speed_at(grid) / 0.002) for grid in grids]
    assert rms_of(rows, less) * np.sqrt(share) > 1.2


def test_where_the_force_is_hardly_known_the_motor_tells_less() -> None:
    """The balance is off by `FORCE` times what the force is off by, beside what the noise does."""
    for noise in (0.001, 0.01):
        sure, unsure = (rows_of_a_motor(noise, unsure=by)[0] for by in (0.0, 0.5))
        for one, other in zip(sure, unsure, strict=True):
            moving = one.weight > 0.0
            more = other.weight[moving] ** -2 - one.weight[moving] ** -2
            np.testing.assert_allclose(np.sqrt(more), 0.5 * FORCE, rtol=0.1)


def test_over_twice_as_much_is_left_half_as_much_whatever_the_force() -> None:
    rows, grids = rows_of_a_motor(0.01, told=(0.01, 0.0))
    for share in (1.0, 0.6):
        forces = [share * force_at(grid) for grid in grids]
        assert rms_of([one.over(2.0) for one in rows], forces) == pytest.approx(0.5 * rms_of(rows, forces))


def test_a_recording_without_noise_is_trusted_to_a_thousandth() -> None:
    rows, grids = rows_of_a_motor(0.0)
    left = [one.of(force_at(grid)[None])[0] for one, grid in zip(rows, grids, strict=True)]
    assert all(np.all(np.isfinite(part)) for part in left)
    greatest = max(float(np.max(one.weight)) for one in rows)
    assert greatest <= 1.0 / (EXACT * np.sqrt(np.mean(acceleration_at(grids[0]) ** 2)) * 0.9)


def test_a_motor_that_was_hardly_seen_in_a_move_is_not_asked() -> None:
    assert rows_of_a_motor(0.003, lost=(STARTS[2] - 0.01, STARTS[2] + 0.2))[0] == []
