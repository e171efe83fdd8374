"""The model that is fitted, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from service.identification.axis_simulation import MotorMotion, flank, free_swing, simulate


def still_then(speed: float, n: int, h: float) -> MotorMotion:
    """A motor that turns at constant speed [m/s] from the start of its only window."""
    t = h * np.arange(n)
    return MotorMotion(
        np.zeros(1),
        (speed * t)[:, None, None],
        np.full((n, 1, 1), speed),
        np.zeros((1, 1)),
        np.zeros((1, 1)),
        h,
    )


def parameters(**changed: float) -> dict[str, np.ndarray]:
    usual = {
        "backlash": 1e-4, "contact_stiffness": 4e5, "contact_damping": 60.0, "drive_stiffness": 1e6,
        "drive_damping": 100.0, "drive_mass": 0.04, "coulomb": 0.0, "viscous": 0.0, "turnover_speed": 5e-4,
    }  # fmt: skip
    return {name: np.full((1, 1, 1), value) for name, value in {**usual, **changed}.items()}


def test_the_load_stands_still_until_the_gap_is_crossed() -> None:
    h, speed = 1e-4, 0.01
    v = simulate(still_then(speed, 400, h), parameters(), (), np.zeros((1, 1, 1)))[:, 0, 0, 0]
    first = int(np.argmax(np.abs(v) > 1e-9)) * h
    # half a backlash of 50 µm at 10 mm/s, and a wind-up of the drive of less than a millisecond
    assert first == pytest.approx(5e-3, abs=1e-3)


def test_the_load_ends_up_moving_with_the_motor() -> None:
    v = simulate(still_then(0.01, 8000, 1e-4), parameters(viscous=5.0), (), np.zeros((1, 1, 1)))[:, 0, 0, 0]
    assert v[-500:].mean() == pytest.approx(0.01, rel=0.02)


def test_contact_share_has_no_jump() -> None:
    r = np.linspace(49e-6, 51e-6, 2001)
    depth, share = flank(r, np.full(2001, 0.01), np.full(2001, 5e-5), 1e-4)
    assert np.abs(np.diff(share)).max() < 2e-3
    assert np.abs(np.diff(depth)).max() < 2e-9
    assert depth[0] == 0.0
    assert depth[-1] == pytest.approx(1e-6)


def test_free_swing_is_the_damped_oscillator() -> None:
    f, z = np.array(10.0), np.array(0.05)
    one = free_swing(np.array(1.0), np.array(0.0), f, z, 0.3)
    half = free_swing(*free_swing(np.array(1.0), np.array(0.0), f, z, 0.15), f, z, 0.15)
    assert np.allclose(one, half)
    assert abs(float(one[0])) <= np.exp(-0.05 * 2 * np.pi * 10 * 0.3) * 1.01
