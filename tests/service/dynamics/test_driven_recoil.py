"""A motor that gives way: eq. (1) beside its recorded motion, in the model and at the grid's points."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from service.dynamics.driven import Response, simulate
from service.dynamics.driven_model import Model
from service.dynamics.driven_motion import coefficients, plain_motion
from service.dynamics.driven_recoil import Recoil
from service.recording import FloatArray, Trace

H, K, SHARE = 1.25e-4, 400, 1.4


def response(rate: float, share: float = SHARE) -> Response:
    """One step of an axis with one lump through release and impact, its motor giving way."""
    t = np.arange(-0.02, 0.11, 1e-3)
    position = plain_motion(Trace(t, 0.1 * np.sin(np.pi * np.clip(t, 0.0, 0.085) / 0.085) ** 2), 1.0)
    values = {"backlash": 60e-6, "contact_stiffness": 9e5, "contact_damping_ratio": 0.06, "coulomb": 0.3}
    values |= {"viscous": 0.8, "constant": 0.0, "skew": 0.0}
    values |= {"drive_stiffness": 2e6, "drive_damping_ratio": 0.03, "drive_mass": 0.1}
    free = {f"X1.{name}": np.array([value]) for name, value in values.items()}
    load = np.array([float(position(0.01)) - 35e-6, float(position(0.01, 1))]).reshape(1, 1, 1, 2)
    c = coefficients(position, 0.01, H, K)[None, None, :, None]
    model = Model(("X1",), 1, effects=(Recoil(("X1",), (share,), rate),))
    return simulate(model, free, c, np.ones(1), load, H)


def course(found: Response) -> FloatArray:
    """Position and speed of the recoil (K + 1, 2)."""
    assert found.recoil is not None
    return found.recoil[0, 0, 0]


def test_a_motor_that_nothing_holds_goes_where_the_force_drives_it() -> None:
    found = response(rate=0.0)
    momentum = -SHARE * cumulative_trapezoid(found.force[0, 0, 0], dx=H, initial=0.0)
    speed = course(found)[:, 1]
    assert np.ptp(found.force) > 4.0, "the flanks change sides"
    assert np.max(np.abs(speed - momentum)) < 2e-3 * np.max(np.abs(speed))


@pytest.mark.parametrize("rate", [200.0, 1500.0])
def test_a_held_motor_follows_its_law_at_the_grid(rate: float) -> None:
    found, recoil = response(rate), Recoil(("X1",), (SHARE,), rate)
    ours = recoil.under(found.force[0, 0, 0], 0, H)
    theirs = course(found)
    size = np.max(np.abs(theirs), axis=0)
    assert np.all(size > 0.0)
    assert np.all(np.max(np.abs(ours - theirs), axis=0) < 0.02 * size)


def test_its_course_is_one_motion() -> None:
    """Acceleration and position are the derivative and the integral of the speed."""
    found, recoil = response(800.0), Recoil(("X1",), (SHARE,), 800.0)
    x, v, a = np.moveaxis(recoil.course(course(found)[None], found.force[0, 0])[0], -1, 0)
    assert np.max(np.abs(x - cumulative_trapezoid(v, dx=H, initial=0.0))) < 0.01 * np.max(np.abs(x))
    assert np.max(np.abs(v - cumulative_trapezoid(a, dx=H, initial=0.0))) < 0.01 * np.max(np.abs(v))


def test_without_mass_on_it_the_motor_stays() -> None:
    still = response(800.0, share=0.0)
    assert np.all(course(still) == 0.0)
