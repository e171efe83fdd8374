"""What every sound machine has, in company."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from service.identification import axis_explain, moves_sound
from service.identification.axis_selected import LIMITS
from service.identification.moves_repeated import PureError
from service.identification.moves_sound import with_impurities
from service.identification.selection import Selection, Trial
from tests.service.identification.a_search import motors_leave
from tests.service.identification.a_selection import trial

BENT, RIPPLE = "contact_nonlinearity", "transmission_ripple"
ANY: Any = None


def named(name: str, train: float, held_out: float) -> Trial[Any]:
    fitted = SimpleNamespace(model=SimpleNamespace(effects=(SimpleNamespace(name=name),)))
    return replace(trial(train, held_out), model=SimpleNamespace(fitted=fitted))


def quiet(_text: str) -> None:
    """Nobody waits."""


@pytest.mark.parametrize(
    ("before", "together", "taken"),
    [
        ((1.2, 2.7), (1.0, 1.0), True),
        ((1.2, 2.7), (1.1, 1.12), True),
        ((1.2, 2.7), (1.0, 1.2), False),
        ((1.2, 2.7), (1.2, 1.0), False),
        ((1.1, 1.1), (1.09, 1.02), False),
        ((1.1, 1.1), (1.02, 1.09), False),
        ((1.1, 1.1), (1.02, 1.02), True),
    ],
    ids=[
        "leave nothing",
        "leave next to nothing",
        "leave more of others",
        "leave more of what was fitted",
        "take little from what was fitted",
        "take little from others",
        "take most of little",
    ],
)
def test_a_mesh_error_is_fitted_beside_a_bent_contact_where_both_may_be_all(
    monkeypatch: pytest.MonkeyPatch,
    before: tuple[float, float],
    together: tuple[float, float],
    taken: bool,
) -> None:
    """The contact alone leaves as much as the model before."""
    present, bent, both = named("dead_zone", *before), named(BENT, *before), named(RIPPLE, *together)

    def roughly(_scene: Any, begun: Trial[Any], kind: Any, beside: Any) -> Trial[Any]:
        assert (begun, beside) == ((present, ()) if kind.name == BENT else (bent, (BENT,)))
        return bent if kind.name == BENT else both

    monkeypatch.setattr(moves_sound, "roughly", roughly)
    out = with_impurities(ANY, present, quiet)
    assert out.before is present
    if taken:
        assert (out.after, out.effects) == (both, (BENT, RIPPLE))
        assert [(one.effect, one.accepted) for one in out.candidates] == [(BENT, False), (RIPPLE, False)]
    else:
        assert (out.after, out.effects, out.candidates) == (present, (), ())


@pytest.mark.parametrize("before", [(4.1, 2.7), (1.2, 4.1)])
def test_more_than_impurities_leave_is_not_judged(before: tuple[float, float]) -> None:
    present = named("dead_zone", *before)
    assert with_impurities(ANY, present, quiet) == Selection(present, present, (), (), ())


@pytest.mark.parametrize(
    ("before", "first", "with_both", "asked", "taken"),
    [
        ((1.7, 2.7), "unknown", "none", True, True),
        ((1.7, 2.7), "unknown", "unknown", True, False),
        ((1.7, 2.7), "none", "none", False, False),
        ((1.7, 2.7), "effect", "none", False, False),
        ((1.2, 2.7), "unknown", "none", False, False),
        ((1.5, 2.7), "unknown", "none", True, True),
    ],
    ids=[
        "unknown",
        "still unknown",
        "nothing",
        "a finding",
        "little, and judged before",
        "little, and smooth effects suffice",
    ],
)
def test_what_every_sound_machine_has_is_asked_for_where_nothing_else_explains_what_is_missing(
    monkeypatch: pytest.MonkeyPatch,
    before: tuple[float, float],
    first: str,
    with_both: str,
    asked: bool,
    taken: bool,
) -> None:
    present = named("dead_zone", *before)
    search = Selection(present, present, (), (), ())
    both = replace(search, effects=(BENT, RIPPLE))
    said = list[str]()

    def impurities(*_: Any) -> Selection[Any]:
        said.append("asked")
        return both

    monkeypatch.setattr(axis_explain, "selected", lambda *_: search)
    monkeypatch.setattr(axis_explain, "with_another", lambda *_: search)
    monkeypatch.setattr(axis_explain, "with_two", lambda *_: search)
    monkeypatch.setattr(axis_explain, "in_company", lambda *_: search)
    monkeypatch.setattr(axis_explain, "with_impurities", impurities)
    monkeypatch.setattr(
        axis_explain, "finding_of", lambda selection: (with_both if selection is both else first, ())
    )
    present.model.fitted.model.effects = ()
    scene: Any = SimpleNamespace(smooth_left=1.05)
    out = axis_explain.searched(scene, present, quiet, LIMITS)
    assert out is (both if taken else search)
    assert bool(said) == asked


@pytest.mark.parametrize(
    ("errors", "motors", "finding", "nearer", "found", "asked"),
    [
        ((1.1, 2.4), (1.2, 1.2), "none", True, True, ["impurities"]),
        ((1.1, 2.4), (0.0, 0.0), "none", True, True, ["impurities"]),
        ((0.97, 1.1), (1.2, 1.2), "none", True, False, ["all"]),
        ((1.7, 2.4), (1.2, 1.2), "none", True, False, ["all"]),
        ((1.1, 4.1), (1.2, 1.2), "none", True, False, ["all"]),
        ((1.1, 2.4), (1.2, 1.2), "unknown", True, False, ["impurities", "all"]),
        ((1.1, 1.1), (3.0, 1.4), "none", True, True, ["impurities"]),
        ((1.1, 1.1), (3.0, 2.2), "none", False, True, ["impurities"]),
        ((1.1, 1.1), (3.0, 2.2), "none", True, False, ["impurities", "all"]),
    ],
    ids=[
        "all there is",
        "no torque",
        "next to nothing is missing",
        "much is missing",
        "much is missing elsewhere",
        "more than a sound machine has",
        "the motors agree",
        "nothing hides",
        "something may hide",
    ],
)
def test_where_little_is_missing_what_every_sound_machine_has_may_be_all(
    monkeypatch: pytest.MonkeyPatch,
    errors: tuple[float, float],
    motors: tuple[float, float],
    finding: str,
    nearer: bool,
    found: bool,
    asked: list[str],
) -> None:
    """It describes all moves here; `motors` are left by the model before and with it."""
    before, after = named("dead_zone", *errors), named(RIPPLE, 1.0, 1.05)
    left = {id(before): motors[0], id(after): motors[1]}
    for one in (before, after):
        one.model.fitted = one
    said: list[str] = []

    def impurities(*_: Any) -> Selection[Any]:
        said.append("impurities")
        return Selection(before, after, (BENT, RIPPLE), (), ())

    def searched(*_: Any, **__: Any) -> Selection[Any]:
        said.append("all")
        return Selection(before, before, (), (), ())

    monkeypatch.setattr(axis_explain, "pure_error", lambda _fitted: PureError(3.0, 1.0))
    monkeypatch.setattr(axis_explain, "with_impurities", impurities)
    monkeypatch.setattr(axis_explain, "leads", lambda *_: nearer)
    monkeypatch.setattr(axis_explain, "searched", searched)
    monkeypatch.setattr(axis_explain, "contradicted", searched)
    monkeypatch.setattr(axis_explain, "beyond_motors", lambda _scene, _before, found, *_: found)
    monkeypatch.setattr(axis_explain, "finding_of", lambda _found: (finding, ()))
    motors_leave(monkeypatch, lambda of: np.array([0.5, 1.0]) * left[id(of)])
    scene: Any = SimpleNamespace(zero_wanders=False, smooth_left=np.inf)
    out = axis_explain.missing_in(scene, before, (), quiet)
    assert said == asked
    assert out.effects == ((BENT, RIPPLE) if found else ())
