"""Bad input gives a clear error, never a confident name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from service.captures import read_capture
from service.identification.checks import check_recordings
from service.identification.explain import explain
from service.identification.explanation import CannotExplain
from service.recording import Recording, Trace


@pytest.fixture
def pair(shared_dir: Path) -> tuple[Recording, Recording]:
    train, validate = (
        read_capture(shared_dir / "captures" / f"none-{part}.parquet") for part in ("train", "validate")
    )
    return train, validate


def with_trace(recording: Recording, channel: str, trace: Trace) -> Recording:
    return replace(recording, traces={**recording.traces, ("X1", channel): trace})


def test_no_moves(pair: tuple[Recording, Recording]) -> None:
    train, validate = pair
    with pytest.raises(CannotExplain, match="0 diagnostic moves"):
        explain([train], replace(validate, moves=()))


def test_no_train(pair: tuple[Recording, Recording]) -> None:
    with pytest.raises(CannotExplain, match="no train"):
        explain([], pair[1])


def test_flat_channel(pair: tuple[Recording, Recording]) -> None:
    train, validate = pair
    flat = validate.traces["X1", "acceleration"]
    with pytest.raises(CannotExplain, match="flat"):
        explain([train], with_trace(validate, "acceleration", Trace(flat.time, np.zeros(len(flat)))))


def test_two_per_cent_lost(pair: tuple[Recording, Recording]) -> None:
    train, validate = pair
    whole = validate.traces["X1", "acceleration"]
    kept = np.random.default_rng(3).random(len(whole)) > 0.02
    kept[[0, -1]] = True
    with pytest.raises(CannotExplain, match="missing"):
        explain([train], with_trace(validate, "acceleration", Trace(whole.time[kept], whole.value[kept])))


def test_a_move_that_was_not_recorded(pair: tuple[Recording, Recording]) -> None:
    """One of many is a small share of all samples, and still nothing can be said of it."""
    train, validate = pair
    whole, move = validate.traces["X1", "acceleration"], validate.moves[-1]
    kept = (whole.time < move.start + 0.3 * move.duration) | (whole.time > move.end - 0.1 * move.duration)
    broken = with_trace(validate, "acceleration", Trace(whole.time[kept], whole.value[kept]))
    with pytest.raises(CannotExplain, match="hardly any samples in move 10"):
        explain([train], broken)


def test_two_rates(pair: tuple[Recording, Recording]) -> None:
    train, validate = pair
    whole = validate.traces["X1", "acceleration"]
    with pytest.raises(CannotExplain, match="Hz"):
        explain([train], with_trace(validate, "acceleration", Trace(whole.time[::2], whole.value[::2])))


def test_a_drive_that_repeats_its_counts_is_no_repeated_recording(pair: tuple[Recording, Recording]) -> None:
    train, validate = pair
    check_recordings([train], with_trace(validate, "motor_speed", train.traces["X1", "motor_speed"]))


def test_moves_of_train_in_validate(pair: tuple[Recording, Recording]) -> None:
    train, _ = pair
    trace = train.traces["X1", "motor_torque"]
    almost = with_trace(train, "motor_torque", Trace(trace.time, trace.value + 0.01))
    with pytest.raises(CannotExplain, match="repeats"):
        explain([train], almost)


def test_a_sensor_that_stays_at_the_end_of_its_range_repeats_nothing_else(
    pair: tuple[Recording, Recording],
) -> None:
    cut = []
    for recording in pair:
        whole = recording.traces["X1", "acceleration"]
        cut.append(with_trace(recording, "acceleration", Trace(whole.time, np.clip(whole.value, -1.5, 1.5))))
    check_recordings(cut[:1], cut[1])


def test_of_a_sensor_that_was_over_its_range_nothing_is_named(pair: tuple[Recording, Recording]) -> None:
    """What is cut off looks like many an effect."""
    train, validate = pair
    whole = validate.traces["X1", "acceleration"]
    clipped = with_trace(validate, "acceleration", Trace(whole.time, np.clip(whole.value, -1.5, 1.5)))
    (axis,) = explain([train], clipped).axes
    assert axis.finding == "unknown"
    assert axis.effects == ()
    assert "end of its range" in axis.evidence[0]


def test_another_machine(pair: tuple[Recording, Recording]) -> None:
    train, validate = pair
    other = replace(validate, axes=(replace(validate.axes[0], transmission=0.004),))
    with pytest.raises(CannotExplain, match="two different axes"):
        explain([train], other)
