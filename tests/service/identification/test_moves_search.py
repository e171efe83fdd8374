"""Where candidates are started, and how a search goes on from there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.backlash.moves import moves_of
from service.backlash.moves_fit import Point, fit, values_at
from service.captures import read_capture
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_library import DRIVEN
from service.identification import moves_looks, moves_search, moves_starts
from service.identification.moves_end import HOWEVER_FAR, OF_ADDED
from service.identification.moves_looks import Brief
from service.identification.moves_search import finalists, leading

FORCE, FRICTION = "position_dependent_force", "asymmetric_friction"
HUNG, BODY = "hung_mass_mode", "machine_body_mode"
SCENE = cast(Any, SimpleNamespace(smooth={"X1.gear_mass": 0.05}))
PRESENT = cast(Any, SimpleNamespace(train_rms=9.0, validation_rms=9.0))


@pytest.fixture(autouse=True)
def no_torque(monkeypatch: pytest.MonkeyPatch) -> None:
    """No torque was recorded, so the motors speak against nothing, and chains are sound, unless a test says what."""
    monkeypatch.setattr(moves_search, "plainly_against", lambda _present, _trial: False)
    monkeypatch.setattr(moves_looks, "overdamped", lambda found: getattr(found, "damped", ()))
    monkeypatch.setattr(moves_search, "in_full", lambda fitted: fitted)


def test_no_fit_is_finished_that_is_far_behind_the_best() -> None:
    found = {"a": 1.3, "b": 1.0, "c": 1.6, "d": 4.0}
    assert leading(found, 4) == ["b", "a"]
    assert leading(found, 1) == ["b"]


def test_those_are_finished_that_are_nearest_to_all_moves_or_to_those_that_were_fitted() -> None:
    """What comes nearer to the train moves in a wrong valley need not be what acts."""
    errors = {"body": (4.7, 9.9), "hung": (4.9, 10.2), "friction": (5.4, 4.7), "force": (5.4, 5.3)}
    trials = {
        name: cast(Any, SimpleNamespace(train_rms=train, held_rms=held))
        for name, (train, held) in errors.items()
    }
    assert finalists(trials) == ["friction", "force", "body"]
    trials["friction"].train_rms = 4.5
    assert finalists(trials) == ["friction", "force"]


def test_all_finalists_that_are_near_are_ended_before_one_is_chosen(monkeypatch: Any) -> None:
    """A force that grows along the travel came nearer than friction that differs by direction, as long as only the
    nearest was fitted to the end, and than the constant force that it contains, as long as that was left half-way."""
    errors = {
        FORCE: (1.1, 1.5),
        FRICTION: (1.0, 2.0),
        "constant_force": (1.2, 3.2),
        "sensor_gain": (3.0, 9.0),
    }

    def trial(name: str, train: float, held: float, limits: tuple[str, ...] = ()) -> Any:
        fitted = SimpleNamespace(model=SimpleNamespace(name=name, parameters=()))
        explained = SimpleNamespace(fitted=fitted)
        return SimpleNamespace(
            train_rms=train, held_rms=held, validation_rms=held, model=explained, at_limits=limits, name=name
        )

    trials = {name: trial(name, *both) for name, both in errors.items()}
    monkeypatch.setattr(moves_search, "on_better_machines", lambda _scene, _present, trials: dict(trials))
    monkeypatch.setattr(moves_search, "begun_there", lambda _scene, _present, inner, _outer: inner)
    monkeypatch.setattr(moves_search, "swings_at_all", lambda _model: False)
    monkeypatch.setattr(moves_search, "with_own_errors", lambda fitted: fitted)
    monkeypatch.setattr(moves_search, "settled", lambda fitted, *_: fitted)
    monkeypatch.setattr(moves_search, "led_on", lambda fitted, *_: fitted)
    monkeypatch.setattr(moves_search, "trial_of", lambda _scene, fitted, **_: trials[fitted.model.name])
    monkeypatch.setattr(moves_search, "inner_suffices", lambda *_: False)
    monkeypatch.setattr(moves_search, "outdone", lambda *_: False)
    asked: list[tuple[str, float]] = []

    def to_the_end(_scene: Any, one: Any, near: float = 2.0, _as_well: float = 1.3) -> Any:
        asked.append((one.name, near))
        return one if near < 2.0 else trial(one.name + " ended", 1.0, 1.0)

    monkeypatch.setattr(moves_search, "to_the_end", to_the_end)
    done = moves_search.finished(SCENE, PRESENT, cast(Any, trials))
    near = [f"{FORCE} ended", f"{FRICTION} ended", "constant_force ended"]
    assert [cast(Any, done[name]).name for name in errors] == [*near, "sensor_gain"]
    assert asked[-1] == (f"{FRICTION} ended", 1.15), "what describes its moves best may be the right one"
    trials[FRICTION].at_limits = ("coulomb_asymmetry",)
    done = moves_search.finished(SCENE, PRESENT, cast(Any, trials))
    assert cast(Any, done[FRICTION]).name == FRICTION, "what is no such effect is not worth the time"


@pytest.mark.parametrize(
    ("found", "held", "begun"),
    [(2.7, 3.6, True), (1.0, 3.6, False), (2.7, 1.05, False)],
    ids=["it came nearer", "it did not", "to the fitted moves only"],
)
def test_what_another_effect_contains_is_begun_where_that_one_ended(
    monkeypatch: Any, found: float, held: float, begun: bool
) -> None:
    """A constant force was left in a wrong valley at 2.7, and a spring that hardly grows named, which ended at 1.0."""
    model = SimpleNamespace(effects=(SimpleNamespace(instead=lambda values: {"force": values["preload"]}),))
    inner = SimpleNamespace(model=SimpleNamespace(fitted=SimpleNamespace(rms=found, model=model)))
    outer = SimpleNamespace(model=SimpleNamespace(fitted=SimpleNamespace(rms=1.05)))
    monkeypatch.setattr(moves_search, "values_at", lambda _found: {"preload": -0.38, "rate": 5.0})
    monkeypatch.setattr(
        moves_search, "fitted_from", lambda _found, values, _rounds: SimpleNamespace(rms=1.0, values=values)
    )
    monkeypatch.setattr(moves_search, "settled", lambda fitted, *_: fitted)
    monkeypatch.setattr(moves_search, "judged", lambda _scene, _present, fitted: fitted)
    monkeypatch.setattr(moves_search, "distance", lambda one: 1.08 if one is not inner else held)
    done = cast(Any, moves_search.begun_there(SCENE, PRESENT, cast(Any, inner), cast(Any, outer)))
    if begun:
        assert done.values["force"] == -0.38
    else:
        assert done is inner


@pytest.mark.parametrize(
    ("name", "ended", "described", "far", "outdone"),
    [
        ("transmission_ripple", True, True, 1.6, True),
        ("transmission_ripple", False, True, 1.6, False),
        ("transmission_ripple", True, False, 1.6, False),
        ("transmission_ripple", True, True, 1.4, False),
        ("sensor_filter", True, True, 1.6, False),
    ],
    ids=["far behind", "the other not ended", "not all described", "not far behind", "nearly its law"],
)
def test_what_is_far_behind_one_that_is_ended_and_describes_all_is_not_ended(
    monkeypatch: Any, name: str, ended: bool, described: bool, far: float, outdone: bool
) -> None:
    """A preload left 1.05, and a ripple, at 1.53, was ended for 27 s beside it."""
    latency = SimpleNamespace(model=SimpleNamespace(ended=ended), away=1.0)
    other = SimpleNamespace(model=SimpleNamespace(ended=False), away=far)
    monkeypatch.setattr(moves_search, "distance", lambda trial: trial.away)
    monkeypatch.setattr(moves_search, "describes_all", lambda _present, trial: described and trial is latency)
    trials = cast(Any, {"sensor_latency": latency, name: other})
    assert moves_search.outdone(name, PRESENT, trials) is outdone


@pytest.mark.parametrize(
    ("ended", "left", "suffices"), [(True, 1.2, True), (False, 1.2, False), (True, 1.4, False)]
)
def test_what_contains_an_effect_that_leaves_next_to_nothing_is_not_ended(
    ended: bool, left: float, suffices: bool
) -> None:
    """A spring's force is a constant one with a rate."""
    inner = SimpleNamespace(model=SimpleNamespace(ended=ended), train_rms=left, validation_rms=1.1)
    trials = cast(Any, {"constant_force": inner})
    assert moves_search.inner_suffices("position_dependent_force", trials) is suffices
    assert not moves_search.inner_suffices("constant_force", trials)


