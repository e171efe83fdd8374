"""The right effect is found behind what does much the same."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from service.identification import moves_finals, moves_likenesses
from tests.service.identification.a_search import BODY, FORCE, FRICTION, PRESENT, SCENE


@pytest.mark.usefixtures("no_torque")
@pytest.mark.parametrize(
    ("limits", "ground", "named"),
    [(("X1.ripple_period",), 2.2, True), ((), 2.2, False), (("X1.ripple_period",), 4.8, False)],
    ids=["a likeness", "an effect", "nothing there, either"],
)
def test_the_others_begin_on_the_machine_that_a_likeness_of_the_right_effect_found(
    monkeypatch: Any, limits: tuple[str, ...], ground: float, named: bool
) -> None:
    """A ripple without a period described what a gain does, and led to the right machine, while the gain's own starts
    stayed in a valley that was far off."""
    on_ground = {"sensor_gain": ground, FORCE: 5.1, FRICTION: 5.3, BODY: 5.2}

    def trial(name: str, train: float, held: float, limits: tuple[str, ...] = ()) -> Any:
        fitted = SimpleNamespace(rms=train, model=SimpleNamespace(effects=(SimpleNamespace(name=name),)))
        explained = SimpleNamespace(fitted=fitted)
        return SimpleNamespace(train_rms=train, held_rms=held, at_limits=limits, model=explained)

    def fitted(_moves: Any, model: Any, *_: Any) -> Any:
        name = model.effects[0].name
        return SimpleNamespace(rms=on_ground[name], model=model)

    trials = {name: trial(name, 4.2, 6.6) for name in on_ground}
    trials["transmission_ripple"] = trial("transmission_ripple", 1.1, 1.5, limits)
    candidates = [SimpleNamespace(name=name, model=one.model.fitted.model) for name, one in trials.items()]
    right = trial("sensor_gain", 1.0, 1.0)
    base = SimpleNamespace(moves=())
    monkeypatch.setattr(moves_likenesses, "ground_of", lambda *_: SimpleNamespace(moves=()))
    monkeypatch.setattr(moves_likenesses, "placed", lambda *_: SimpleNamespace(at=None))
    monkeypatch.setattr(moves_likenesses, "fit", fitted)
    monkeypatch.setattr(moves_likenesses, "noted", lambda brief, _moves: brief)
    monkeypatch.setattr(moves_likenesses, "carried", lambda _base, brief, _rounds: replace_rms(brief, 1.0))
    monkeypatch.setattr(moves_likenesses, "settled", lambda fitted, *_: fitted)
    monkeypatch.setattr(moves_finals, "trial_of", lambda _scene, _fitted, **_: right)
    ended: list[Any] = []
    monkeypatch.setattr(moves_likenesses, "ended", lambda _scene, one: ended.append(one) or one)
    out = moves_likenesses.beside_likeness(
        cast(Any, None), PRESENT, cast(Any, base), cast(Any, candidates), trials
    )
    assert out == ({"sensor_gain": right} if named else {})
    assert ended == ([right] if named else [])
    if named:
        trials["transmission_ripple"].train_rms = 0.9
        moves_likenesses.beside_likeness(
            cast(Any, None), PRESENT, cast(Any, base), cast(Any, candidates), trials
        )
        assert ended == [right], "what does not come nearer than its likeness is not ended"
    alone = cast(Any, candidates[-1:])
    assert moves_likenesses.beside_likeness(cast(Any, None), PRESENT, cast(Any, base), alone, trials) == {}


@pytest.mark.parametrize(
    ("train", "held_out", "other", "begun", "ended"),
    [
        (1.04, 1.14, 1.0, True, True),
        (1.04, 1.14, 1.4, True, False),
        (0.99, 1.02, 1.0, False, False),
        (1.02, 1.6, 1.0, True, True),
        (2.1, 1.2, 1.0, False, False),
    ],
    ids=[
        "leaves more than a right one",
        "is nearer than the other law",
        "leaves nothing",
        "describes its own only",
        "is far off",
    ],
)
def test_what_leaves_more_than_the_right_law_is_begun_as_another_law(
    monkeypatch: Any, train: float, held_out: float, other: float, begun: bool, ended: bool
) -> None:
    """In each shape of the other law, of which the nearest is judged, and ended where it is about as near; what has no
    such law is left."""
    curve = SimpleNamespace(imitating=lambda _values: [{"X1.power": 2.0}, {"X1.power": 0.5}])
    none = SimpleNamespace(imitating=lambda _values: [])
    tried = [
        SimpleNamespace(name="curved_friction", model="curve", effect=curve),
        SimpleNamespace(name="sensor_gain", model="gain", effect=none),
    ]

    @dataclass(frozen=True)
    class Fit:
        model: str = "stribeck"
        rms: float = 1.0
        moves: str = "all"
        at: float = 1.0

    best = SimpleNamespace(
        train_rms=train, validation_rms=held_out, held_rms=held_out, model=SimpleNamespace(fitted=Fit())
    )
    far = SimpleNamespace(train_rms=1.4, validation_rms=5.0, held_rms=5.0)
    right = SimpleNamespace(train_rms=1.0, validation_rms=other, held_rms=other)
    judged: list[float] = []
    at_the_end: list[Any] = []
    monkeypatch.setattr(moves_likenesses, "distance", lambda trial: trial.train_rms * trial.held_rms)
    monkeypatch.setattr(moves_likenesses, "values_at", lambda _fit: {"X1.breakaway": 1.0})
    monkeypatch.setattr(
        moves_likenesses,
        "fitted_from",
        lambda found, values, _: replace(found, rms=values["X1.power"], at=values["X1.power"]),
    )
    monkeypatch.setattr(moves_likenesses, "fit", lambda _moves, model, at, _: Fit(model, 0.8 * at))
    monkeypatch.setattr(moves_likenesses, "judged", lambda _scene, _present, f: judged.append(f.rms) or right)
    monkeypatch.setattr(
        moves_likenesses, "ended_if_named", lambda _scene, _present, trial: at_the_end.append(trial) or trial
    )
    trials = {"stribeck_friction": best, "curved_friction": far, "sensor_gain": far}
    out = moves_likenesses.by_other_laws(SCENE, PRESENT, cast(Any, tried), cast(Any, trials))
    assert at_the_end == ([right] if ended else [])
    assert cast(Any, out) == ({"curved_friction": right} if begun else {})
    assert judged == ([0.4] if begun else []), "the nearest after a few rounds, fitted on"


@pytest.mark.parametrize(
    ("best", "gain", "done", "reached"),
    [
        ((1.09, 1.24), (1.17, 1.54), False, 0.98),
        ((1.01, 1.04), (1.17, 1.54), False, None),
        ((2.10, 2.30), (2.17, 2.54), False, None),
        ((1.09, 1.24), (1.17, 1.54), True, None),
        ((1.09, 1.24), (1.40, 2.54), False, None),
        ((1.09, 1.24), (1.17, 3.90), False, None),
    ],
    ids=["ended", "all is described", "no likeness", "ended before", "far behind", "part of it only"],
)
def test_what_stands_close_behind_a_likeness_is_ended_too(
    monkeypatch: Any,
    best: tuple[float, float],
    gain: tuple[float, float],
    done: bool,
    reached: float | None,
) -> None:
    """A gain stood there on a chain that was damped as none is, and was the one that had been planted."""

    def trial(errors: tuple[float, float], is_ended: bool) -> Any:
        train, held_out = errors
        model = SimpleNamespace(ended=is_ended)
        return SimpleNamespace(train_rms=train, validation_rms=held_out, held_rms=held_out, model=model)

    right, asked = trial((0.98, 0.99), True), []
    present = trial((2.75, 4.28), True)
    trials = {"transmission_ripple": trial(best, True), "sensor_gain": trial(gain, done)}
    monkeypatch.setattr(
        moves_likenesses, "ended_if_named", lambda _scene, _now, one: asked.append(one) or right
    )
    out = cast(Any, moves_likenesses.as_near(SCENE, present, cast(Any, trials)))
    assert {name: one.train_rms for name, one in out.items()} == ({"sensor_gain": reached} if reached else {})
    assert bool(asked) == bool(reached)


def replace_rms(one: Any, rms: float) -> Any:
    return SimpleNamespace(**{**vars(one), "rms": rms})
