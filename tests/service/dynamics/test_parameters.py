"""Parameters: what they refuse, and how shaft values are referred to the output side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from service.dynamics.axis import axis_mechanism
from service.dynamics.parameters import (
    AxisParameters,
    ControllerParameters,
    Friction,
    GantryParameters,
    Machine,
    tuned_controller,
)


@pytest.mark.parametrize("name", ["J_mot", "J_g", "J_p", "i", "D_p", "k_mg", "k_gp", "k_p", "M"])
@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf")])
def test_what_must_be_positive_is_named(name: str, bad: float) -> None:
    with pytest.raises(ValueError, match=rf"AxisParameters\.{name} must be a positive number"):
        replace(AxisParameters(), **{name: bad})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"b": -1e-6}, r"b must be a number not below zero"),
        ({"b": 57.1}, r"b must be below 0.006 m \(a backlash, in metres\)"),
        ({"UL": -1e-6}, r"UL must be between 0 and b"),
        ({"UL": 51e-6, "b": 50e-6}, r"UL must be between 0 and b = 5e-05 m"),
        ({"d_p": -1.0}, r"d_p must be a number not below zero"),
    ],
)
def test_impossible_axes_are_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(AxisParameters(), **change)


def test_impossible_frictions_controllers_gantries_and_machines_are_refused() -> None:
    with pytest.raises(ValueError, match=r"Friction\.coulomb must be a number not below zero"):
        Friction(coulomb=-1.0)
    with pytest.raises(ValueError, match=r"ControllerParameters\.Kp must be a positive number"):
        ControllerParameters(Kv=60.0, Kp=0.0)
    with pytest.raises(ValueError, match=r"speed_feedforward must be between 0 and 1"):
        ControllerParameters(Kv=60.0, Kp=1.0, speed_feedforward=1.1)
    with pytest.raises(ValueError, match="another axis than the first"):
        GantryParameters("X1", "X1")
    with pytest.raises(ValueError, match="names axis 'X2', the machine has X1"):
        Machine({"X1": AxisParameters()}, (GantryParameters("X1", "X2"),))
    axes = {name: AxisParameters() for name in ("X1", "X2", "X3")}
    with pytest.raises(ValueError, match="'X2' belongs to more than one gantry"):
        Machine(axes, (GantryParameters("X1", "X2"), GantryParameters("X2", "X3")))
    with pytest.raises(ValueError, match="at least one axis"):
        Machine({})


@pytest.mark.parametrize(("UL", "LL"), [(None, -30e-6), (0.0, -60e-6), (60e-6, 0.0)])
def test_flank_distances_span_the_backlash(UL: float | None, LL: float) -> None:
    """The paper's fig. 2: centred by default, or lying on one flank."""
    p = AxisParameters(b=60e-6, UL=UL)
    assert p.lower_limit == pytest.approx(LL, abs=1e-18)
    assert p.upper_limit - p.lower_limit == pytest.approx(60e-6, rel=1e-12)


def test_kinetic_energy_is_the_same_at_the_shafts_and_on_the_output_side() -> None:
    p = AxisParameters()
    v = 0.1
    motor, pinion = v / p.transmission, v / (p.D_p / 2)
    shafts = (p.J_mot + p.J_g) * motor**2 + p.J_p * pinion**2 + p.M * v**2
    m = axis_mechanism("X1", p)
    assert np.sum(m.M) * v**2 == pytest.approx(shafts, rel=1e-12)
    assert p.inertia * motor**2 == pytest.approx(shafts, rel=1e-12)


def test_static_deflection_under_a_holding_motor_is_that_of_springs_in_series() -> None:
    """A force on the carriage winds up contact, gearbox and coupling; each shaft turns by torque/stiffness."""
    p = AxisParameters()
    m = axis_mechanism("X1", p)
    contact = m.contacts[0]
    K = (m.K + contact.k * np.outer(contact.row, contact.row))[1:, 1:]
    F = 1000.0
    x = np.linalg.solve(K, [0.0, 0.0, F])
    torque_pinion = F * p.D_p / 2
    torque_motor = torque_pinion / p.i
    expected = F / p.k_p + torque_pinion / p.k_gp * p.D_p / 2 + torque_motor / p.k_mg * p.transmission
    assert x[-1] == pytest.approx(expected, rel=1e-12)


def test_tuned_controller_scales_with_the_inertia() -> None:
    light, heavy = AxisParameters(M=200.0), AxisParameters(M=600.0)
    assert tuned_controller(heavy).Kp / tuned_controller(light).Kp == pytest.approx(
        heavy.inertia / light.inertia
    )
    own = ControllerParameters(Kv=30.0, Kp=1.0)
    assert AxisParameters(controller=own).ppi is own
    assert AxisParameters().ppi == tuned_controller(AxisParameters())