@pytest.mark.parametrize(("near", "settled"), [(2.0, [FORCE, FRICTION]), (9.0, [FORCE])])
def test_where_none_is_anywhere_near_the_nearest_alone_is_settled(
    monkeypatch: Any, near: float, settled: list[str]
) -> None:
    def trial(name: str, train: float) -> Any:
        fitted = SimpleNamespace(name=name, model=SimpleNamespace(parameters=()))
        explained = SimpleNamespace(fitted=fitted)
        return SimpleNamespace(
            train_rms=train, held_rms=train, validation_rms=train, model=explained, at_limits=()
        )

    trials = {FORCE: trial(FORCE, near), FRICTION: trial(FRICTION, 1.1 * near)}
    asked: list[str] = []
    monkeypatch.setattr(moves_search, "swings_at_all", lambda _model: False)
    monkeypatch.setattr(moves_search, "with_own_errors", lambda fitted: asked.append(fitted.name) or fitted)
    monkeypatch.setattr(moves_search, "settled", lambda fitted, *_: fitted)
    monkeypatch.setattr(moves_search, "led_on", lambda fitted, *_: fitted)
    monkeypatch.setattr(moves_search, "trial_of", lambda _scene, fitted, **_: trials[fitted.name])
    monkeypatch.setattr(moves_search, "inner_suffices", lambda *_: False)
    monkeypatch.setattr(moves_search, "outdone", lambda *_: False)
    monkeypatch.setattr(moves_search, "to_the_end", lambda _scene, one, *_: one)
    moves_search.finished(SCENE, PRESENT, cast(Any, trials))
    assert asked == settled


