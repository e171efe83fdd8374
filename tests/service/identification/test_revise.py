"""The value of a recording by a model with an accepted effect."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from service.captures import read_capture
from service.identification.explanation import CannotExplain
from service.identification.revise import revised_values


def test_the_value_with_the_effect_is_that_of_the_machine(shared_dir: Path) -> None:
    folder = shared_dir / "captures"
    truth = json.loads((folder / "constant_force-truth.json").read_text())["backlash_m"]["X1"]
    found = revised_values(
        read_capture(folder / "constant_force-validate.parquet"), ("X1",), ("constant_force",)
    )
    assert found["X1"].explained
    assert found["X1"].backlash == pytest.approx(truth, abs=1e-6)
    low, high = found["X1"].interval_95
    assert low < truth < high


def test_the_wrong_effect_leaves_too_much(shared_dir: Path) -> None:
    recording = read_capture(shared_dir / "captures" / "sensor_latency-train.parquet")
    few = replace(recording, moves=recording.moves[:5])
    found = revised_values(few, ("X1",), ("sensor_gain",))
    assert not found["X1"].explained


def test_an_effect_without_a_model_of_moves_is_refused(shared_dir: Path) -> None:
    recording = read_capture(shared_dir / "captures" / "none-train.parquet")
    with pytest.raises(CannotExplain, match="lost_motion"):
        revised_values(recording, ("X1",), ("lost_motion",))
