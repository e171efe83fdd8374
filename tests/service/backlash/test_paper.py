"""The paper's method on an ideal axis, whose b, t1 and t2 are known in closed form."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from service.backlash.detection import Pass, find_pass
from service.backlash.estimate import immediate
from service.backlash.integration import parted
from service.backlash.paper import paper
from service.backlash.results import AxisResult, Reason
from service.backlash.signals import axis_signals, step_signals
from service.captures import read_capture
from service.recording import Recording, Trace
from tests.service.backlash.ideal import Run, passing_time, recording


def lose(source: Recording, channel: str, lost: np.ndarray) -> Recording:
    """The recording without the samples where ``lost(time)`` is True."""
    traces = dict(source.traces)
    trace = traces["X1", channel]
    traces["X1", channel] = Trace(trace.time[~lost], trace.value[~lost])
    return replace(source, traces=traces)


def acceleration_time(source: Recording) -> np.ndarray:
    trace = source.trace("X1", "acceleration")
    assert trace is not None
    return trace.time


@pytest.mark.parametrize("b", [15e-6, 50e-6, 120e-6])
@pytest.mark.parametrize("speed_rate", [500.0, 1000.0])
def test_eq_10_is_exact_where_t1_and_t2_are(b: float, speed_rate: float) -> None:
    run = Run(b=b, speed_rate=speed_rate, load_rate=20_000.0)
    source = recording(run)
    signals = axis_signals(source, "X1")
    assert signals is not None
    step = step_signals(signals, 1, source.moves[1])
    assert step is not None
    t0 = step.move.start + step.move.duration / 2
    assert parted(step, t0, t0 + passing_time(run)) == pytest.approx(b, rel=0.01)


@pytest.mark.parametrize("b", [15e-6, 30e-6, 50e-6, 120e-6])
@pytest.mark.parametrize("load_rate", [2000.0, 4000.0])
def test_release_and_impact_are_found_within_a_sample(b: float, load_rate: float) -> None:
    run = Run(b=b, load_rate=load_rate)
    source = recording(run)
    signals = axis_signals(source, "X1")
    assert signals is not None
    step = step_signals(signals, 0, source.moves[0])
    assert step is not None
    found = find_pass(step, noise=0.005)
    assert isinstance(found, Pass)
    t0 = step.move.start + step.move.duration / 2
    assert found.t1 == pytest.approx(t0, abs=1 / run.speed_rate)
    assert found.t2 == pytest.approx(t0 + passing_time(run), abs=1 / run.speed_rate)


@pytest.mark.parametrize("b", [15e-6, 30e-6, 50e-6, 120e-6])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_value_and_interval_of_ten_steps(b: float, noise: float) -> None:
    """Within 10 %, or what 0.4 ms, less than half a sample of the speed, mean for t2: db/b = 3 dt/T."""
    result = paper(recording(Run(b=b, noise=noise, bias=0.1)), "X1")
    assert result.verdict == "ok", result.detail
    resolution = 3 * b * 0.4e-3 / passing_time(Run(b=b))
    assert result.backlash == pytest.approx(b, abs=max(0.1 * b, resolution))
    assert result.interval_95 is not None
    assert result.interval_95[0] <= b <= result.interval_95[1]
    assert [step.direction for step in result.steps] == [1, -1] * 5


def test_the_direction_of_travel_makes_no_difference() -> None:
    source = recording(Run())
    turned = replace(
        source,
        traces={key: Trace(trace.time, -trace.value) for key, trace in source.traces.items()},
        moves=tuple(replace(move, direction=-move.direction) for move in source.moves),
    )
    one, other = paper(source, "X1"), paper(turned, "X1")
    assert one.backlash == pytest.approx(other.backlash, rel=1e-9)
    assert [s.t1 for s in one.steps] == pytest.approx([s.t1 for s in other.steps])


@pytest.mark.parametrize("late", [-2.5e-3, -0.8e-3, 0.8e-3, 2.5e-3])
def test_a_skew_between_the_streams_is_taken_out(late: float) -> None:
    plain = paper(recording(Run(noise=0.02)), "X1")
    skewed = paper(recording(Run(noise=0.02, late=late)), "X1")
    assert skewed.backlash == pytest.approx(plain.backlash, rel=0.1)
    assert skewed.detail is not None
    assert "late" in skewed.detail


@pytest.mark.parametrize("late", [-8e-3, 8e-3, 20e-3])
def test_streams_far_apart_are_refused(late: float) -> None:
    assert paper(recording(Run(noise=0.02, late=late)), "X1").reason is Reason.SIGNALS_DISAGREE


def test_a_sample_lost_in_the_pass_refuses_that_step_only() -> None:
    run = Run(noise=0.02)
    source = recording(run)
    move = source.moves[3]
    inside = move.start + move.duration / 2 + passing_time(run) / 2
    time = acceleration_time(source)
    lost = np.zeros(len(time), bool)
    lost[np.searchsorted(time, inside)] = True
    result = paper(lose(source, "acceleration", lost), "X1")
    assert result.verdict == "ok"
    assert [step.index for step in result.steps if step.reason is Reason.FRAME_LOSS] == [3]
    refused = result.steps[3]
    assert (refused.backlash, refused.t1, refused.t2) == (None, None, None)


def test_samples_lost_elsewhere_cost_nothing() -> None:
    source = recording(Run(noise=0.02))
    time = acceleration_time(source)
    lost = np.zeros(len(time), bool)
    for move in source.moves:
        lost |= (time > move.start + 0.1 * move.duration) & (time < move.start + 0.13 * move.duration)
    whole, holed = paper(source, "X1"), paper(lose(source, "acceleration", lost), "X1")
    assert all(step.verdict == "ok" for step in holed.steps)
    assert holed.backlash == pytest.approx(whole.backlash, rel=0.02)


def test_five_percent_lost_is_never_a_value() -> None:
    source = recording(Run(noise=0.02))
    for seed in range(5):
        lost = np.random.default_rng(seed).random(len(acceleration_time(source))) < 0.05
        assert paper(lose(source, "acceleration", lost), "X1").reason is Reason.FRAME_LOSS


def test_a_recording_cut_short_keeps_the_steps_it_has() -> None:
    source = recording(Run())
    end = source.moves[6].start + 0.02
    cut = replace(source, traces={k: t.between(0.0, end) for k, t in source.traces.items()})
    result = paper(cut, "X1")
    assert result.verdict == "ok"
    assert [step.reason for step in result.steps[6:]] == [Reason.STEP_INCOMPLETE] * 4


def test_two_steps_are_too_few() -> None:
    result = paper(recording(Run(count=2)), "X1")
    assert result.reason is Reason.TOO_FEW_STEPS
    assert result.backlash is None
    assert len(result.steps) == 2


def test_no_gap_is_no_value() -> None:
    result = paper(recording(Run(b=1e-15, noise=0.02)), "X1")
    assert result.reason is Reason.NO_RELEASE


@pytest.mark.parametrize("b", [5e-4, 2e-3])
def test_a_gap_too_wide_for_the_step_is_refused(b: float) -> None:
    result = paper(recording(Run(b=b)), "X1")
    assert result.verdict == "refused"
    assert result.backlash is None


def test_steps_that_measure_different_gaps_disagree() -> None:
    """Halves of two runs with gaps that differ by a factor of five, joined to one."""
    small, large = recording(Run(b=15e-6)), recording(Run(b=75e-6))
    middle = small.moves[5].start - 0.1
    traces = {
        key: Trace(t.time, np.where(t.time < middle, t.value, large.traces[key].value))
        for key, t in small.traces.items()
    }
    assert paper(replace(small, traces=traces), "X1").reason is Reason.STEPS_DISAGREE


def test_one_odd_step_is_left_out() -> None:
    ordinary, odd = recording(Run(b=50e-6)), recording(Run(b=110e-6))
    start, end = ordinary.moves[4].start - 0.05, ordinary.moves[4].end + 0.05
    traces = {
        key: Trace(t.time, np.where((t.time > start) & (t.time < end), odd.traces[key].value, t.value))
        for key, t in ordinary.traces.items()
    }
    result = paper(replace(ordinary, traces=traces), "X1")
    assert result.steps[4].reason is Reason.STEPS_DISAGREE
    assert result.backlash == pytest.approx(paper(ordinary, "X1").backlash, rel=0.01)


def test_every_refusal_says_what_was_seen() -> None:
    source = recording(Run())
    refused: AxisResult = paper(replace(source, moves=()), "X1")
    assert refused.reason is Reason.NO_MOVES
    assert refused.detail
    assert refused.interval_95 is None


def test_each_declared_capture_has_an_answer(shared_dir: Path) -> None:
    files = sorted((shared_dir / "captures").glob("declared-*.parquet"))
    assert len(files) == 8
    for file in files:
        for result in immediate(read_capture(file)):
            assert result.verdict == "ok", f"{file.name} {result.axis}: {result.detail}"
            assert len(result.steps) == 10