def test_the_nearest_that_is_led_on_is_judged_by_where_it_ended(monkeypatch: Any) -> None:
    """A hung mass stood behind two ridges: as it was found at first it swung on from no move to the next, and was
    refused."""

    def trial(name: str, train: float, limits: tuple[str, ...] = ()) -> Any:
        fitted = SimpleNamespace(name=name, model=SimpleNamespace(parameters=()))
        explained = SimpleNamespace(fitted=fitted)
        return SimpleNamespace(
            train_rms=train, held_rms=train, validation_rms=train, model=explained, at_limits=limits
        )

    trials = {HUNG: trial(HUNG, 1.9, ("X1.hung_speed",)), BODY: trial(BODY, 2.1)}
    further = trial("further", 0.9)
    by_name = {**trials, "further": further}
    monkeypatch.setattr(moves_search, "swings_at_all", lambda _model: True)
    monkeypatch.setattr(moves_search, "with_own_errors", lambda fitted: fitted)
    monkeypatch.setattr(moves_search, "settled", lambda fitted, *_: fitted)
    led: list[str] = []

    def led_on(fitted: Any, _near: float, places: Any) -> Any:
        led.append(fitted.name)
        assert places == (SCENE.smooth,), "what swings is looked for there, too"
        return further.model.fitted

    monkeypatch.setattr(moves_search, "led_on", led_on)
    monkeypatch.setattr(moves_search, "trial_of", lambda _scene, fitted, **_: by_name[fitted.name])
    monkeypatch.setattr(moves_search, "inner_suffices", lambda *_: False)
    monkeypatch.setattr(moves_search, "outdone", lambda *_: False)
    ended: list[Any] = []
    monkeypatch.setattr(moves_search, "to_the_end", lambda _scene, one, *_: ended.append(one) or one)
    done = moves_search.finished(SCENE, PRESENT, cast(Any, trials))
    assert led == [HUNG]
    assert cast(Any, done[HUNG]) is further
    assert further in ended


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
    monkeypatch.setattr(moves_search, "ground_of", lambda *_: SimpleNamespace(moves=()))
    monkeypatch.setattr(moves_search, "placed", lambda *_: SimpleNamespace(at=None))
    monkeypatch.setattr(moves_search, "fit", fitted)
    monkeypatch.setattr(moves_search, "noted", lambda brief, _moves: brief)
    monkeypatch.setattr(moves_search, "carried", lambda _base, brief, _rounds: replace_rms(brief, 1.0))
    monkeypatch.setattr(moves_search, "settled", lambda fitted, *_: fitted)
    monkeypatch.setattr(moves_search, "trial_of", lambda _scene, _fitted, **_: right)
    ended: list[Any] = []
    monkeypatch.setattr(moves_search, "ended", lambda _scene, one: ended.append(one) or one)
    out = moves_search.beside_likeness(
        cast(Any, None), PRESENT, cast(Any, base), cast(Any, candidates), trials
    )
    assert out == ({"sensor_gain": right} if named else {})
    assert ended == ([right] if named else [])
    if named:
        trials["transmission_ripple"].train_rms = 0.9
        moves_search.beside_likeness(cast(Any, None), PRESENT, cast(Any, base), cast(Any, candidates), trials)
        assert ended == [right], "what does not come nearer than its likeness is not ended"
    alone = cast(Any, candidates[-1:])
    assert moves_search.beside_likeness(cast(Any, None), PRESENT, cast(Any, base), alone, trials) == {}


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

    best = SimpleNamespace(
        train_rms=train, validation_rms=held_out, held_rms=held_out, model=SimpleNamespace(fitted=Fit())
    )
    far = SimpleNamespace(train_rms=1.4, validation_rms=5.0, held_rms=5.0)
    right = SimpleNamespace(train_rms=1.0, validation_rms=other, held_rms=other)
    judged: list[float] = []
    at_the_end: list[Any] = []
    monkeypatch.setattr(moves_search, "distance", lambda trial: trial.train_rms * trial.held_rms)
    monkeypatch.setattr(moves_search, "values_at", lambda _fit: {"X1.breakaway": 1.0})
    monkeypatch.setattr(
        moves_search, "fitted_from", lambda found, values, _: replace(found, rms=values["X1.power"])
    )
    monkeypatch.setattr(moves_search, "judged", lambda _scene, _present, f: judged.append(f.rms) or right)
    monkeypatch.setattr(
        moves_search, "ended_if_named", lambda _scene, _present, trial: at_the_end.append(trial) or trial
    )
    trials = {"stribeck_friction": best, "curved_friction": far, "sensor_gain": far}
    out = moves_search.by_other_laws(SCENE, PRESENT, cast(Any, tried), cast(Any, trials))
    assert at_the_end == ([right] if ended else [])
    assert cast(Any, out) == ({"curved_friction": right} if begun else {})
    assert judged == ([0.5] if begun else [])


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
    monkeypatch.setattr(moves_search, "ended_if_named", lambda _scene, _now, one: asked.append(one) or right)
    out = cast(Any, moves_search.as_near(SCENE, present, cast(Any, trials)))
    assert {name: one.train_rms for name, one in out.items()} == ({"sensor_gain": reached} if reached else {})
    assert bool(asked) == bool(reached)


@pytest.mark.parametrize(
    ("present", "left", "against", "may"),
    [
        (9.0, 1.2, True, True),
        (9.0, 1.5, False, True),
        (9.0, 1.5, True, False),
        (2.35, 1.94, False, False),
        (20.0, 2.6, False, True),
    ],
    ids=["next to nothing left", "not much left", "but against the motors", "too much left", "half is gone"],
)
def test_only_what_may_be_named_is_ended(
    monkeypatch: Any, present: float, left: float, against: bool, may: bool
) -> None:
    """A load that had changed, and a sensor that was bent, kept the likenesses of it for minutes."""
    monkeypatch.setattr(moves_search, "plainly_against", lambda _present, _trial: against)
    trials = (SimpleNamespace(train_rms=rms) for rms in (present, left))
    assert moves_search.may_be_named(*cast(Any, trials)) is may


