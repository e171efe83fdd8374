"""Where each move of a fit begins, and how its motors follow it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.backlash.moves_fit import Fitted, fit
from service.backlash.moves_point import Point
from service.backlash.moves_predicted import predict
from service.backlash.moves_refined import (
    as_alike_moves,
    best_of_each,
    reconstructed,
    rests_found,
    zeros_alike,
)
from tests.service.identification.with_a_clearance import with_a_clearance


def test_no_motor_follows_a_fit_that_ran_away(found: Fitted, monkeypatch: pytest.MonkeyPatch) -> None:
    """Taking an effect out of a model can leave a machine that cannot be simulated."""
    monkeypatch.setattr("service.dynamics.driven.Course.force", lambda _course: np.full((1, 1, 1, 1), np.nan))
    assert all(now is before for now, before in zip(reconstructed(found), found.moves, strict=True))


def test_the_better_start_is_kept_for_every_move(found: Fitted) -> None:
    worse = found.at.local[0].copy()
    worse[::2, 0] += 0.05
    other = fit(found.moves, found.model, replace(found.at, local=(worse,)), 0)
    mixed = best_of_each((other, fit(found.moves, found.model, found.at, 0)))
    np.testing.assert_allclose(mixed.local[0][::2], found.at.local[0][::2])
    alike = as_alike_moves(found).local[0]
    for s in (1.0, -1.0):
        of = alike[found.moves[0].s == s]
        np.testing.assert_allclose(of, np.tile(of[0], (len(of), 1)))


def test_every_move_begins_like_the_best_described_one_of_its_direction(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        "service.backlash.moves_refined.costs_of_moves", lambda *_: np.array([9.0, 2.0, 1.0, 5.0])
    )
    few = SimpleNamespace(s=np.array([-1.0, 1.0, -1.0, 1.0]))
    local = np.array([[0.1], [0.2], [0.3], [0.4]])
    found = SimpleNamespace(moves=(few,), at=SimpleNamespace(local=(local,)))
    every = SimpleNamespace(s=np.array([1.0, -1.0, 1.0]))
    (own,) = zeros_alike(cast(Any, (every,)), cast(Any, found))
    assert own[:, 0].tolist() == [0.2, 0.3, 0.2]


def test_a_pinion_that_rested_at_the_far_side_of_its_gap_is_found_there(found: Fitted) -> None:
    clearance = 0.6 * found.value("X1.backlash")
    model, at = with_a_clearance(found, clearance)
    (part,), own = found.moves, at.local[0].copy()
    own[:, 2] = -0.5 * clearance / model.nuisance[0].spread
    said = predict(part, model, at.shared[None], own[None]).acceleration()[0]
    made = replace(
        part,
        grids=tuple(replace(g, measured=said[t]) for t, g in enumerate(part.grids)),
        expected=part.expected,
    )
    again = rests_found([made], model, Point(at.shared, (np.zeros_like(own),))).local[0]
    assert np.mean(again[:, 2] == own[0, 2]) >= 0.8
