"""When another effect is asked for beside what was found."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from service.identification import axis_pairs
from service.identification.axis_pairs import with_another, with_bias_seen
from service.identification.axis_selected import ANOTHER, SEEN_BESIDE
from service.identification.explanation import Candidate
from service.identification.selection import Selection, Trial
from tests.service.identification.a_search import trial


def with_effects(train: float, held_out: float, *names: str) -> Trial[Any]:
    """A trial with effects, by name."""
    one = trial(train, held_out)
    one.model.fitted = SimpleNamespace(
        model=SimpleNamespace(effects=[SimpleNamespace(name=n) for n in names])
    )
    return one


def found_beside(
    monkeypatch: pytest.MonkeyPatch, name: str, after: Trial[Any] | None
) -> list[tuple[Any, Any, list[str]]]:
    """What is asked for beside what was found: from which trial, with which limits, which kinds after what; `name` is
    found and leads to `after`, or nothing."""
    said: list[tuple[Any, Any, list[str]]] = []

    def propose(_scene: Any, kinds: Any, _present: Any, taken: Any, _tell: Any) -> list[str]:
        return [*taken, "then", *(kind.name for kind in kinds)]

    def selected(_scene: Any, begun: Any, proposed: Any, _tell: Any, limits: Any) -> Selection[Any]:
        said.append((begun, limits, proposed(begun, ())))
        told = (Candidate(name, 1.0, 1e-9, after is not None), Candidate("other", 1.0, 1.0))
        return Selection(begun, after or begun, (name,) if after else (), told, ())

    monkeypatch.setattr(axis_pairs, "propose", propose)
    monkeypatch.setattr(axis_pairs, "selected", selected)
    monkeypatch.setattr(axis_pairs, "finding_of", lambda found: ("effect", found.effects))
    return said


@pytest.mark.parametrize(
    ("wanders", "effects", "asked"),
    [
        (True, ("sensor_filter",), True),
        (False, ("sensor_filter",), False),
        (True, (), False),
        (True, ("sensor_filter", "sensor_bias"), False),
    ],
    ids=["beside another", "it stays", "nothing was found", "it was found"],
)
@pytest.mark.parametrize("there", [True, False])
def test_a_zero_that_wanders_at_rest_is_asked_for_beside_what_was_found(
    monkeypatch: pytest.MonkeyPatch, wanders: bool, effects: tuple[str, ...], asked: bool, there: bool
) -> None:
    after, both = with_effects(1.7, 1.7, *effects), trial(1.0, 1.0)
    said = found_beside(monkeypatch, "sensor_bias", both if there else None)
    scene: Any = SimpleNamespace(zero_wanders=wanders)
    refused = Candidate("sensor_bias", 2.0, 1.0)
    first = Selection(trial(9.0, 9.0), after, effects, (refused,), ())
    found = with_bias_seen(scene, first, lambda _text: None)
    assert said == ([(after, SEEN_BESIDE, [*effects, "then", "sensor_bias"])] if asked else [])
    if not (asked and there):
        assert found is first
        return
    assert (found.effects, found.after, found.before) == ((*effects, "sensor_bias"), both, first.before)
    assert [(c.effect, c.accepted) for c in found.candidates] == [("sensor_bias", True)]


@pytest.mark.parametrize(
    ("left", "leaves", "asked", "named"),
    [
        ((1.6, 1.7), (1.0, 1.1), True, True),
        ((1.6, 1.7), (1.0, 1.2), True, False),
        ((1.6, 1.7), None, True, False),
        ((1.2, 3.0), (1.0, 1.1), False, False),
        ((3.0, 1.2), (1.0, 1.1), False, False),
    ],
    ids=[
        "both describe all moves",
        "something is left",
        "nothing is found",
        "the moves that were fitted are described",
        "the others are described",
    ],
)
def test_what_one_effect_leaves_may_be_another(
    monkeypatch: pytest.MonkeyPatch,
    left: tuple[float, float],
    leaves: tuple[float, float] | None,
    asked: bool,
    named: bool,
) -> None:
    first = Selection(trial(9.0, 9.0), trial(*left), ("machine_body_mode",), (), ())
    said = found_beside(monkeypatch, "stribeck_friction", trial(*leaves) if leaves else None)
    library: Any = [SimpleNamespace(name=n) for n in ("machine_body_mode", "stribeck_friction")]
    found = with_another(cast(Any, None), first, library, lambda _text: None)
    assert said == (
        [(first.after, ANOTHER, ["machine_body_mode", "then", "stribeck_friction"])] if asked else []
    )
    assert found.effects == ("machine_body_mode", *(["stribeck_friction"] if named else []))
    assert (found is first) is not named


def test_nothing_is_asked_for_beside_what_is_no_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    first = Selection(trial(9.0, 9.0), trial(1.6, 1.7), ("machine_body_mode",), (), ())
    said = found_beside(monkeypatch, "stribeck_friction", trial(1.0, 1.0))
    monkeypatch.setattr(axis_pairs, "finding_of", lambda _found: ("unknown", ()))
    assert with_another(cast(Any, None), first, (), lambda _text: None) is first
    assert said == []