@pytest.mark.parametrize(
    ("left", "refined", "tried_again"), [(1.3, 1.03, True), (1.3, 1.25, False), (1.9, 1.03, False)]
)
def test_a_law_in_coarser_pieces_is_refined_before_the_motors_speak_against_its_chain(
    monkeypatch: Any, left: float, refined: float, tried_again: bool
) -> None:
    """A bent contact left 1.30 of the noise and 14 of the motors' on a chain as heavy as the load, and in finer pieces
    1.04 at once."""
    coarse, fine = SimpleNamespace(name="coarse"), SimpleNamespace(name="fine", rms=refined)
    trial = SimpleNamespace(train_rms=left, model=SimpleNamespace(fitted=coarse))
    monkeypatch.setattr(moves_search, "in_full", lambda _fitted: fine)
    monkeypatch.setattr(moves_search, "trial_of", lambda _scene, fitted: fitted)
    out = moves_search.as_for_a_value(SCENE, cast(Any, trial))
    assert cast(Any, out) is (fine if tried_again else trial)


@pytest.mark.parametrize("against", [True, False])
def test_what_the_motors_speak_against_is_neither_led_on_nor_ended(monkeypatch: Any, against: bool) -> None:
    fitted = SimpleNamespace(name=BODY, model=SimpleNamespace(parameters=()))
    explained = SimpleNamespace(fitted=fitted, ended=False)
    trial = SimpleNamespace(train_rms=1.6, held_rms=1.6, model=explained, at_limits=())
    done: list[str] = []
    monkeypatch.setattr(moves_search, "plainly_against", lambda _present, _trial: against)
    monkeypatch.setattr(moves_search, "swings_at_all", lambda _model: True)
    monkeypatch.setattr(moves_search, "with_own_errors", lambda fitted: fitted)
    monkeypatch.setattr(moves_search, "settled", lambda fitted, *_: fitted)
    monkeypatch.setattr(moves_search, "led_on", lambda fitted, *_: done.append("led") or fitted)
    monkeypatch.setattr(moves_search, "trial_of", lambda _scene, _fitted, **_: trial)
    monkeypatch.setattr(
        moves_search, "to_the_end", lambda _scene, one, near=2.0, *_: done.append(str(near)) or one
    )
    moves_search.finished(SCENE, PRESENT, cast(Any, {BODY: trial}))
    assert done == (["1.15"] if against else ["led", "2.0", "1.15"]), (
        "what describes its moves is ended anyway"
    )


@pytest.mark.parametrize(
    ("left", "ridges", "near"),
    [(10.0, HOWEVER_FAR, np.inf), (20.0, OF_ADDED, 4.0)],
    ids=["half is gone", "hardly any is gone"],
)
def test_a_hopeless_fit_is_led_on_only_where_a_part_is_gone(
    monkeypatch: Any, left: float, ridges: tuple[float, float], near: float
) -> None:
    """A ripple left 8.5 of 21 on a wrong chain, a spring 4.5 of 6.3, and a hung mass that was none came nearer; the
    motors speak against it as against any that is as far off."""
    fitted = SimpleNamespace(model=SimpleNamespace(parameters=()))
    explained = SimpleNamespace(fitted=fitted, ended=False)
    trial = SimpleNamespace(train_rms=left, held_rms=30.0, model=explained, at_limits=())
    asked: list[Any] = []
    monkeypatch.setattr(moves_search, "plainly_against", lambda _present, _trial: True)
    monkeypatch.setattr(moves_search, "swings_at_all", lambda _model: False)
    monkeypatch.setattr(moves_search, "with_own_errors", lambda fitted: fitted)
    monkeypatch.setattr(moves_search, "settled", lambda fitted, _, between: asked.append(between) or fitted)
    monkeypatch.setattr(moves_search, "led_on", lambda fitted, near, _: asked.append(near) or fitted)
    monkeypatch.setattr(moves_search, "trial_of", lambda _scene, _fitted, **_: trial)
    monkeypatch.setattr(moves_search, "to_the_end", lambda _scene, one, *_: one)
    present = cast(Any, SimpleNamespace(train_rms=21.0, validation_rms=24.0))
    moves_search.finished(SCENE, present, cast(Any, {FORCE: trial}))
    assert asked == [ridges, near]


def test_what_does_much_the_same_is_tried_on_the_machine_that_foretells_more(monkeypatch: Any) -> None:
    """A gain left 1.04 of the fitted moves and 1.6 of the others on one machine, a ripple of 30 mm, which is much the
    same, 1.05 and 1.24 on another; the gain leaves 1.02 and 1.06 there."""

    def trial(name: str, train: float, held: float, **values: float) -> Any:
        fitted = SimpleNamespace(rms=train, name=name, values=values)
        explained = SimpleNamespace(fitted=fitted)
        return SimpleNamespace(train_rms=train, validation_rms=held, held_rms=held, model=explained)

    trials = {
        "sensor_gain": trial("sensor_gain", 1.04, 1.6, gear_mass=0.03, gain_error=0.09),
        "transmission_ripple": trial("transmission_ripple", 1.05, 1.24, gear_mass=0.13, ripple_period=0.03),
        FORCE: trial(FORCE, 3.0, 1.1, gear_mass=0.5),
    }
    begun: list[tuple[str, Any]] = []

    def fitted_from(found: Any, values: Any, _rounds: int) -> Any:
        begun.append((found.name, values))
        return trial(found.name, 1.02, 1.06).model.fitted

    monkeypatch.setattr(moves_search, "values_at", lambda found: found.values)
    monkeypatch.setattr(moves_search, "fitted_from", fitted_from)
    monkeypatch.setattr(moves_search, "judged", lambda _scene, _present, found: trial(found.name, 1.02, 1.06))
    out = moves_search.on_better_machines(cast(Any, None), PRESENT, trials)
    assert begun == [("sensor_gain", {"gear_mass": 0.13, "gain_error": 0.09})]
    assert [one.validation_rms for one in out.values()] == [1.06, 1.24, 1.1]
    trials["sensor_gain"].validation_rms = 1.3
    moves_search.on_better_machines(cast(Any, None), PRESENT, trials)
    assert len(begun) == 1, "the other machine foretells no more"


