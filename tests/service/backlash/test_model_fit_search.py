"""The search along the loads' measured motion: gaps found with no guess, on machines simulated with two gaps."""

from __future__ import annotations

import numpy as np
import pytest

from service.backlash.model_fit_data import measure, problem_of
from service.backlash.model_fit_gantry import LITTLE, balanced_fits
from service.backlash.model_fit_stages import backlashes
from service.dynamics.driven_model import Model
from service.dynamics.parameters import AxisParameters, GantryParameters, Machine
from service.dynamics.simulation import simulate, ten_steps
from service.recording import AxisDescription, Recording, Trace


@pytest.mark.parametrize(("first", "second", "k"), [(20e-6, 160e-6, 3e7), (140e-6, 30e-6, 6e6)])
def test_gaps_are_found_from_nothing(first: float, second: float, k: float) -> None:
    axes = {"X1": AxisParameters(b=first), "X2": AxisParameters(b=second, M=330.0)}
    run = simulate(Machine(axes, (GantryParameters("X1", "X2", k=k),)), ten_steps(count=4))
    noise = np.random.default_rng(11)
    traces = {}
    for name in axes:
        measured = run.axes[name].measured
        load = measured.load_acceleration[1::4] + noise.normal(0.0, 0.05, len(run.time[1::4]))
        traces[name, "motor_speed"] = Trace(run.time[7::8], measured.motor_speed[7::8])
        traces[name, "acceleration"] = Trace(run.time[1::4], load)
    described = tuple(AxisDescription(name, axis.transmission) for name, axis in axes.items())
    recording = Recording("simulated", described, traces, run.moves, (("X1", "X2"),))
    model = Model(("X1", "X2"), 1)
    few = problem_of(measure(recording, model.axes, range(4)), model).along_measured()
    found = backlashes(few, balanced_fits(few, LITTLE)[0])
    assert abs(found[0] - first) < max(5e-6, 0.1 * first)
    assert abs(found[1] - second) < max(5e-6, 0.1 * second)
