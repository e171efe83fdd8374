"""When two effects are named that a search for one after the other has missed."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.identification import axis_pairs
from service.identification.axis_pairs import with_hidden, with_two
from service.identification.explanation import Candidate
from service.identification.selection import Selection, Trial

GAIN, FORCE, ASYMMETRY = "sensor_gain", "position_dependent_force", "asymmetric_friction"
CLEARANCE = "gearbox_clearance"


def trial(left: float, *effects: str, chance: bool = False, motors: float = 1.0) -> Trial[Any]:
    """A trial that left so much of all moves, or of held-out blocks that differ by chance, and of its motors."""
    model = SimpleNamespace(effects=tuple(SimpleNamespace(name=n) for n in effects))
    fitted = SimpleNamespace(model=model, left_by_motors=np.array([motors]))
    blocks = left**2 * (np.random.default_rng(1).exponential(size=40) if chance else np.ones(40))
    return Trial(SimpleNamespace(fitted=fitted), left, left, blocks, np.zeros(0), 5.0 if chance else 4000.0)


BEFORE = trial(9.0)
UNKNOWN = Selection(
    BEFORE,
    trial(5.0, "curved_friction"),
    ("curved_friction",),
    (
        Candidate("curved_friction", 5.0, 1e-9, True, "significant"),
        Candidate(GAIN, 8.0, 1.0, False, "no gain"),
    ),
    (),
)


def asked(
    monkeypatch: pytest.MonkeyPatch,
    trials: list[Trial[Any]],
    spared: dict[str, float],
    reconciled: bool = True,
) -> Selection[Any]:
    monkeypatch.setattr(axis_pairs, "pairs", lambda *_: trials)
    monkeypatch.setattr(axis_pairs, "reconciled", lambda *_: reconciled)
    others = {GAIN: FORCE, FORCE: GAIN}
    monkeypatch.setattr(axis_pairs, "without", lambda _scene, _trial, name: trial(spared[name], others[name]))
    return with_two(cast(Any, None), BEFORE, UNKNOWN, (), lambda _text: None)


def test_two_of_which_neither_can_be_spared_are_named_the_stronger_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = asked(monkeypatch, [trial(1.0, GAIN, FORCE)], {GAIN: 4.0, FORCE: 6.0})
    assert found.effects == (FORCE, GAIN)
    assert found.after.train_rms == 1.0
    assert [(c.effect, c.accepted) for c in found.candidates] == [
        ("curved_friction", False),
        (FORCE, True),
        (GAIN, True),
    ]


def test_one_of_them_is_named_where_the_other_can_be_spared(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked(monkeypatch, [trial(1.0, GAIN, FORCE)], {GAIN: 1.01, FORCE: 6.0})
    assert found.effects == (FORCE,)
    assert found.after.train_rms == 1.01


@pytest.mark.parametrize(
    ("trials", "spared", "reconciled"),
    [
        ([], {}, True),
        ([trial(1.0, GAIN, FORCE)], {GAIN: 4.0, FORCE: 6.0}, False),
        ([trial(1.0, GAIN, FORCE)], {GAIN: 1.3, FORCE: 6.0}, True),
    ],
    ids=["no two are all", "the motors do not agree", "one hardly matters, and is missing without it"],
)
def test_else_it_is_unknown_as_before(
    monkeypatch: pytest.MonkeyPatch, trials: list[Trial[Any]], spared: dict[str, float], reconciled: bool
) -> None:
    assert asked(monkeypatch, trials, spared, reconciled) is UNKNOWN


def test_what_chance_may_do_is_not_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(axis_pairs, "gain_p_value", lambda *_: 1e-3)
    assert asked(monkeypatch, [trial(1.0, GAIN, FORCE)], {GAIN: 4.0, FORCE: 6.0}) is UNKNOWN


@pytest.mark.parametrize(
    ("other", "left", "rivals"),
    [
        ((GAIN, ASYMMETRY), 1.01, ((FORCE, ASYMMETRY),)),
        ((GAIN, ASYMMETRY), 1.1, ()),
        (("sensor_latency", ASYMMETRY), 1.01, ()),
    ],
    ids=["as near in its place", "farther off", "two others"],
)
def test_what_explains_the_moves_as_well_beside_the_same_effect_cannot_be_told_apart(
    monkeypatch: pytest.MonkeyPatch,
    other: tuple[str, str],
    left: float,
    rivals: tuple[tuple[str, str], ...],
) -> None:
    found = asked(monkeypatch, [trial(1.0, GAIN, FORCE), trial(left, *other)], {GAIN: 4.0, FORCE: 6.0})
    assert found.rivals == rivals


def hides(
    monkeypatch: pytest.MonkeyPatch,
    found: Selection[Any],
    after: Trial[Any] | None = None,
    spared: float = 5.0,
    leads: bool = True,
    finding: str = "effect",
    nothing: bool = True,
) -> tuple[Selection[Any], list[Trial[Any]]]:
    """What is found with what hides, which the motors speak of if a trial `after` it is given, and the trials that were
    asked for it."""
    asked: list[Trial[Any]] = []

    def hidden(_scene: Any, before: Trial[Any], *_: Any) -> Selection[Any]:
        asked.append(before)
        said = Candidate(CLEARANCE, 1.0, 1e-9, after is not None, "what the motors say")
        names = (CLEARANCE,) if after else ()
        return Selection(before, after or before, names, (said,), (), witnessed=names)

    monkeypatch.setattr(axis_pairs, "left_by_motors", lambda fitted: fitted.left_by_motors)
    monkeypatch.setattr(axis_pairs, "finding_of", lambda one: (finding, one.effects))
    monkeypatch.setattr(axis_pairs, "nothing_left", lambda _fitted: nothing)
    monkeypatch.setattr(axis_pairs, "may_lead", lambda *_: leads)
    monkeypatch.setattr(axis_pairs, "hidden", hidden)
    monkeypatch.setattr(axis_pairs, "without", lambda *_: trial(spared, CLEARANCE))
    kinds = cast(Any, (SimpleNamespace(name=CLEARANCE),))
    return with_hidden(cast(Any, None), found, kinds, lambda _text: None), asked


def with_gain(left: float = 1.1, motors: float = 4.0, *more: str) -> Selection[Any]:
    said = (Candidate(GAIN, left, 1e-9, True, "significant"),)
    return Selection(BEFORE, trial(left, GAIN, *more, motors=motors), (GAIN, *more), said, ())


@pytest.mark.parametrize(
    ("left", "spared", "effects"), [(1.0, 5.0, (GAIN, CLEARANCE)), (0.8, 1.08, (CLEARANCE, GAIN))]
)
def test_a_gap_that_the_motors_speak_of_is_named_beside_what_was_found(
    monkeypatch: pytest.MonkeyPatch, left: float, spared: float, effects: tuple[str, ...]
) -> None:
    both = trial(left, GAIN, CLEARANCE)
    found, asked = hides(monkeypatch, alone := with_gain(), both, spared)
    assert asked == [alone.after]
    assert found.effects == effects
    assert found.after is both
    assert found.before is BEFORE
    assert [(c.effect, c.accepted) for c in found.candidates] == [(GAIN, True), (CLEARANCE, True)]


@pytest.mark.parametrize(
    ("alone", "leads", "times"),
    [
        (with_gain(motors=1.4), True, 0),
        (with_gain(left=1.2), True, 0),
        (with_gain(1.1, 4.0, CLEARANCE), True, 0),
        (replace(with_gain(), effects=(), after=BEFORE), True, 0),
        (with_gain(), False, 0),
        (with_gain(), True, 1),
    ],
    ids=[
        "motors agree",
        "more is missing",
        "it is in the model",
        "nothing was found",
        "it comes no nearer to a few moves",
        "asked for, and not there",
    ],
)
def test_else_what_was_found_stays(
    monkeypatch: pytest.MonkeyPatch, alone: Selection[Any], leads: bool, times: int
) -> None:
    found, asked = hides(monkeypatch, alone, leads=leads)
    assert len(asked) == times
    assert replace(found, candidates=()) == replace(alone, candidates=())


def test_a_gap_is_named_alone_where_what_was_found_can_be_spared(monkeypatch: pytest.MonkeyPatch) -> None:
    found, _ = hides(monkeypatch, with_gain(), trial(1.0, GAIN, CLEARANCE), spared=1.02)
    assert (found.effects, found.witnessed, found.before) == ((CLEARANCE,), (CLEARANCE,), BEFORE)
    assert found.after.train_rms == 1.02
    assert [(c.effect, c.accepted) for c in found.candidates] == [(GAIN, False), (CLEARANCE, True)]


def test_what_hardly_matters_beside_a_gap_and_is_missing_without_it_is_unclear(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    alone = with_gain()
    found, _ = hides(monkeypatch, alone, trial(1.0, GAIN, CLEARANCE), spared=1.3)
    assert found is alone


def test_two_that_are_no_finding_together_are_not_named(monkeypatch: pytest.MonkeyPatch) -> None:
    alone = with_gain()
    found, _ = hides(monkeypatch, alone, trial(1.0, GAIN, CLEARANCE), finding="unknown")
    assert found is alone


def test_a_gap_beside_another_effect_leaves_nothing_of_samples_and_motors(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Beside a lopsided friction it was named for a flank that is preloaded, and its backlash was 17 um off."""
    alone = with_gain()
    found, _ = hides(monkeypatch, alone, trial(1.0, GAIN, CLEARANCE), nothing=False)
    assert (found.effects, found.after) == (alone.effects, alone.after)
    assert [(c.effect, c.accepted) for c in found.candidates] == [(GAIN, True), (CLEARANCE, False)]
