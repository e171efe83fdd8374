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
    ("before", "tried", "together", "taken"),
    [
        ((1.2, 2.7), BENT, (1.0, 1.0), True),
        ((1.2, 2.7), BENT, (1.2, 1.3), False),
        ((1.2, 2.7), BENT, (1.3, 1.2), False),
        ((1.2, 2.7), BENT, None, False),
        ((1.2, 2.7), RIPPLE, (1.0, 1.0), False),
        ((4.1, 2.7), BENT, (1.0, 1.0), False),
        ((1.2, 4.1), BENT, (1.0, 1.0), False),
    ],
    ids=[
        "leave next to nothing",
        "leave more of others",
        "leave more of what was fitted",
        "out of reach",
        "contact not tried",
        "much is missing",
        "much is missing elsewhere",
    ],
)
def test_a_mesh_error_is_fitted_beside_a_bent_contact_where_both_may_be_all(
    monkeypatch: pytest.MonkeyPatch,
    before: tuple[float, float],
    tried: str,
    together: tuple[float, float] | None,
    taken: bool,
) -> None:
    """Each alone left 1.1 of the noise, as much as before, and both together nothing."""
    bent, present = named(tried, 1.1, 2.1), named("dead_zone", *before)

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
    ("first", "with_both", "asked", "taken"),
    [("unknown", "none", True, True), ("unknown", "unknown", True, False), ("none", "none", False, False)],
)
def test_what_every_sound_machine_has_is_asked_for_where_nothing_else_explains_what_is_missing(
    monkeypatch: pytest.MonkeyPatch, first: str, with_both: str, asked: bool, taken: bool
) -> None:
    before = named("dead_zone", 1.2, 2.7)
    search = alone(before)
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
