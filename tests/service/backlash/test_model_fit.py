"""The model fit's refusals, and its value on the shared captures against their truth."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from service.backlash.model_fit import StepValues, model_fit, model_fit_axes, wanting
from service.backlash.results import Reason
from service.captures import read_capture
from service.recording import AxisDescription, Move, Recording, Trace


def empty(channels: tuple[str, ...], moves: int = 10, gantry: bool = False) -> Recording:
    """A recording of nothing, with the given channels of X1."""
    trace = Trace(np.arange(0.0, 5.0, 1e-3), np.zeros(5000))
    steps = tuple(Move(0.35 + 0.45 * k, 1, 0.004, 200.0, 0.086) for k in range(moves))
    pairs = (("X1", "X2"),) if gantry else ()
    axes = (AxisDescription("X1", 0.003),)
    return Recording("m", axes, {("X1", c): trace for c in channels}, steps, pairs)


def test_names_the_missing_channel() -> None:
    result = model_fit(empty(("motor_speed",)), "X1")
    assert (result.verdict, result.reason) == ("refused", Reason.CHANNEL_MISSING)


def test_too_few_steps_are_refused() -> None:
    assert model_fit(empty(("motor_speed", "acceleration"), moves=2), "X1").reason is Reason.TOO_FEW_STEPS
    assert model_fit(empty(("motor_speed", "acceleration"), moves=0), "X1").reason is Reason.NO_MOVES


@pytest.mark.parametrize("channel", ["motor_speed", "acceleration"])
@pytest.mark.parametrize("step", [3, 9])
def test_a_run_of_which_a_step_was_not_recorded_is_refused(channel: str, step: int) -> None:
    whole = empty(("motor_speed", "acceleration"))
    trace, move = whole.traces["X1", channel], whole.moves[step]
    kept = (trace.time < move.start + 0.4 * move.duration) | (trace.time > move.end)
    broken = replace(
        whole, traces={**whole.traces, ("X1", channel): Trace(trace.time[kept], trace.value[kept])}
    )
    assert whole.moves_without("X1", channel) == ()
    assert broken.moves_without("X1", channel) == (step,)
    result = model_fit(broken, "X1")
    assert (result.verdict, result.reason) == ("refused", Reason.FRAME_LOSS)
    assert f"Step {step + 1} has hardly any {channel} of X1" in result.detail


def test_one_axis_of_a_gantry_alone_is_refused() -> None:
    result = model_fit(empty(("motor_speed", "acceleration"), gantry=True), "X1")
    assert (result.verdict, result.reason) == ("refused", Reason.GANTRY_PARTNER_MISSING)


def test_single_axis_within_the_goal(shared_dir: Path) -> None:
    path = shared_dir / "captures" / "none-train.parquet"
    truth = json.loads((shared_dir / "captures" / "none-truth.json").read_text())["backlash_m"]["X1"]
    result = model_fit_axes(read_capture(path), "X1")["X1"]
    assert result.verdict == "ok", result.detail
    assert result.backlash == pytest.approx(truth, abs=0.3e-6)
    assert result.interval_95 is not None
    assert result.interval_95[1] - result.interval_95[0] < 1.4e-6
    assert all(step.t1 is not None and step.t2 is not None and step.t1 < step.t2 for step in result.steps)


def test_torque_is_not_needed(shared_dir: Path) -> None:
    truth = json.loads((shared_dir / "captures" / "none-truth.json").read_text())["backlash_m"]["X1"]
    whole = read_capture(shared_dir / "captures" / "none-train.parquet")
    without = replace(whole, traces={k: t for k, t in whole.traces.items() if k[1] != "motor_torque"})
    result = model_fit(without, "X1")
    assert result.backlash == pytest.approx(truth, abs=0.5e-6)


def alone(recording: Recording, axis: str) -> Recording:
    """One axis of a gantry in a recording that knows of no gantry."""
    return replace(
        recording,
        axes=tuple(a for a in recording.axes if a.name == axis),
        gantry=(),
        traces={k: t for k, t in recording.traces.items() if k[0] == axis},
    )


@pytest.mark.parametrize("number", ["00", "02"])
def test_a_gantry_that_was_not_declared_gives_no_wrong_value(shared_dir: Path, number: str) -> None:
    path = shared_dir / "captures" / f"declared-gantry-{number}.parquet"
    truth = json.loads(path.with_name(f"{path.stem}-truth.json").read_text())["backlash_m"]["X1"]
    result = model_fit(alone(read_capture(path), "X1"), "X1")
    if result.interval_95 is None:
        assert result.reason in (Reason.MISFIT, Reason.STEPS_DISAGREE, Reason.INTERVAL_TOO_WIDE)
    else:
        assert result.interval_95[0] <= truth <= result.interval_95[1]


BOTH_WAYS = np.array([1.0, -1.0, 1.0, -1.0])


def crossing(*steps: bool) -> StepValues:
    """Steps of a gap of 50 µm, in some of which the flanks changed sides."""
    at = np.where(steps, 0.02, np.nan)
    return StepValues(np.full(len(at), 5e-5), at - 0.01, at)


@pytest.mark.parametrize(
    ("steps", "reason"),
    [
        (crossing(True, True, True, True), None),
        (crossing(True, False, False, True), None),
        (crossing(True, False, True, False), Reason.GAP_NOT_CROSSED),
        (crossing(False, True, False, False), Reason.GAP_NOT_CROSSED),
        (crossing(False, False, False, False), Reason.GAP_NOT_CROSSED),
    ],
)
def test_a_gantry_crosses_the_gap_both_ways_or_is_refused(steps: StepValues, reason: Reason | None) -> None:
    """The partner may hold the load against one flank; where the gap ends there, the fit cannot know."""
    refusal = wanting(5e-5, 0.5e-6, steps, BOTH_WAYS)
    assert (refusal and refusal.reason) == reason


def test_a_gap_crossed_in_one_direction_is_a_single_axis_gap() -> None:
    assert wanting(5e-5, 0.5e-6, crossing(True, False, True, False)) is None


def test_a_gap_of_less_than_a_micrometre_may_be_flanks_that_never_parted() -> None:
    """A step too slow for its gap of 53 µm was answered by 0.27 ± 0.03 µm."""
    refusal = wanting(0.27e-6, 0.03e-6, crossing(True, True, True, True))
    assert refusal is not None
    assert refusal.reason is Reason.GAP_NOT_CROSSED
    assert wanting(2e-6, 0.03e-6, crossing(True, True, True, True)) is None


def test_a_gantry_moved_in_one_direction_only_needs_no_other() -> None:
    assert wanting(5e-5, 0.5e-6, crossing(True, True), np.array([1.0, 1.0])) is None
