"""What every sound machine has, in company."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from service.identification import axis_explain, moves_sound
from service.identification.moves_sound import with_impurities
from service.identification.selection import Selection, Trial
from tests.service.identification.a_selection import trial

BENT, RIPPLE = "contact_nonlinearity", "transmission_ripple"
ANY: Any = None


def named(name: str, train: float, held_out: float) -> Trial[Any]:
    fitted = SimpleNamespace(model=SimpleNamespace(effects=(SimpleNamespace(name=name),)))
    return replace(trial(train, held_out), model=SimpleNamespace(fitted=fitted))


def quiet(_text: str) -> None:
    """Nobody waits."""


def alone(before: Trial[Any], *tried: Trial[Any]) -> Selection[Any]:
    """A search that took nothing of what it tried."""
    return Selection(before, before, (), (), (), tried=tried)


@pytest.mark.parametrize(
    ("before", "together", "taken"),
    [
        ((1.2, 2.7), (1.0, 1.0), True),
        ((1.2, 2.7), (1.2, 1.3), False),
        ((1.2, 2.7), (1.3, 1.2), False),
        ((1.2, 2.7), None, False),
        ((4.1, 2.7), (1.0, 1.0), False),
        ((1.2, 4.1), (1.0, 1.0), False),
    ],
    ids=[
        "leave next to nothing",
        "leave more of others",
        "leave more of what was fitted",
        "out of reach",
        "much is missing",
        "much is missing elsewhere",
    ],
)
def test_a_mesh_error_is_fitted_beside_a_bent_contact_where_both_may_be_all(
    monkeypatch: pytest.MonkeyPatch,
    before: tuple[float, float],
    together: tuple[float, float] | None,
    taken: bool,
) -> None:
    """Each alone left 1.1 of the noise, as much as before, and both together nothing."""
    bent, present = named(BENT, 1.1, 2.1), named("dead_zone", *before)

    def propose(
        _scene: Any, library: Any, begun: Trial[Any], beside: Any, _tell: Any
    ) -> dict[str, Trial[Any]]:
        assert begun is bent
        assert beside == (BENT,)
        assert [kind.name for kind in library] == [RIPPLE]
        return {RIPPLE: named(RIPPLE, *together)} if together else {}

    monkeypatch.setattr(moves_sound, "propose", propose)
    search = alone(present, bent, named("sensor_gain", 1.2, 2.6))
    out = with_impurities(ANY, present, search, quiet)
    if taken:
        assert out.effects == (BENT, RIPPLE)
        assert (out.after.train_rms, out.after.validation_rms) == together
        assert (out.before, out.tried) == (present, search.tried)
    else:
        assert out is search


@pytest.mark.parametrize(
    ("bent", "ripple", "leads", "begun"),
    [
        ((1.1, 1.5), (1.3, 1.4), RIPPLE, [BENT, RIPPLE]),
        ((1.1, 1.5), (1.3, 1.4), BENT, [BENT]),
        ((1.2, 1.7), (1.3, 1.4), RIPPLE, [RIPPLE]),
        ((1.1, 1.5), (1.3, 1.4), None, [BENT, RIPPLE]),
    ],
    ids=["the farther one leads to both", "the nearer one does", "the mesh error is nearer", "none does"],
)
def test_the_nearer_of_both_is_begun_with_and_the_other_where_that_leads_nowhere(
    monkeypatch: pytest.MonkeyPatch,
    bent: tuple[float, float],
    ripple: tuple[float, float],
    leads: str | None,
    begun: list[str],
) -> None:
    """A mesh error has been taken, and ended nearer than it was when it was tried."""
    asked = list[str]()
    ended, both = named(RIPPLE, *ripple), named("both", 1.0, 1.0)

    def propose(_scene: Any, library: Any, start: Trial[Any], beside: Any, _tell: Any) -> Any:
        (name,), (kind,) = beside, library
        assert {name, kind.name} == {BENT, RIPPLE}
        assert start is ended if name == RIPPLE else start.train_rms == bent[0]
        asked.append(name)
        return {kind.name: both} if name == leads else {}

    monkeypatch.setattr(moves_sound, "propose", propose)
    present = named("dead_zone", 1.4, 1.6)
    tried = (named(BENT, *bent), named(RIPPLE, 2.0, 2.0))
    search = Selection(present, ended, (RIPPLE,), (), (), tried=tried)
    out = with_impurities(ANY, present, search, quiet)
    assert asked == begun
    if leads:
        assert (out.after, set(out.effects)) == (both, {BENT, RIPPLE})
    else:
        assert out is search


@pytest.mark.parametrize(
    ("first", "effects", "left", "with_both", "asked", "taken"),
    [
        ("unknown", (), 2.7, "none", True, True),
        ("unknown", (), 2.7, "unknown", True, False),
        ("none", (), 2.7, "none", False, False),
        ("none", (RIPPLE,), 1.35, "none", True, True),
        ("none", (RIPPLE,), 1.2, "none", False, False),
        ("effect", (RIPPLE,), 1.35, "none", False, False),
    ],
    ids=["unknown", "still unknown", "nothing", "a part of it", "all of it", "a finding"],
)
def test_what_every_sound_machine_has_is_asked_for_where_nothing_else_explains_what_is_missing(
    monkeypatch: pytest.MonkeyPatch,
    first: str,
    effects: tuple[str, ...],
    left: float,
    with_both: str,
    asked: bool,
    taken: bool,
) -> None:
    before = named("dead_zone", 1.2, 2.7)
    search = replace(alone(before), effects=effects, after=named("last", 1.1, left))
    both = replace(search, effects=(BENT, RIPPLE))
    said = list[str]()

    def impurities(*_: Any) -> Selection[Any]:
        said.append("asked")
        return both

    monkeypatch.setattr(axis_explain, "selected", lambda *_: search)
    monkeypatch.setattr(axis_explain, "in_company", lambda *_: search)
    monkeypatch.setattr(axis_explain, "with_impurities", impurities)
    monkeypatch.setattr(
        axis_explain, "finding_of", lambda selection: (with_both if selection is both else first, ())
    )
    before.model.fitted.model.effects = ()
    out = axis_explain.searched(ANY, before, quiet, axis_explain.LIMITS)
    assert out is (both if taken else search)
    assert bool(said) == asked
