"""The value of a recording by a model with an accepted effect."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from service.captures import read_capture
from service.identification import revise
from service.identification.explanation import CannotExplain
from service.identification.revise import revised_values


def test_the_value_with_the_effect_is_that_of_the_machine_and_another_search_may_begin_with_its_fit(
    shared_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = shared_dir / "captures"
    truth = json.loads((folder / "constant_force-truth.json").read_text())["backlash_m"]["X1"]
    run, other = (read_capture(folder / f"constant_force-{part}.parquet") for part in ("train", "validate"))
    search, ended = revise._searched, []

    def kept(scene: revise.Scene, effects: Sequence[str]) -> revise.Fitted:
        ended.append(search(scene, effects))
        return ended[-1]

    monkeypatch.setattr(revise, "_searched", kept)
    found = revised_values(other, ("X1",), ("constant_force",))["X1"]
    assert found.explained
    assert found.backlash == pytest.approx(truth, abs=1e-6)
    low, high = found.interval_95
    assert low < truth < high

    noise_of_run = revise._scene(run, ("X1",)).validate.noise[0]

    def lost(scene: revise.Scene, _: Sequence[str]) -> revise.Fitted:
        """The search for the run ends nowhere, the one for the other recording where it should."""
        return next(revise.declared_fits(scene)) if scene.validate.noise[0] == noise_of_run else ended[0]

    monkeypatch.setattr(revise, "_searched", lost)
    assert not revised_values(run, ("X1",), ("constant_force",))["X1"].explained
    found = revised_values(run, ("X1",), ("constant_force",), [other])["X1"]
    assert found.explained
    assert found.backlash == pytest.approx(truth, abs=1e-6)


def test_the_wrong_effect_leaves_too_much(shared_dir: Path) -> None:
    recording = read_capture(shared_dir / "captures" / "sensor_latency-train.parquet")
    few = replace(recording, moves=recording.moves[:3])
    found = revised_values(few, ("X1",), ("sensor_gain",))
    assert not found["X1"].explained


def test_an_effect_without_a_model_of_moves_is_refused(shared_dir: Path) -> None:
    recording = read_capture(shared_dir / "captures" / "none-train.parquet")
    with pytest.raises(CannotExplain, match="lost_motion"):
        revised_values(recording, ("X1",), ("lost_motion",))
