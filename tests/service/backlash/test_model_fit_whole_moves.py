"""Whole moves beside the middle of the steps: when they are asked, and what both say together."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from service.backlash import model_fit
from service.backlash.model_fit import coordinate, doubt, model_fit_axes, step_values
from service.backlash.model_fit_data import Measured, measure
from service.backlash.model_fit_impurities import MESH
from service.backlash.model_fit_interval import linearised
from service.backlash.model_fit_single import single_fit
from service.backlash.model_fit_stages import Outcome
from service.backlash.model_fit_start import closed_form
from service.backlash.model_fit_whole_moves import (
    Estimate,
    estimate,
    linearised_moves,
    together,
    unsure,
    whole_moves,
)
from service.backlash.moves_fit import Fitted
from service.captures import read_capture
from service.recording import Recording

CAPTURE = "declared-single-02"
"""Of the shared single axes one that its noise leaves unsure."""


@pytest.fixture(scope="module")
def recording(request: pytest.FixtureRequest) -> Recording:
    shared: Path = request.getfixturevalue("shared_dir")
    return read_capture(shared / "captures" / f"{CAPTURE}.parquet")


@pytest.fixture(scope="module")
def steps(recording: Recording) -> tuple[Measured, Outcome]:
    """The fit of the middle of the steps."""
    measured = measure(recording, ("X1",), range(len(recording.moves)))
    return measured, single_fit(measured, {"X1": closed_form(recording, "X1")}, model_fit.SINGLE).best


@pytest.fixture(scope="module")
def moves(recording: Recording, steps: tuple[Measured, Outcome]) -> Fitted:
    found = whole_moves(recording, steps[1])
    assert found is not None
    return found


def true_backlash(shared_dir: Path) -> float:
    text = (shared_dir / "captures" / f"{CAPTURE}-truth.json").read_text(encoding="utf-8")
    return float(json.loads(text)["backlash_m"]["X1"])


def test_whole_moves_know_the_backlash_better(
    shared_dir: Path, steps: tuple[Measured, Outcome], moves: Fitted
) -> None:
    """And are right: their interval holds the truth."""
    linear, k = linearised(steps[1].problem, steps[1].fit.point), coordinate(steps[1], 0)
    by_moves = linearised_moves(moves)
    assert unsure(linear, steps[1].fit.misfit, k)
    assert by_moves.covariance[k, k] < 0.8 * linear.covariance[k, k]
    found = estimate(moves, 60)
    assert abs(found.value - true_backlash(shared_dir)) < found.half < 1e-6


def test_the_linearised_moves_are_those_of_the_fit(moves: Fitted) -> None:
    """Its covariance of the shared coordinates is the dense one's, every move's own following."""
    J = moves.slopes.dense()
    whole = np.linalg.inv(J.T @ J + np.eye(J.shape[1]))
    P = len(moves.model.parameters)
    np.testing.assert_allclose(linearised_moves(moves).covariance, whole[:P, :P], rtol=1e-5, atol=1e-12)


def test_the_answer_is_as_right_as_is_asked(shared_dir: Path, recording: Recording) -> None:
    """Of a single axis: 0.3 µm or half a percent."""
    found, true = model_fit_axes(recording, "X1")["X1"], true_backlash(shared_dir)
    assert found.backlash is not None
    assert abs(found.backlash - true) < max(3e-7, 0.005 * true)


def test_a_backlash_that_is_known_well_is_not_asked_of_whole_moves(steps: tuple[Measured, Outcome]) -> None:
    problem, at = steps[1].problem, steps[1].fit.point
    quiet = linearised(replace(problem, noise=0.05 * problem.noise), at)
    assert not unsure(quiet, 1.0, coordinate(steps[1], 0))


def test_two_estimates_that_agree_are_one() -> None:
    assert together(Estimate(5e-5, 2e-7), Estimate(5e-5, 2e-7)) == Estimate(5e-5, pytest.approx(2e-7))


def test_the_surer_of_two_counts_more_and_what_they_differ_by_is_in_the_interval() -> None:
    """Shares of 0.9 and 0.1: mean 10.1, half width 0.9·1 + 0.1·3, and 1.96·√(0.9·0.1² + 0.1·0.9²) apart."""
    found = together(Estimate(10.0, 1.0), Estimate(11.0, 3.0))
    assert found.value == pytest.approx(10.1)
    assert found.half == pytest.approx(np.hypot(1.2, 1.96 * 0.3))


def test_an_impurity_that_whole_moves_do_not_see_is_no_reason_to_refuse(
    steps: tuple[Measured, Outcome], moves: Fitted
) -> None:
    measured, best = steps
    k = [p.name for p in best.problem.model.parameters].index("X1.mesh_1")
    assert best.problem.model.parameters[k].spread == pytest.approx(MESH)
    shared = best.fit.point.shared.copy()
    shared[k] = 3.9
    bent = replace(best, fit=replace(best.fit, point=replace(best.fit.point, shared=shared)))
    each = step_values(best, linearised(best.problem, best.fit.point), 0)
    refusal = doubt(measured, bent, 0, each)
    assert refusal is not None
    assert "mesh of X1" in refusal.detail
    assert doubt(measured, bent, 0, each, moves) is None
