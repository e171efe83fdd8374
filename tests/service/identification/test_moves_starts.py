"""Where fits of an added effect are started, and with how many moves starts are compared."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.backlash.moves import moves_of
from service.backlash.moves_fit import Point, fit, reconstructed
from service.captures import read_capture
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_library import DRIVEN
from service.identification import moves_starts
from service.recording import Move

BACK_AND_FORTH = [(1, 0.0), (-1, 4e-3)] * 5
"""Direction and place [m] of moves of one length at one place."""


def fitted(made: list[tuple[int, float]], rms: float, lengths: tuple[float, ...] = (4e-3,)) -> Any:
    """A fit of such moves, which leaves this RMS."""
    moves = [
        Move(float(k), direction, lengths[k % len(lengths)], 1e3, 0.08)
        for k, (direction, _) in enumerate(made)
    ]
    parts = SimpleNamespace(
        made=moves,
        grids=tuple(SimpleNamespace(index=k) for k in range(len(made))),
        plain=(lambda time: made[int(time)][1],),
        heard={},
    )
    return SimpleNamespace(moves=(cast(Any, parts),), rms=rms)


@pytest.mark.parametrize(
    ("made", "rms", "lengths", "few"),
    [
        (BACK_AND_FORTH, 9.0, (4e-3,), 2),
        (BACK_AND_FORTH, 1.5, (4e-3,), 4),
        (BACK_AND_FORTH, 9.0, (4e-3, 4e-3, 6e-3, 6e-3), 4),
        ([(1, 4e-3 * k) for k in range(10)], 9.0, (4e-3,), 4),
        (BACK_AND_FORTH[:3], 9.0, (4e-3,), 3),
    ],
    ids=["alike", "little is missing", "other lengths", "other places", "three in all"],
)
def test_of_alike_moves_one_is_enough_where_much_is_missing(
    made: list[tuple[int, float]], rms: float, lengths: tuple[float, ...], few: int
) -> None:
    assert moves_starts.how_few(fitted(made, rms, lengths)) == few


def test_moves_made_alike_that_begin_with_other_swings_are_not_alike() -> None:
    heard = fitted(BACK_AND_FORTH, 9.0)
    heard.moves[0].heard = {"body_speed": np.linspace(0.0, 0.01, 10)}
    assert moves_starts.how_few(heard) == 4


def test_an_effect_begun_on_the_present_model_changes_nothing(shared_dir: Path) -> None:
    """At an amount of nothing the few moves are described as they were, also by a machine far from a typical one."""
    moves = moves_of(read_capture(shared_dir / "captures" / "none-train.parquet"), ("X1",))
    model = Model(("X1",), 2, held=("constant", "skew"))
    shared = np.zeros(len(model.parameters))
    shared[[p.name for p in model.parameters].index("X1.gear_mass")] = 4.6
    local = np.random.default_rng(3).normal(0.0, 0.3, (len(moves.grids), 2))
    present = fit([moves], model, Point(shared, (local,)), 0)
    few = moves_starts.fewer(present)
    alone = fit(few, model, Point(shared, (moves_starts.own_of_few(present),)), 0)
    for candidate in moves_starts.candidates(model, [DRIVEN["hung_mass_mode"], DRIVEN["sensor_gain"]], ()):
        begun = moves_starts.added(present, candidate, dict(candidate.effect.starts[0]))
        np.testing.assert_allclose(fit(few, candidate.model, begun, 0).r, alone.r, rtol=1e-6, atol=1e-6)
    few_valleys = [kind for kind in DRIVEN.values() if not kind.many_valleys]
    for candidate in moves_starts.candidates(model, few_valleys, ()):
        strong = {**candidate.effect.starts[0], **{p.name: p.spread for p in candidate.effect.parameters}}
        begun = moves_starts.added(present, candidate, moves_starts.hardly_any(candidate, strong))
        assert fit(few, candidate.model, begun, 0).rms < 1.05 * alone.rms, candidate.name


@pytest.mark.parametrize(
    ("declared", "own", "plain", "on"),
    [
        (3.4, 4.6, 3.8, "plain"),
        (3.4, 3.4, 3.3, "found"),
        (12.9, 12.8, 12.9, "found"),
        (1.1, 4.6, 1.0, "found"),
    ],
)
def test_a_motion_that_a_wrong_force_made_is_not_what_effects_are_compared_on(
    monkeypatch: Any, declared: float, own: float, plain: float, on: str
) -> None:
    """A ripple was hidden by what a chain in a corner made of the motors' motion, with the planted numbers, too. It is
    wrong if the model that it was made for comes nearer without it."""
    fits = {"own": SimpleNamespace(rms=own, name="own"), "plain": SimpleNamespace(rms=plain, name="plain")}
    monkeypatch.setattr(moves_starts, "unanswering", lambda _moves: "own")
    monkeypatch.setattr(moves_starts, "as_measured", lambda _moves: "plain")
    monkeypatch.setattr(moves_starts, "fit", lambda moves, *_: fits[moves])
    found: Any = SimpleNamespace(rms=declared, moves=(), model=None, at=None, name="found")
    assert cast(Any, moves_starts.on_sound_motion(found)).name == on


def test_moves_as_measured_have_no_motion_that_a_model_made(found: Any) -> None:
    answering = reconstructed(found)
    assert answering[0].motion[0] is not answering[0].plain
    measured = moves_starts.as_measured(answering)
    assert all(motion is part.plain for part in measured for motion in part.motion)
    assert all(not part.echoes and part.reference is None for part in measured)
