"""Skew and softness, against machines simulated with a known clock offset."""

from __future__ import annotations

import numpy as np
import pytest

from service.backlash.alignment import SMALLEST, lag, softness
from service.backlash.detection import Pass, find_pass, run_noise
from service.backlash.signals import StepSignals, axis_signals, step_signals
from service.dynamics.parameters import AxisParameters
from service.dynamics.simulation import Simulation, simulate, ten_steps
from service.recording import AxisDescription, Recording, Trace


@pytest.fixture(scope="module", params=[20e-6, 150e-6])
def simulated(request: pytest.FixtureRequest) -> Simulation:
    return simulate(AxisParameters(b=request.param), ten_steps(count=3))


def steps_of(run: Simulation, late: float) -> list[StepSignals]:
    """The steps as signals, the accelerometer's stamps being late [s]."""
    measured, transmission = run.axes["X1"].measured, AxisParameters().transmission
    noise = np.random.default_rng(9).normal(0.0, 0.05, len(run.time) // 2)
    traces = {
        ("X1", "motor_speed"): Trace(run.time[7::8], measured.motor_speed[7::8]),
        ("X1", "acceleration"): Trace(run.time[1::2] + late, measured.load_acceleration[1::2] + noise),
    }
    source = Recording("simulated", (AxisDescription("X1", transmission),), traces, run.moves)
    signals = axis_signals(source, "X1")
    assert signals is not None
    steps = [step_signals(signals, index, move) for index, move in enumerate(source.moves)]
    return [step for step in steps if step is not None]


def passes_of(steps: list[StepSignals]) -> dict[int, Pass]:
    noise = run_noise(steps)
    found = {step.index: find_pass(step, noise) for step in steps}
    return {index: pass_ for index, pass_ in found.items() if isinstance(pass_, Pass)}


@pytest.mark.parametrize("late", [-4e-3, -1e-3, 0.0, 1e-3, 4e-3])
def test_the_lag_is_found_roughly_at_first(simulated: Simulation, late: float) -> None:
    assert lag(steps_of(simulated, late)) == pytest.approx(late, abs=0.6e-3)


def test_the_lag_is_found_within_what_is_left_alone(simulated: Simulation) -> None:
    steps = steps_of(simulated, 0.0)
    assert abs(lag(steps, passes_of(steps))) < SMALLEST


def test_softness_is_mass_over_stiffness(simulated: Simulation) -> None:
    """The stiffnesses of shafts and flanks in series at the output, and the load's mass."""
    p = AxisParameters()
    shaft = p.k_mg / p.transmission**2
    pinion = p.k_gp / (p.D_p / 2) ** 2
    c = p.M * (1 / shaft + 1 / pinion + 1 / p.k_p)
    steps = steps_of(simulated, 0.0)
    found = passes_of(steps)
    assert softness([(step, found[step.index]) for step in steps]) == pytest.approx(c, rel=0.25)


def test_no_steps_tell_nothing() -> None:
    assert lag([]) == 0.0
    assert softness([]) == 0.0