@pytest.mark.parametrize(
    ("train", "held_out", "limits", "all_moves"),
    [
        (1.0, 1.1, (), True),
        (1.01, 1.18, (), True),
        (1.01, 1.18, ("X1.bend",), False),
        (1.01, 1.9, (), False),
        (1.3, 1.1, (), False),
    ],
)
def test_what_leaves_next_to_nothing_of_what_was_missing_describes_all_moves(
    train: float, held_out: float, limits: tuple[str, ...], all_moves: bool
) -> None:
    """Of a stiffening contact that left 1.18 of the noise in the other moves all other effects were tried again, from
    strong starts and at all frequencies."""
    before, after = (
        SimpleNamespace(train_rms=fitted, validation_rms=other, at_limits=limits)
        for fitted, other in ((3.8, 5.1), (train, held_out))
    )
    assert moves_search.describes_all(cast(Any, before), cast(Any, after)) is all_moves


def replace_rms(one: Any, rms: float) -> Any:
    return SimpleNamespace(**{**vars(one), "rms": rms})


@pytest.mark.parametrize(("train", "held", "told"), [(0.95, 1.4, 2.0), (0.95, 7.5, 0.3)])
def test_a_shape_of_friction_that_the_train_moves_do_not_tell_is_judged_on_the_others(
    monkeypatch: Any, train: float, held: float, told: float
) -> None:
    """Where the friction falls off or grows with a power shows at other speeds only."""
    first = cast(Any, SimpleNamespace(train_rms=0.90, held_rms=6.2, power=0.3))
    other = cast(Any, SimpleNamespace(train_rms=train, held_rms=held, power=2.0))
    monkeypatch.setattr(moves_search, "scored", lambda *_: [{"curved_power": 2.0}])
    monkeypatch.setattr(moves_search, "values_at", lambda _found: {})
    monkeypatch.setattr(moves_search, "shaped", lambda *_: "fitted")
    monkeypatch.setattr(moves_search, "trial_of", lambda _s, _f, thorough: other)
    scene, base = cast(Any, None), stub(1.0)
    for kind, power in (("curved_friction", told), ("machine_body_mode", 0.3)):
        candidate = cast(Any, SimpleNamespace(effect=DRIVEN[kind](("X1",))))
        assert cast(Any, moves_search.in_best_shape(scene, base, candidate, first)).power == power


@pytest.mark.parametrize(("missing", "module"), [(1.9, 2.5e-3), (2.1, 0.0)])
def test_a_ripple_is_tried_with_the_teeth_of_usual_racks_where_little_is_missing(
    monkeypatch: Any, missing: float, module: float
) -> None:
    """A free period drifts to where a mesh error too small to be told imitates noise."""
    first = cast(
        Any, SimpleNamespace(train_rms=0.9, held_rms=4.0, effect=DRIVEN["transmission_ripple"](("X1",)))
    )
    errors = {2e-3: 1.4, 2.5e-3: 1.2, 3e-3: 1.3}

    def judged(_scene: Any, found: Any, thorough: bool) -> Any:
        return SimpleNamespace(train_rms=1.0, held_rms=errors.get(found.module, 9.0), effect=found)

    monkeypatch.setattr(moves_search, "standard", lambda _base, candidate: candidate.effect)
    monkeypatch.setattr(moves_search, "trial_of", judged)
    candidate = moves_starts.candidates(Model(("X1",), 2), [DRIVEN["transmission_ripple"]], ())[0]
    best = moves_search.in_best_shape(cast(Any, None), stub(missing), candidate, first)
    assert cast(Any, best).effect.module == module


def test_a_shape_is_kept_until_friction_and_machine_are_fitted_to_it(monkeypatch: Any) -> None:
    freed: list[set[str]] = []
    begun: list[dict[str, float]] = []
    candidate = moves_starts.candidates(Model(("X1",), 2), [DRIVEN["curved_friction"]], ())[0]
    names = [p.name for p in candidate.model.parameters]

    def refit(_moves: Any, _model: Any, _at: Any, _rounds: int, free: Any = None) -> Any:
        freed.append(set(names) if free is None else {names[k] for k in free})
        return stub(1.0)

    monkeypatch.setattr(moves_search, "unanswering", lambda moves: moves)
    monkeypatch.setattr(moves_search, "begun_at", lambda _m, _n, values, _local: begun.append(values))
    monkeypatch.setattr(moves_search, "widened", lambda *_: None)
    monkeypatch.setattr(moves_search, "fit", refit)
    moves_search.shaped(stub(1.0), candidate, {"X1.curved_power": 2.0, "X1.curved_level": 0.5})
    assert begun[0]["X1.curved_power"] == 2.0
    assert 0.0 < begun[0]["X1.curved_level"] < 0.01
    assert freed[0] == {"X1.coulomb", "X1.viscous", "X1.curved_level"}
    assert freed[1:] == [set(names) - {"X1.curved_power"}, set(names)]


def test_what_swings_is_begun_on_a_typical_machine_as_strong_as_it_may_well_be() -> None:
    """A body that the estimator and the present model have taken for a gap of a millimetre is found from nowhere
    else."""
    effect = DRIVEN["machine_body_mode"](("X1",))
    candidate = cast(Any, SimpleNamespace(effect=effect))
    shape = {p.name: p.typical for p in effect.parameters} | {"body_frequency": 30.0, "X1.backlash": 1e-3}
    begun = moves_starts.on_typical_machine(candidate, shape)
    assert begun["body_frequency"] == 30.0
    assert begun["body_ratio"] > 0.05
    assert "X1.backlash" not in begun, "what is not given is typical"


