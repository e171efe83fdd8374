"""How a search for what is missing goes on from a first look."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.backlash.moves import moves_of
from service.backlash.moves_fit import fit
from service.backlash.moves_point import Point
from service.captures import read_capture
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_library import DRIVEN
from service.identification import moves_search
from service.identification.selection import Trial, gain_p_value
from tests.service.identification.a_search import stub


@pytest.mark.usefixtures("sound")
@pytest.mark.parametrize(
    ("base", "few", "worth"),
    [(1.4, 1.3, 1.3 * moves_search.HARDLY_NEARER), (1.4, 1.1, np.inf), (1.1, 1.3, np.inf)],
)
def test_what_explains_nothing_of_a_few_moves_is_not_fitted_to_all(
    monkeypatch: Any, base: float, few: float, worth: float
) -> None:
    """Unless these few are described, so that what is missing shows in others."""
    monkeypatch.setattr(moves_search, "on_a_few_moves", lambda _found: stub(few))
    assert moves_search.worth_all_moves(stub(base)) == worth


@pytest.mark.usefixtures("sound")
@pytest.mark.parametrize(
    ("base", "fits", "led"),
    [
        (2.7, {"best": 0.95, "far": 1.8, "near": 1.3}, ["near"]),
        (2.7, {"best": 1.20, "far": 1.8, "near": 1.6}, ["best", "far", "near"]),
        (9.0, {"best": 1.20, "far": 1.8, "near": 1.25}, ["far"]),
    ],
    ids=["one describes them", "none does", "on the motion of a wrong force"],
)
def test_fits_are_led_across_samples_where_that_may_tell_which_is_the_right_one(
    monkeypatch: Any, base: float, fits: dict[str, float], led: list[str]
) -> None:
    across = list[str]()
    monkeypatch.setattr(moves_search, "fit", lambda _moves, _model, at, _rounds: at.found)
    monkeypatch.setattr(moves_search, "across", lambda f: across.append(f.name) or f)
    found = {name: stub(rms, name) for name, rms in fits.items()}
    for one in found.values():
        one.at.found = one
    moves_search.fitted_on(stub(base), found, [])
    assert sorted(across) == led


@pytest.mark.parametrize(
    ("train", "reached", "own"),
    [(9.0, 9.5, False), (9.0, 8.5, True), (1.4, 1.5, True)],
    ids=["no nearer", "nearer", "little shows"],
)
def test_what_comes_no_nearer_says_of_other_moves_what_the_present_model_does(
    monkeypatch: Any, train: float, reached: float, own: bool
) -> None:
    there = SimpleNamespace(held="the present prediction")
    present = Trial(cast(Any, there), train, 40.0, np.ones(3), np.zeros(0), 30.0)
    monkeypatch.setattr(moves_search, "trial_of", lambda _scene, _found, thorough: "its own trial")
    monkeypatch.setattr(moves_search, "judged_rms", lambda found: found.rms)
    trial = moves_search.tried_first(cast(Any, None), cast(Any, present), stub(reached))
    assert (trial == "its own trial") == own
    if not own:
        assert (trial.train_rms, trial.validation_rms) == (reached, 40.0)
        assert trial.model.fitted.rms == reached
        assert trial.model.held == "the present prediction"
        assert gain_p_value(cast(Any, present), trial) > 0.4


def test_the_present_model_is_challenged_where_the_best_ended_with_gear_and_pinion_apart(
    shared_dir: Path, monkeypatch: Any
) -> None:
    """A pair of axes is searched with one mass per drive, and only what is near is parted."""
    moves = moves_of(read_capture(shared_dir / "captures" / "none-train.parquet"), ("X1",))
    held = ("constant", "skew")
    now, best = (
        Model(("X1",), lumps, effects, held=held)
        for lumps, effects in ((1, ()), (2, (DRIVEN["hung_mass_mode"](("X1",)),)))
    )
    shared = np.linspace(-0.5, 0.5, len(best.parameters))
    local = np.full((len(moves.grids), 2 * len(best.axes) + len(best.nuisance)), 0.1)
    other = fit([moves], best, Point(shared, (local,)), 0)
    sharpened = replace(moves, expected=3.0 * moves.expected, judged=moves.expected)
    other = replace(other, moves=(sharpened,))
    begun: list[Any] = []
    weighed: list[Any] = []

    def refit(parts: Any, model: Model, at: Point, _rounds: int) -> Any:
        begun.append((model, at))
        weighed.extend(parts)
        return stub(9.0)

    def begun_at(_moves: Any, model: Model, values: Any, *locals_: Any) -> Point:
        return Point(np.array([p.internal(values[p.name]) for p in model.parameters]), locals_[0])

    monkeypatch.setattr(moves_search, "fit", refit)
    monkeypatch.setattr(moves_search, "begun_at", begun_at)
    fitted = SimpleNamespace(model=now, rms=3.0, moves=(moves,))
    present = cast(Any, SimpleNamespace(model=SimpleNamespace(fitted=fitted)))
    better = cast(Any, SimpleNamespace(model=SimpleNamespace(fitted=other)))
    assert moves_search.challenged(cast(Any, None), present, better) is present
    ((model, at),) = begun
    assert [(part.expected is moves.expected, part.judged) for part in weighed] == [(True, None)], (
        "it expects what it did, and not what the best one would miss"
    )
    assert (model.lumps, model.effects) == (2, ())
    of_best = dict(zip((p.name for p in best.parameters), shared, strict=True))
    assert list(at.shared) == pytest.approx([of_best[p.name] for p in model.parameters])
    assert all(one.shape[1] == 2 * len(model.axes) + len(model.nuisance) for one in at.local)


@pytest.mark.parametrize(
    ("first", "spared", "asked"),
    [
        ({"imitator": (1.0, 4.5, ())}, ["right"], [["imitator", "right"], ["right"]]),
        ({"imitator": (1.0, 1.1, ("number",))}, ["right"], [["imitator", "right"], ["right"]]),
        ({"imitator": (1.0, 1.1, ())}, ["right"], [["imitator", "right"]]),
        ({"imitator": (1.0, 4.5, ())}, ["imitator", "right"], [["imitator", "right"], ["right"]]),
        ({"imitator": (1.0, 4.5, ())}, ["imitator"], [["imitator", "right"]]),
        ({"imitator": (1.0, 4.5, ())}, [], [["imitator", "right"]]),
        ({}, ["right"], [["imitator", "right"]]),
    ],
    ids=[
        "describes only its own",
        "with no such number",
        "describes all",
        "strong starts lead one no nearer",
        "strong starts lead to nothing nearer",
        "nothing was spared",
        "nothing tried",
    ],
)
def test_what_was_spared_its_strong_starts_has_them_where_another_only_imitates_it(
    monkeypatch: Any, first: dict[str, Any], spared: list[str], asked: list[list[str]]
) -> None:
    def trial(train: float, held: float, at_limits: tuple[str, ...] = ()) -> Any:
        return SimpleNamespace(train_rms=train, validation_rms=held, held_rms=held, at_limits=at_limits)

    base: Any = SimpleNamespace(model=None)
    library = [SimpleNamespace(name=name) for name in ("imitator", "right")]
    rounds: list[list[str]] = []

    def compared(*_: Any, sparing: bool = True) -> Any:
        by_strong = {"right": 1.0, "imitator": 1.0}
        near = {"right": 1.9, "imitator": 1.0} if sparing else by_strong
        brief = {name: [SimpleNamespace(rms=rms)] for name, rms in near.items()}
        return brief, [one for one in library if one.name in spared] if sparing else []

    def proposed(_scene: Any, _present: Any, _base: Any, tried: Any, brief: Any, *_: Any) -> Any:
        rounds.append([one.name for one in tried])
        if len(rounds) > 1:
            return {"right": trial(brief["right"][0].rms, 1.05)}
        return {name: trial(*of) for name, of in first.items()} | {"right": trial(1.9, 6.0)} if first else {}

    monkeypatch.setattr(moves_search, "on_better_machines", lambda _scene, _present, trials: dict(trials))
    monkeypatch.setattr(moves_search, "on_sound_motion", lambda found: found)
    monkeypatch.setattr(moves_search, "candidates", lambda *_: library)
    monkeypatch.setattr(moves_search, "compared", compared)
    monkeypatch.setattr(moves_search, "proposed", proposed)
    scene, present = SimpleNamespace(coupled={}), trial(3.0, 6.0)
    present.model = SimpleNamespace(fitted=base)
    trials = moves_search.propose(cast(Any, scene), (), cast(Any, present), (), lambda _text: None)
    assert rounds == asked
    if first:
        assert trials["right"].train_rms == (1.0 if len(asked) == 2 else 1.9)
        assert trials["imitator"].train_rms == 1.0


@pytest.mark.parametrize(("left", "to_the_end"), [(1.9, True), (2.1, False)])
def test_the_model_without_one_of_its_effects_is_ended_unless_it_is_far_off(
    monkeypatch: pytest.MonkeyPatch, left: float, to_the_end: bool
) -> None:
    effects = tuple(DRIVEN[name](("X1",)) for name in ("sensor_bias", "sensor_gain"))
    model = Model(("X1",), 2, effects)
    numbers = np.arange(float(len(model.parameters)))
    local = np.arange(6.0).reshape(2, 3)
    found: Any = SimpleNamespace(
        rms=1.0, moves=(), model=model, at=SimpleNamespace(shared=numbers, local=(local,))
    )
    begun: list[Any] = []

    def fit(_moves: Any, without: Model, at: Any, _rounds: int) -> Any:
        begun.append((without, at))
        return SimpleNamespace(rms=left)

    monkeypatch.setattr(moves_search, "fit", fit)
    monkeypatch.setattr(moves_search, "settled", lambda again, _rounds: again)
    monkeypatch.setattr(moves_search, "trial_of", lambda *_, **__: "a trial")
    monkeypatch.setattr(moves_search, "ended", lambda *_: "an ended trial")
    trial: Any = SimpleNamespace(model=SimpleNamespace(fitted=found))
    out: Any = moves_search.without(cast(Any, None), trial, "sensor_bias")
    assert out == ("an ended trial" if to_the_end else "a trial")
    ((without, at),) = begun
    gone = [p.name for p in model.parameters].index("X1.bias_drift")
    assert [e.name for e in without.effects] == ["sensor_gain"]
    assert at.shared.tolist() == [n for k, n in enumerate(numbers) if k != gone]
    assert at.local[0].tolist() == local[:, :2].tolist()
