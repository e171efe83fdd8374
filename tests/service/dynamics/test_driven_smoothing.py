"""The motor between its samples, from speeds and torques together, against a motor that is known everywhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from service.dynamics.driven_motion import plain_motion
from service.dynamics.driven_smoothing import (
    Around,
    Spreads,
    around,
    balanced,
    between,
    cumulative,
    likeliest,
    reconstructed,
)
from service.recording import FloatArray, Trace

PHI, PSI, RATIO = 1.4, 1.6, 0.003
"""Moved mass over the motor's inertia; acceleration per torque [m/s² per N m]; transmission [m/rad]."""

NOISE = Spreads(1e-5, 0.015, 1e-8)


@dataclass(frozen=True)
class Known:
    """Around a step: the grid [s], true speed and acceleration, the force, and 500 Hz samples with their noise."""

    grid: FloatArray
    speed: FloatArray
    force: FloatArray
    sampled: Trace
    torque: Trace


def force_at(t: FloatArray) -> FloatArray:
    """A flank's swing at 190 Hz after a blow at 21.3 ms [m/s²]."""
    since = np.maximum(t - 0.0213, 0.0)
    return 2.0 - 4.0 * (1.0 - np.exp(-60.0 * since) * np.cos(2.0 * np.pi * 190.0 * since)) * (since > 0.0)


def torque_at(t: FloatArray) -> FloatArray:
    """What torque and friction accelerate the motor with: slow, and what a controller makes of the swing [m/s²]."""
    since = np.maximum(t - 0.0219, 0.0)
    swing = np.exp(-60.0 * since) * (1.0 - np.cos(2.0 * np.pi * 190.0 * since)) * (since > 0.0)
    return 3.0 * np.cos(2.0 * np.pi * 11.0 * t) + 0.8 * swing


def known(seed: int = 4) -> Known:
    fine = np.arange(-400, 6400) * 1e-5
    v = 0.05 + np.concatenate(([0.0], np.cumsum(1e-5 * (torque_at(fine) - PHI * force_at(fine))[1:])))
    rng = np.random.default_rng(seed)
    t, grid = np.arange(0.0, 0.06, 2e-3) + 3e-4, np.arange(0.0, 0.056, 2.5e-4)
    speed = np.interp(t, fine, v) + NOISE.speed * rng.standard_normal(len(t))
    torque = (torque_at(t) + 0.3 + NOISE.torque * rng.standard_normal(len(t))) / PSI
    return Known(grid, np.interp(grid, fine, v), force_at(grid), Trace(t, speed / RATIO), Trace(t, torque))


def step_of(k: Known, torque: bool = True) -> Around:
    return around(k.sampled, RATIO, k.torque if torque else None, k.grid)


def begin() -> Spreads:
    return Spreads(NOISE.speed, NOISE.torque, 10.0 * NOISE.speed)


def error(k: Known, torque: bool) -> float:
    """RMS of the speed [m/s] away from the grid's ends, of the reconstruction."""
    step = step_of(k, torque)
    spreads = likeliest([step], [k.force], NOISE, begin())
    balance = balanced([step], [k.force], spreads)
    nothing = np.zeros((len(k.grid), 3))
    plain = plain_motion(k.sampled, RATIO)
    position = reconstructed(step, k.force, spreads, balance, nothing, plain)
    inner = slice(12, -12)
    return float(np.sqrt(np.mean((position(k.grid[inner], 1) - k.speed[inner]) ** 2)))


def test_is_far_nearer_than_a_spline_of_the_speed() -> None:
    k = known()
    plain = plain_motion(k.sampled, RATIO)
    splined = float(np.sqrt(np.mean((plain(k.grid[12:-12], 1) - k.speed[12:-12]) ** 2)))
    assert error(k, torque=True) < 0.1 * splined
    assert error(k, torque=True) < 4.0 * NOISE.speed


def test_needs_no_torque_but_is_better_with_it() -> None:
    k = known()
    assert error(k, torque=True) < error(k, torque=False)


def test_finds_what_is_moved_and_how_strong_the_motor_is() -> None:
    many = [known(seed) for seed in range(5)]
    steps, forces = [step_of(k) for k in many], [k.force for k in many]
    spreads = likeliest(steps, forces, NOISE, begin())
    found = balanced(steps, forces, spreads)
    assert found.force == pytest.approx(PHI, rel=0.03)
    assert found.torque == pytest.approx(PSI, rel=0.03)
    assert spreads.torque < 3.0 * NOISE.torque, "both channels agree"


def test_a_torque_that_does_not_belong_to_the_motor_is_hardly_believed() -> None:
    k = known()
    strange = Trace(k.torque.time, k.torque.value + 0.3 * np.sin(400.0 * k.torque.time))
    step = around(k.sampled, RATIO, strange, k.grid)
    assert likeliest([step], [k.force], NOISE, begin()).torque > 4.0 * NOISE.torque


def test_integrates_cubics_exactly() -> None:
    t = np.arange(30) * 0.1
    integral = cumulative(t**3 - t**2, 0.1)
    inner = integral[1:-1] - integral[1]
    assert np.allclose(inner, (t**4 / 4 - t**3 / 3)[1:-1] - (t**4 / 4 - t**3 / 3)[1], atol=1e-12)


def test_reads_between_the_points_by_the_cubic() -> None:
    t = np.arange(9) * 0.5
    place = np.array([0.0, 1.3, 4.75, 8.0])
    assert np.allclose(between(t**3, 3.0 * t**2, 0.5, place), (0.5 * place) ** 3, atol=1e-12)
