"""Swapped accelerometers of a gantry: found by the blows, on machines simulated with two different gaps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from service.backlash import pairing
from service.backlash.pairing import clear, explained_exchanged, paired, swapped
from service.backlash.paper import paper
from service.backlash.results import Reason
from service.dynamics.parameters import AxisParameters, GantryParameters, Machine
from service.dynamics.simulation import simulate, ten_steps
from service.recording import AxisDescription, Recording, Trace


@pytest.fixture(scope="module", params=[(20e-6, 90e-6, 5e6), (120e-6, 40e-6, 4e7), (52e-6, 50e-6, 2e7)])
def gantry(request: pytest.FixtureRequest) -> Recording:
    """A simulated gantry with gaps b of both sides and a bridge of stiffness k."""
    first, second, k = request.param
    axes = {"X1": AxisParameters(b=first), "X2": AxisParameters(b=second, M=330.0)}
    run = simulate(Machine(axes, (GantryParameters("X1", "X2", k=k),)), ten_steps(count=4))
    noise = np.random.default_rng(5)
    traces = {}
    for name in axes:
        measured = run.axes[name].measured
        load = measured.load_acceleration[1::4] + noise.normal(0.0, 0.03, len(run.time[1::4]))
        traces[name, "motor_speed"] = Trace(run.time[7::8], measured.motor_speed[7::8])
        traces[name, "acceleration"] = Trace(run.time[1::4], load)
    described = tuple(AxisDescription(name, axis.transmission) for name, axis in axes.items())
    return Recording("simulated", described, traces, run.moves, (("X1", "X2"),))


def with_swapped(source: Recording, channel: str) -> Recording:
    traces = dict(source.traces)
    traces["X1", channel], traces["X2", channel] = traces["X2", channel], traces["X1", channel]
    return replace(source, traces=traces)


@pytest.mark.parametrize("axis", ["X1", "X2"])
def test_sensors_in_their_places_are_accepted(gantry: Recording, axis: str) -> None:
    assert paired(gantry, axis) is None


@pytest.mark.parametrize(("channel", "axis"), [("acceleration", "X1"), ("motor_speed", "X2")])
def test_swapped_sensors_are_refused(gantry: Recording, channel: str, axis: str) -> None:
    """At once for the doubt that they leave, and by name when the machine was asked."""
    exchanged = with_swapped(gantry, channel)
    assert paper(exchanged, axis).reason is Reason.SENSORS_IN_DOUBT
    refusal = swapped(exchanged, ("X1", "X2"))
    assert refusal and refusal.reason is Reason.SENSORS_SWAPPED


def test_the_machine_decides_where_the_blows_leave_a_doubt(gantry: Recording) -> None:
    assert not explained_exchanged(gantry, "X1", "X2")
    assert explained_exchanged(with_swapped(gantry, "acceleration"), "X1", "X2")


def test_a_doubt_is_left_by_steps_that_disagree_or_are_few() -> None:
    assert clear(np.array([-1.0, -1.2, -0.9, -1.1]))
    assert not clear(np.array([-1.0, 1.2, -0.9, 0.6]))
    assert not clear(np.array([-1.0]))
    assert not clear(np.array([1.0, 1.2, 0.9, 1.1]))


def test_without_the_partner_nothing_can_be_said(gantry: Recording) -> None:
    alone = replace(gantry, traces={key: t for key, t in gantry.traces.items() if key[0] == "X1"})
    assert paired(alone, "X1") is None


@pytest.mark.parametrize(
    ("balanced", "simulated", "exchanged", "asked"),
    [
        ((900.0, 300.0), (), True, 0),
        ((300.0, 900.0), (), False, 0),
        (
            (970.0, 1100.0),
            (1090.0, 990.0),
            True,
            2,
        ),  # nearly alike along the measured motion: that decides nothing
        ((1100.0, 970.0), (990.0, 1090.0), False, 2),
    ],
)
def test_where_both_ways_lie_close_the_gantry_is_simulated_both_ways(
    monkeypatch: pytest.MonkeyPatch,
    balanced: tuple[float, float],
    simulated: tuple[float, ...],
    exchanged: bool,
    asked: int,
) -> None:
    costs, closer, closely = iter(balanced), iter(simulated), list[tuple[str, ...]]()

    def simulate(recording: Recording, axes: tuple[str, ...]) -> float:
        closely.append(axes)
        return next(closer)

    monkeypatch.setattr(pairing, "explained", lambda recording, axes: next(costs))
    monkeypatch.setattr(pairing, "explained_closely", simulate)
    trace, axes = Trace(np.zeros(1), np.zeros(1)), ("X1", "X2")
    described = tuple(AxisDescription(axis, 0.005) for axis in axes)
    made = Recording("stood in", described, {(axis, "acceleration"): trace for axis in axes})
    assert explained_exchanged(made, *axes) is exchanged
    assert len(closely) == asked
