"""Where the model fit starts: what the closed form says of a machine that our own simulator made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from service.backlash.contact_regression import contact_steps
from service.backlash.model_fit_start import closed_form, forces_in_the_gap
from service.dynamics.effects.carriage import ConstantForce
from service.dynamics.parameters import AxisParameters, Friction, Machine
from service.dynamics.simulation import simulate, ten_steps
from service.recording import AxisDescription, Recording, Trace


def recorded(axis: AxisParameters, force: float = 0.0) -> Recording:
    """Four steps at 1 kHz and 2 kHz with the sensor's noise, under a constant force [N]."""
    run = simulate(Machine({"X1": axis}), ten_steps(count=4), effects={"X1": (ConstantForce(value=force),)})
    measured = run.axes["X1"].measured
    load = measured.load_acceleration[1::4]
    noise = np.random.default_rng(5).normal(0.0, 0.05, len(load))
    traces = {
        ("X1", "motor_speed"): Trace(run.time[7::8], measured.motor_speed[7::8]),
        ("X1", "acceleration"): Trace(run.time[1::4], load + noise),
    }
    return Recording("simulated", (AxisDescription("X1", axis.transmission),), traces, run.moves)


@pytest.mark.parametrize("force", [0.0, 250.0, -400.0])
def test_between_the_flanks_only_friction_and_a_constant_force_act(force: float) -> None:
    axis = AxisParameters(b=80e-6, friction_mas=Friction(coulomb=240.0, viscous=300.0))
    friction, constant = forces_in_the_gap(contact_steps(recorded(axis, force), "X1"))
    assert friction is not None and constant is not None
    assert constant == pytest.approx(force / axis.M, abs=0.05)
    assert 240.0 / axis.M < friction < (240.0 + 300.0 * 0.1) / axis.M + 0.1


def test_the_closed_form_says_nothing_of_an_axis_that_was_not_recorded() -> None:
    bare = replace(recorded(AxisParameters()), traces={})
    assert closed_form(bare, "X1").friction is None
