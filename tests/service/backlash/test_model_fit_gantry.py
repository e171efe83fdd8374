"""The joint fit of a gantry: against the truth of a shared capture, and with motors whose distance wanders."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from service.backlash import model_fit, model_fit_gantry
from service.backlash.model_fit import model_fit_axes
from service.backlash.results import Reason
from service.captures import read_capture
from service.recording import Recording

WANDERED = 1.5e-6


def wandering(recording: Recording, axis: str) -> Recording:
    """The recording with a speed in every second rest that moves the integrated position by WANDERED [m]."""
    speed = recording.traces[axis, "motor_speed"]
    value = speed.value.copy()
    for move in recording.moves[1::2]:
        rest = (speed.time > move.start - 0.2) & (speed.time < move.start - 0.1)
        value[rest] += WANDERED / 0.1 / recording.axis(axis).transmission
    return replace(recording, traces={**recording.traces, (axis, "motor_speed"): replace(speed, value=value)})


def test_wandering_distance_of_the_motors_is_no_backlash(shared_dir: Path) -> None:
    path = shared_dir / "captures" / "declared-gantry-02.parquet"
    truth = json.loads((shared_dir / "captures" / "declared-gantry-02-truth.json").read_text())["backlash_m"]
    results = model_fit_axes(wandering(read_capture(path), "X1"), "X1")
    for axis, result in results.items():
        assert result.backlash is not None, result.detail
        assert np.abs(result.backlash - truth[axis]) < max(1e-6, 0.02 * truth[axis])
        assert result.interval_95 is not None
        assert result.interval_95[1] - result.interval_95[0] < 5e-6


def test_a_gantry_that_one_search_does_not_solve_is_answered(shared_dir: Path) -> None:
    path = shared_dir / "captures" / "declared-gantry-01.parquet"
    truth = json.loads((shared_dir / "captures" / "declared-gantry-01-truth.json").read_text())["backlash_m"]
    for axis, result in model_fit_axes(read_capture(path), "X2").items():
        assert result.verdict == "ok", result.detail
        assert result.backlash is not None
        assert abs(result.backlash - truth[axis]) < max(0.5e-6, 0.01 * truth[axis])


def test_where_no_start_comes_near_no_motor_follows_and_the_run_is_refused(monkeypatch: Any) -> None:
    """Forces of a fit that ran away are no numbers: nothing is computed from them."""
    away = cast(Any, SimpleNamespace(problem=None, fit=SimpleNamespace(misfit=1e16, cost=np.inf, point=None)))
    monkeypatch.setattr(model_fit_gantry, "settled", lambda *_: (None, None))
    monkeypatch.setattr(model_fit_gantry, "passes", lambda *_: [away])
    found = model_fit_gantry.over_all_steps(*cast(Any, (None, None, None)), model_fit.GANTRY, cast(Any, None))
    assert found == [away]
    monkeypatch.setattr(model_fit, "unexplained", lambda *_: np.nan)
    monkeypatch.setattr(model_fit, "far_out", lambda *_: "")
    refusal = model_fit.doubt(*cast(Any, (None, away, 0, None)))
    assert refusal is not None
    assert refusal.reason == Reason.MISFIT
    assert "No fit came near" in refusal.detail
