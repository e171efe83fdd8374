"""What makes a fit doubtful, and what is done about it: on a shared capture of a sound machine, against its truth."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from service.backlash import model_fit
from service.backlash.model_fit import SINGLE, StepValues, coordinate, doubt, far_out, sound
from service.backlash.model_fit_data import Measured, measure
from service.backlash.model_fit_problem import Point, fit
from service.backlash.model_fit_single import single_fit
from service.backlash.model_fit_stages import Outcome, Staged
from service.backlash.model_fit_start import closed_form
from service.backlash.results import Reason
from service.captures import read_capture


@pytest.fixture(scope="module")
def staged(shared_dir: Path) -> tuple[Measured, Staged]:
    recording = read_capture(shared_dir / "captures" / "none-train.parquet")
    measured = measure(recording, ("X1",), range(len(recording.moves)))
    return measured, single_fit(measured, {"X1": closed_form(recording, "X1")}, SINGLE)


def with_mesh_error(best: Outcome, u: float) -> Outcome:
    """The fit with the slope of the mesh's error held at u, all others following."""
    problem, at = best.problem, best.fit.point
    k = [p.name for p in problem.model.parameters].index("X1.mesh_1")
    shared = at.shared.copy()
    shared[k] = u
    free = tuple(f and j != k for j, f in enumerate(problem.free))
    return replace(best, fit=fit(replace(problem, free=free), Point(shared, at.local), 8, 0.3))


def poorer(best: Outcome) -> Outcome:
    """A fit that explains less than it has to."""
    return replace(best, fit=cast(Any, replace(best.fit, misfit=1.6, cost=1.6 * best.fit.cost)))


@pytest.mark.parametrize("at_once", [True, False], ids=["at once", "by and by"])
def test_a_fit_far_out_along_a_mesh_error_is_led_back_to_a_sound_machine_near_by(
    staged: tuple[Measured, Staged], shared_dir: Path, monkeypatch: pytest.MonkeyPatch, at_once: bool
) -> None:
    measured, found = staged
    if not at_once:
        monkeypatch.setattr(model_fit, "without_impurities", lambda *_: [poorer(found.best)])
    truth = json.loads((shared_dir / "captures" / "none-truth.json").read_text())["backlash_m"]["X1"]
    away = with_mesh_error(found.best, 3.8)
    k = coordinate(away, 0)
    assert far_out(away.problem.model, away.fit.point.shared) is not None
    best = sound(measured, Staged(away, [away], [])).best
    assert far_out(best.problem.model, best.fit.point.shared) is None
    left = float(best.problem.model.parameters[k].value(best.fit.point.shared[k])) - truth
    assert abs(left) < max(3e-7, 0.005 * truth)


def test_a_fit_that_only_a_mesh_error_explains_stays_doubtful(
    staged: tuple[Measured, Staged], monkeypatch: pytest.MonkeyPatch
) -> None:
    measured, found = staged
    for way in ("without_impurities", "by_and_by"):
        monkeypatch.setattr(model_fit, way, lambda *_: [poorer(found.best)])
    assert sound(measured, found) is found


@pytest.mark.parametrize(("apart", "reason"), [(0.2e-6, None), (3e-6, Reason.STEPS_DISAGREE)])
def test_directions_that_differ_are_a_reason_to_refuse_where_it_matters(
    staged: tuple[Measured, Staged], apart: float, reason: Reason | None
) -> None:
    """Ten steps that scatter by 10 nm: both differences are sure."""
    measured, best = staged[0], staged[1].best
    s, b = best.problem.s, float(best.fit.value(best.problem.model, "X1.backlash"))
    scatter = 1e-8 * np.cos(np.arange(len(s)) // 2)
    refusal = doubt(measured, best, 0, StepValues(b + 0.5 * apart * s + scatter, 0.01 + 0 * s, 0.02 + 0 * s))
    assert (refusal and refusal.reason) == reason