@pytest.mark.parametrize(
    ("name", "starts"),
    [("hung_mass_mode", 9), ("machine_body_mode", 9), ("gearbox_clearance", 0), ("sensor_bias", 1)],
)
def test_from_afar_what_swings_is_begun_in_all_its_shapes_on_a_typical_machine(
    name: str, starts: int
) -> None:
    candidate = moves_starts.candidates(Model(("X1",), 2), [DRIVEN[name]], ())[0]
    begun = moves_starts.on_typical_machines(candidate)
    assert len(begun) == starts
    own = {p.name for p in candidate.effect.parameters}
    assert all(set(values) <= own for values in begun), "all else is typical"
    swing = [(k, v) for values in begun for k, v in values.items() if k.endswith(("frequency", "_ratio"))]
    assert len({v for k, v in swing if k.endswith("frequency")}) == (starts if starts > 1 else 0)
    assert all(v > 0.0 for k, v in swing if not k.endswith("drive_ratio"))


@pytest.mark.parametrize(("heard", "starts"), [(None, 0), (9.0, len(moves_starts.RUBBED))])
def test_what_is_heard_is_begun_with_little_and_with_much_friction(heard: float | None, starts: int) -> None:
    """How a mass swings after a move depends on where the guide stopped it, so that each friction has a valley of its
    own; and a model without the mass has taken the swing's damping for all of the friction."""
    candidate = moves_starts.candidates(Model(("X1",), 2), [DRIVEN["hung_mass_mode"]], ())[0]
    begun = moves_starts.heard_on_typical_machines(cast(Any, SimpleNamespace(heard=heard)), candidate)
    assert [values["X1.hung_frequency"] for values in begun] == starts * [heard]
    frictions = [values["X1.coulomb"] for values in begun]
    assert not begun or max(frictions) > 10.0 * min(frictions)
    assert len(set(frictions)) == starts


@pytest.mark.parametrize("rms", [1.5, 9.0])
def test_where_much_is_missing_an_amount_of_two_signs_is_begun_strong_in_either_sense(rms: float) -> None:
    """A chain whose force changes within a move by more than the guide rubs takes the load across its gap: a small
    dose of it, from which a score is taken, does not."""
    model = Model(("X1",), 2)
    present = SimpleNamespace(rms=rms, model=model, at=Point(np.zeros(len(model.parameters)), ()))
    candidate = moves_starts.candidates(model, [DRIVEN["position_dependent_force"]], ())[0]
    begun = moves_starts.strong_either_way(cast(Any, present), candidate)
    amounts = [(v["X1.spring_rate"], v["X1.spring_preload"]) for v in begun]
    strong = [(-200.0, 0.0), (200.0, 0.0), (0.0, -0.5), (0.0, 0.5)]
    assert amounts == (strong if rms > moves_starts.NEAR else [])
    assert all(v["X1.backlash"] == 5e-5 for v in begun), "the machine is the present one"


def test_from_afar_an_amount_of_one_sign_is_begun_strong_where_the_estimator_puts_the_machine() -> None:
    """Friction that is mostly breakaway has driven the contact of a model without it to four times its stiffness: from
    there a small dose leads back, and a typical machine has another gap."""
    model = Model(("X1",), 2)
    present = SimpleNamespace(model=model, at=Point(np.zeros(len(model.parameters)), ()))
    place = {"X1.backlash": 1.2e-4, "X1.coulomb": 1.7, "X1.bend": 0.1}

    def begun(name: str) -> list[Any]:
        candidate = moves_starts.candidates(model, [DRIVEN[name]], ())[0]
        return moves_starts.strong_at(place, cast(Any, present), candidate)

    shapes = begun("stribeck_friction")
    assert [one["X1.stribeck_speed"] for one in shapes] == [0.006, 0.015, 0.04]
    assert {one["X1.breakaway"] for one in shapes} == {0.5}
    assert {(one["X1.backlash"], one["X1.coulomb"]) for one in shapes} == {(1.2e-4, 1.7)}
    assert not begun("constant_force"), "what has two signs is begun so on the present machine"


def test_what_acts_one_way_is_begun_in_the_name_of_each_effect_that_is_alike() -> None:
    """While an axis moves, −s·(F_C + s·A) = −s·F_C − A: an asymmetry A is a constant force −A."""
    place = {"X1.constant_force": 0.8, "X1.spring_rate": 3.0, "X1.coulomb": 1.0}
    begun = {
        name: dict(DRIVEN[name](("X1",)).instead(place))
        for name in ("constant_force", "position_dependent_force", "asymmetric_friction", "sensor_gain")
    }
    assert begun["constant_force"] == {"X1.constant_force": 0.8}
    assert begun["position_dependent_force"] == {"X1.spring_preload": 0.8}
    assert begun["asymmetric_friction"] == {"X1.coulomb_asymmetry": -0.8, "X1.viscous_asymmetry": 0.0}
    assert begun["sensor_gain"] == {}
    assert not DRIVEN["constant_force"](("X1",)).instead({"X1.coulomb": 1.0})


def stub(rms: float, name: str = "") -> Any:
    effects = (SimpleNamespace(many_valleys=False),)
    model, at = SimpleNamespace(parameters=(), effects=effects, lumps=2), SimpleNamespace(local=())
    return cast(Any, SimpleNamespace(rms=rms, moves=("every",), model=model, at=at, name=name))


