"""The acceleration channel: a clean machine yields nothing, and what is said of it can be stored and drawn."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from service.captures import read_capture
from service.identification.explain import explain
from service.identification.explanation import Accepted


def test_a_clean_machine_yields_nothing(shared_dir: Path) -> None:
    train, validate = (
        read_capture(shared_dir / "captures" / f"none-{part}.parquet") for part in ("train", "validate")
    )
    truth = json.loads((shared_dir / "captures" / "none-truth.json").read_text())["backlash_m"]["X1"]
    told: list[str] = []
    found = explain([train], validate, told.append)
    axis = found.axes[0]
    assert (axis.finding, axis.effects, axis.channel) == ("none", (), "acceleration")
    assert axis.after.validation_rms <= 1.3 * axis.noise_rms
    assert axis.after.backlash == pytest.approx(truth, abs=0.5e-6)
    assert axis.after.interval_95 is not None
    low, high = axis.after.interval_95
    assert low < truth < high
    assert told, "progress is shown where a person waits"
    assert json.loads(json.dumps(found.as_json()))["axes"][0]["candidates"] == []
    rows = found.predictions()
    assert {len(column) for column in rows.values()} == {2 * len(axis.predictions[0].time)}
    measured = dict(
        zip(
            validate.traces["X1", "acceleration"].time,
            validate.traces["X1", "acceleration"].value,
            strict=True,
        )
    )
    errors = [
        measured[t] - v for t, v in zip(axis.predictions[1].time, axis.predictions[1].value, strict=True)
    ]
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(axis.after.validation_rms)


def test_a_late_sensor_is_named_alone_and_the_value_set_right(shared_dir: Path) -> None:
    folder = shared_dir / "captures"
    train, validate = (read_capture(folder / f"sensor_latency-{p}.parquet") for p in ("train", "validate"))
    truth = json.loads((folder / "sensor_latency-truth.json").read_text())
    axis = explain([train], validate).axes[0]
    assert (axis.finding, axis.effects) == ("effect", ("sensor_latency",))
    assert axis.after.validation_rms <= 1.3 * axis.noise_rms < 0.5 * axis.before.validation_rms
    assert axis.parameters["latency_s"].value == pytest.approx(truth["sensors"]["latency_a"], abs=2e-5)
    before, after, b = axis.before.backlash, axis.after.backlash, truth["backlash_m"]["X1"]
    assert before is not None
    assert after is not None
    assert abs(after - b) < 1e-6 < abs(before - b)
    numbers = {name: p.value for name, p in axis.parameters.items()}
    again = explain([train], validate, accepted={"X1": Accepted(("sensor_latency",), numbers)}).axes[0]
    assert (again.finding, again.accepted, again.absent) == ("none", ("sensor_latency",), ())
    assert again.before.backlash == pytest.approx(b, abs=1e-6)


def test_a_search_that_is_cut_short_says_so_and_calls_nothing_sound(shared_dir: Path) -> None:
    folder = shared_dir / "captures"
    train, validate = (read_capture(folder / f"sensor_latency-{p}.parquet") for p in ("train", "validate"))
    axis = explain([train], validate, patience=0.01).axes[0]
    assert (axis.finding, axis.effects) in (("effect", ("sensor_latency",)), ("unknown", ()))
    assert any("the search was ended" in line and "--patience" in line for line in axis.evidence)


def test_what_was_accepted_and_does_not_show_is_said_to_be_absent(shared_dir: Path) -> None:
    folder = shared_dir / "captures"
    train, validate = (read_capture(folder / f"none-{part}.parquet") for part in ("train", "validate"))
    train = replace(train, moves=train.moves[:6])
    axis = explain([train], validate, accepted={"X1": Accepted(("constant_force",))}).axes[0]
    assert (axis.finding, axis.accepted, axis.absent) == ("none", (), ("constant_force",))
