"""Which of an effect's shapes is chosen."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_library import DRIVEN
from service.identification import moves_shapes, moves_starts
from tests.service.identification.a_search import stub


@pytest.mark.parametrize(("train", "held", "told"), [(0.95, 1.4, 2.0), (0.95, 7.5, 0.3)])
def test_a_shape_of_friction_that_the_train_moves_do_not_tell_is_judged_on_the_others(
    monkeypatch: Any, train: float, held: float, told: float
) -> None:
    """Where the friction falls off or grows with a power shows at other speeds only."""
    first = cast(Any, SimpleNamespace(train_rms=0.90, held_rms=6.2, power=0.3))
    other = cast(Any, SimpleNamespace(train_rms=train, held_rms=held, power=2.0))
    monkeypatch.setattr(moves_shapes, "scored", lambda *_: [{"curved_power": 2.0}])
    monkeypatch.setattr(moves_shapes, "values_at", lambda _found: {})
    monkeypatch.setattr(moves_shapes, "shaped", lambda *_: "fitted")
    monkeypatch.setattr(moves_shapes, "trial_of", lambda _s, _f, thorough: other)
    scene, base = cast(Any, None), stub(1.0)
    for kind, power in (("curved_friction", told), ("machine_body_mode", 0.3)):
        candidate = cast(Any, SimpleNamespace(effect=DRIVEN[kind](("X1",))))
        assert cast(Any, moves_shapes.in_best_shape(scene, base, candidate, first)).power == power


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

    monkeypatch.setattr(moves_shapes, "standard", lambda _base, candidate: candidate.effect)
    monkeypatch.setattr(moves_shapes, "trial_of", judged)
    candidate = moves_starts.candidates(Model(("X1",), 2), [DRIVEN["transmission_ripple"]], ())[0]
    best = moves_shapes.in_best_shape(cast(Any, None), stub(missing), candidate, first)
    assert cast(Any, best).effect.module == module


def test_a_shape_is_kept_until_friction_and_machine_are_fitted_to_it(monkeypatch: Any) -> None:
    freed: list[set[str]] = []
    begun: list[dict[str, float]] = []
    candidate = moves_starts.candidates(Model(("X1",), 2), [DRIVEN["curved_friction"]], ())[0]
    names = [p.name for p in candidate.model.parameters]

    def refit(_moves: Any, _model: Any, _at: Any, _rounds: int, free: Any = None) -> Any:
        freed.append(set(names) if free is None else {names[k] for k in free})
        return stub(1.0)

    monkeypatch.setattr(moves_shapes, "unanswering", lambda moves: moves)
    monkeypatch.setattr(moves_shapes, "begun_at", lambda _m, _n, values, _local: begun.append(values))
    monkeypatch.setattr(moves_shapes, "widened", lambda *_: None)
    monkeypatch.setattr(moves_shapes, "fit", refit)
    moves_shapes.shaped(stub(1.0), candidate, {"X1.curved_power": 2.0, "X1.curved_level": 0.5})
    assert begun[0]["X1.curved_power"] == 2.0
    assert 0.0 < begun[0]["X1.curved_level"] < 0.01
    assert freed[0] == {"X1.coulomb", "X1.viscous", "X1.curved_level"}
    assert freed[1:] == [set(names) - {"X1.curved_power"}, set(names)]


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
    monkeypatch.setattr(moves_shapes, "all_shapes", lambda *_: iter(errors))
    monkeypatch.setattr(moves_shapes, "settled", lambda name, _rounds: name)
    monkeypatch.setattr(moves_shapes, "trial_of", lambda _scene, name: trial(name, 1.6))
    monkeypatch.setattr(
        moves_shapes, "ended", lambda _scene, one: trial(one.name + " ended", errors[one.name])
    )
    first = trial("first", held_out, ended)
    best = moves_shapes.in_other_shapes(cast(Any, None), stub(1.0), cast(Any, None), first)
    assert cast(Any, best).name == chosen