def test_a_candidate_far_from_a_few_moves_is_not_fitted_to_all(monkeypatch: Any) -> None:
    rounds: list[int] = []
    monkeypatch.setattr(moves_search, "unanswering", lambda moves: moves)
    monkeypatch.setattr(moves_search, "carried", lambda _moves, brief, n: rounds.append(n) or stub(brief.rms))
    monkeypatch.setattr(moves_search, "glanced_at", lambda _found, brief: brief)
    near, far = [stub(1.5), stub(3.0)], [stub(4.0), stub(4.1)]
    assert moves_search.refitted(stub(6.0), far, 1.5) == far[:1]
    assert not rounds
    moves_search.refitted(stub(6.0), near, 1.5)
    assert rounds == [moves_search.FIRST_ROUNDS]


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


def test_of_an_effect_with_many_valleys_a_fit_in_each_is_judged(monkeypatch: Any) -> None:
    """How near a few moves come, with the motor's motion that the present fit makes, says little of them; one that the
    motors speak against is none, however near it is."""
    ended, by_motors = {1.5: 1.2, 1.6: 1.0, 1.7: 1.1, 1.8: 0.9}, {1.2: 2.1, 1.0: 2.0, 1.1: 2.0, 0.9: 4.0}

    def asked(found: Any, asked: bool) -> float:
        assert asked
        return float(found.rms)

    def fit(rms: float, *_: Any) -> Any:
        found = stub(ended[rms])
        found.rms_with_motors = by_motors[found.rms]
        return found

    monkeypatch.setattr(moves_search, "carried", lambda _moves, brief, _rounds: brief)
    monkeypatch.setattr(moves_search, "reconstructed", asked)
    monkeypatch.setattr(moves_search, "fit", fit)
    near = [stub(rms) for rms in (*ended, 3.0)]
    assert [f.rms for f in moves_search.refitted(stub(6.0), near, 2.0)] == [1.5]
    for one in near:
        one.model.effects = (SimpleNamespace(many_valleys=True),)
    assert [f.rms for f in moves_search.refitted(stub(6.0), near, 2.0)] == [1.0, 1.1, 1.2]


def test_a_glance_moves_no_wrong_start_away_but_takes_the_zeros_along(shared_dir: Path) -> None:
    """The moves begin where the fit of a few says or where they begin now, each where it is described best."""
    moves = moves_of(read_capture(shared_dir / "captures" / "none-train.parquet"), ("X1",))
    model = Model(("X1",), 2, held=("constant", "skew"))
    now = fit([moves], model, Point(np.zeros(len(model.parameters)), (np.zeros((len(moves.grids), 2)),)), 3)
    far = tuple(np.full_like(local, 8.0) for local in now.at.local)
    brief = Brief(model, 9.0, values_at(now), far)
    assert moves_search.glanced_at(now, brief).rms < 1.05 * now.rms
    lost = fit([moves], model, Point(now.at.shared, far), 0)
    assert lost.rms > 2.0 * now.rms


def test_an_effect_is_begun_again_where_one_ended_that_contains_it(monkeypatch: Any) -> None:
    begun: list[dict[str, float]] = []

    def fitted_from(_found: Any, values: dict[str, float], _rounds: int) -> Any:
        begun.append(values)
        return stub(1.1)

    monkeypatch.setattr(moves_search, "values_at", lambda _f: {"X1.spring_preload": 0.2, "X1.coulomb": 0.3})
    monkeypatch.setattr(moves_search, "fitted_from", fitted_from)
    inner = stub(1.6)
    inner.model = SimpleNamespace(effects=(DRIVEN["constant_force"](("X1",)),))
    assert moves_search.as_other(inner, stub(1.8)).rms == 1.6
    assert not begun, "what contains it is no nearer"
    assert moves_search.as_other(inner, stub(1.2)).rms == 1.1
    assert begun[0]["X1.constant_force"] == 0.2
    assert begun[0]["X1.coulomb"] == 0.3


@pytest.mark.parametrize(
    ("glimpse", "rounds"), [(2.1, [moves_search.GLIMPSE]), (1.9, [moves_search.GLIMPSE, 3])]
)
def test_what_is_far_off_on_the_ground_of_the_best_is_not_followed(
    monkeypatch: Any, glimpse: float, rounds: list[int]
) -> None:
    asked: list[int] = []

    def fit(_moves: Any, _model: Any, _at: Any, rounds: int) -> Any:
        asked.append(rounds)
        return stub(glimpse)

    candidate: Any = SimpleNamespace(model="with the effect")
    monkeypatch.setattr(moves_search, "placed", lambda ground, _candidate: ground)
    monkeypatch.setattr(moves_search, "fit", fit)
    first = stub(2.0)
    assert moves_search.seconded(stub(6.0), first, candidate, nearest=2.0, far=2.0) is first
    assert asked == rounds


