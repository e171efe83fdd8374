"""When two effects are named that a search for one after the other has missed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.identification import axis_pairs
from service.identification.axis_pairs import with_two
from service.identification.explanation import Candidate
from service.identification.selection import Selection, Trial

GAIN, FORCE, ASYMMETRY = "sensor_gain", "position_dependent_force", "asymmetric_friction"


def trial(left: float, *effects: str, chance: bool = False) -> Trial[Any]:
    """A trial that left so much of all moves, or of held-out blocks that differ by chance."""
    fitted = SimpleNamespace(model=SimpleNamespace(effects=tuple(SimpleNamespace(name=n) for n in effects)))
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
