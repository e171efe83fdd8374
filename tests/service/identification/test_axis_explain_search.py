"""Where the search for what is missing begins, and when nothing is searched."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from service.identification import axis_explain
from service.identification.axis_explain import (
    BEYOND,
    HIDDEN,
    LIMITS,
    OF_HIDDEN,
    OR_HIDDEN,
    heeded,
    missing_in,
)
from service.identification.selection import Selection, Trial


def trial(train: float, held_out: float) -> Trial[Any]:
    return Trial(SimpleNamespace(fitted="fitted"), train, held_out, np.ones(5), np.zeros(0), 100.0)


@pytest.mark.parametrize(
    ("errors", "accepted", "wanders", "asked", "by_motors"),
    [
        ((1.1, 2.4), (), False, ["all"], 1.2),
        ((1.1, 2.4), ("hung_mass_mode",), False, [], 1.2),
        ((1.7, 1.8), ("hung_mass_mode",), False, ["beyond"], 1.2),
        ((1.1, 1.2), ("hung_mass_mode",), True, ["zero"], 1.2),
        ((1.1, 1.2), ("sensor_bias",), True, [], 1.2),
        ((1.7, 1.8), (), True, ["zero", "all"], 1.2),
        ((0.97, 1.22), (), False, ["hidden"], 0.0),
        ((0.97, 1.22), (), False, ["all"], 1.2),
        ((0.97, 1.12), (), False, ["all"], 1.2),
        ((1.1, 1.22), (), False, ["all"], 1.2),
        ((0.97, 1.12), (), False, ["hidden"], 3.0),
        ((1.1, 1.12), (), False, ["all or hidden"], 3.0),
        ((1.6, 1.7), (), False, ["all"], 3.0),
        ((1.1, 1.2), ("hung_mass_mode",), False, [], 3.0),
    ],
)
def test_beyond_what_is_accepted_only_more_than_a_law_leaves_is_searched(
    monkeypatch: pytest.MonkeyPatch,
    errors: tuple[float, float],
    accepted: tuple[str, ...],
    wanders: bool,
    asked: list[str],
    by_motors: float,
) -> None:
    said: list[str] = []

    def searched(_scene: Any, before: Trial[Any], _tell: Any, limits: Any, first: Any = ()) -> Selection[Any]:
        names = {id(LIMITS): "zero" if first else "all", id(BEYOND): "beyond", id(OF_HIDDEN): "hidden"}
        names[id(OR_HIDDEN)] = "all or hidden"
        assert (first == HIDDEN) == (limits is OF_HIDDEN)
        said.append(names[id(limits)])
        return Selection(before, before, (), (), ())

    monkeypatch.setattr(axis_explain, "searched", searched)
    monkeypatch.setattr(axis_explain, "left_by_motors", lambda _fitted: np.array([0.5, 1.0]) * by_motors)
    scene: Any = SimpleNamespace(zero_wanders=wanders)
    found = missing_in(scene, trial(*errors), accepted, lambda _text: None)
    assert said == asked
    assert found.effects == ()


def test_a_second_gap_is_what_a_fit_may_hide() -> None:
    assert [kind.name for kind in HIDDEN] == ["gearbox_clearance"]


@pytest.mark.parametrize(
    ("effects", "held_out", "by_motors", "stays"),
    [
        (("gearbox_clearance",), 0.95, 1.5, True),
        (("gearbox_clearance",), 0.95, 8.0, False),
        (("gearbox_clearance",), 0.80, 8.0, True),
        (("stribeck_friction",), 0.95, 8.0, True),
        ((), 1.0, 10.0, True),
        (("gearbox_clearance",), 0.95, 0.0, True),
    ],
)
def test_what_is_named_for_the_motors_contradiction_must_be_what_they_speak_of(
    monkeypatch: pytest.MonkeyPatch, effects: tuple[str, ...], held_out: float, by_motors: float, stays: bool
) -> None:
    monkeypatch.setattr(axis_explain, "left_by_motors", lambda _fitted: np.array([by_motors]))
    found: Selection[Any] = Selection(trial(1.0, 1.0), trial(1.0, held_out), effects, (), ())
    assert heeded(found, 10.0 if by_motors else 0.0) is stays