def test_how_two_gaps_divide_their_sum_is_tried_near_by(monkeypatch: Any) -> None:
    place = {"X1.backlash": 60e-6, "X1.coulomb": 0.3, "X1.drive_mass": 0.9, "X1.contact_damping_ratio": 0.5}
    place |= {"X1.drive_stiffness": 7e5, "X1.contact_stiffness": 4e5, "X1.smear": 2e-4}
    scene = cast(Any, SimpleNamespace(rich=place | {"X1.backlash": 50e-6}))
    model = Model(("X1",), 1)
    candidate = moves_starts.candidates(model, (DRIVEN["gearbox_clearance"],), ())[0]
    monkeypatch.setattr(moves_starts, "values_at", lambda _found: place)
    begun = moves_starts.near_by(scene, stub(1.6), candidate)
    sums = [b["X1.backlash"] + b["X1.clearance"] for b in begun]
    np.testing.assert_allclose(sums, 12 * [60e-6] + 6 * [50e-6])
    assert len({round(b["X1.clearance"], 9) for b in begun[:6]}) == 6
    assert all(b["X1.drive_mass"] == 0.9 for b in begun[:6]), "the chain as it is now"
    assert not any("X1.drive_mass" in b or "X1.contact_damping_ratio" in b for b in begun[6:]), "put back"
    place |= {"X1.contact_stiffness": 2e6}
    stiffer = moves_starts.near_by(scene, stub(1.6), candidate)[6:12]
    assert all(b["X1.contact_stiffness"] == 7e5 and b["X1.drive_stiffness"] == 2e6 for b in stiffer)
    assert all("X1.smear" not in b and b["X1.drive_mass"] == 0.9 for b in stiffer), "two impacts, not one"


@pytest.mark.parametrize(
    ("train", "held_out", "asked", "ended"),
    [
        (1.0, 2.0, (), True),
        (1.0, 1.2, (), False),
        (1.0, 1.2, (1.15, 1.1), True),
        (1.2, 1.5, (1.15, 1.1), False),
        (1.5, 1.8, (), False),
        (1.5, 2.1, (), True),
        (2.5, 9.0, (), False),
    ],
)
def test_a_fit_that_describes_its_own_moves_only_is_ended_before_it_is_judged(
    monkeypatch: Any, train: float, held_out: float, asked: tuple[float, ...], ended: bool
) -> None:
    monkeypatch.setattr(moves_search, "ended", lambda _scene, _trial: "ended")
    trial = cast(Any, SimpleNamespace(train_rms=train, validation_rms=held_out))
    assert (moves_search.to_the_end(cast(Any, None), trial, *asked) == "ended") is ended


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
    ("ended", "held_out", "chosen"),
    [(True, 1.35, "shape 0.5 ended"), (True, 1.2, "first"), (False, 1.35, "first")],
)
def test_other_shapes_of_friction_are_ended_where_an_ended_fit_describes_its_own_moves_only(
    monkeypatch: Any, ended: bool, held_out: float, chosen: str
) -> None:
    """One ended at a level of -0.9 and a power of 1.3 where 0.5 and 0.4 were planted: the viscous friction hid it."""

    def trial(name: str, held: float, done: bool = True) -> Any:
        explained = SimpleNamespace(ended=done)
        return SimpleNamespace(model=explained, train_rms=0.99, validation_rms=held, held_rms=held, name=name)

    errors = {"shape 0.5": 1.0, "shape 2.0": 1.34}
    monkeypatch.setattr(moves_search, "all_shapes", lambda *_: iter(errors))
    monkeypatch.setattr(moves_search, "settled", lambda name, _rounds: name)
    monkeypatch.setattr(moves_search, "trial_of", lambda _scene, name: trial(name, 1.6))
    monkeypatch.setattr(
        moves_search, "ended", lambda _scene, one: trial(one.name + " ended", errors[one.name])
    )
    first = trial("first", held_out, ended)
    best = moves_search.in_other_shapes(cast(Any, None), stub(1.0), cast(Any, None), first)
    assert cast(Any, best).name == chosen


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


@pytest.mark.parametrize(("may_be_named", "asked"), [(True, [False, True]), (False, [False])])
def test_the_motors_of_held_out_moves_are_followed_only_for_what_may_be_named(
    monkeypatch: Any, may_be_named: bool, asked: list[bool]
) -> None:
    followed: list[bool] = []

    def trial_of(_scene: Any, _found: Any, thorough: bool = True) -> int:
        followed.append(thorough)
        return len(followed)

    monkeypatch.setattr(moves_search, "trial_of", trial_of)
    monkeypatch.setattr(moves_search, "may_be_named", lambda *_: may_be_named)
    trial = moves_search.judged(cast(Any, None), cast(Any, None), cast(Any, None))
    assert (followed, trial) == (asked, len(asked))


@pytest.mark.parametrize(
    ("rms", "led"), [(11.0, True), (25.0, False), (1.04, False)], ids=["a part", "hardly any", "near"]
)
def test_what_couples_two_axes_is_led_on_first_where_it_takes_a_part(
    monkeypatch: Any, rms: float, led: bool
) -> None:
    """28 of the noise without a bridge: what is near is ended later, as all are; what takes nothing is none."""
    found = cast(Any, SimpleNamespace(moves=(), rms=28.0))
    candidate = cast(Any, SimpleNamespace(model="coupled"))
    monkeypatch.setattr(moves_search, "unanswering", lambda moves: moves)
    monkeypatch.setattr(moves_search, "point_at", lambda *_: "estimator's")
    monkeypatch.setattr(moves_search, "rests_found", lambda *_: "rests")
    monkeypatch.setattr(moves_search, "fit", lambda *_, **__: SimpleNamespace(at="at", rms=rms))
    monkeypatch.setattr(moves_search, "with_own_errors", lambda one: one)
    monkeypatch.setattr(moves_search, "settled", lambda _one, _rounds, ridges: ("led", ridges))
    scene = cast(Any, SimpleNamespace(coupled={}))
    coupled = cast(Any, moves_search.as_coupled(scene, found, candidate))
    assert (coupled == ("led", HOWEVER_FAR)) is led
