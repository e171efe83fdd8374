"""Which starts of a candidate are followed."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_library import DRIVEN
from service.identification import moves_looks, moves_starts
from service.identification.moves_starts import softer_contact
from tests.service.identification.a_search import FORCE, FRICTION, HUNG

pytestmark = pytest.mark.usefixtures("sound")


def stub(rms: float, name: str = "") -> Any:
    model, at = SimpleNamespace(parameters=(), effects=(), lumps=2), SimpleNamespace(local=())
    return cast(Any, SimpleNamespace(rms=rms, moves=("every",), model=model, at=at, name=name))


def test_shaft_and_contact_are_exchanged_only_where_the_contact_is_the_stiffer() -> None:
    model = Model(("X1",), 2)
    stiff = {"X1.pinion_stiffness": 7e5, "X1.contact_stiffness": 2e6, "X1.coulomb": 0.3}
    soft = {"X1.pinion_stiffness": 2e6, "X1.contact_stiffness": 7e5, "X1.coulomb": 0.3}
    assert softer_contact(stiff, model) == soft
    assert softer_contact(soft, model) is None


@pytest.mark.parametrize(
    ("least", "present", "taken", "hopeless"),
    [
        (3.9, 4.0, (), False),
        (15.0, 20.0, (), True),
        (13.0, 20.0, (), False),
        (13.0, 20.0, ("sensor_gain",), True),
        (3.0, 20.0, ("sensor_gain",), True),
        (1.5, 20.0, ("sensor_gain",), False),
    ],
)
def test_a_search_is_given_up_where_no_two_effects_can_explain_the_moves(
    least: float, present: float, taken: tuple[str, ...], hopeless: bool
) -> None:
    assert moves_looks.out_of_reach(least, stub(present), taken) == hopeless


def test_a_fit_whose_chain_is_damped_as_none_is_stands_behind_one_that_is_about_as_near() -> None:
    """Beside a declared model that had ended so a filter was begun at 1.94 on a sound chain, and lost to 1.90."""
    near, sound, far = stub(1.9, "near"), stub(1.94, "sound"), stub(3.0, "far")
    near.damped = ("X1.gear_damping_ratio",)
    assert [one.name for one in sorted((near, sound, far), key=moves_looks.standing)] == [
        "sound",
        "near",
        "far",
    ]
    assert moves_looks.nearest((near, sound, far)) == sound.rms
    assert moves_looks.nearest((near, far)) < far.rms, "it may become a sound one"


def test_a_second_start_is_kept_only_for_another_shape_of_the_effect() -> None:
    parameters = [SimpleNamespace(name=n, found_again=False) for n in ("coulomb", "frequency")]
    candidate = SimpleNamespace(
        model=SimpleNamespace(parameters=parameters), effect=SimpleNamespace(parameters=parameters[1:])
    )

    def fitted(rms: float, coulomb: float, frequency: float) -> Any:
        return SimpleNamespace(rms=rms, at=SimpleNamespace(shared=np.array([coulomb, frequency])))

    fits = [fitted(2.5, 0.0, -0.4), fitted(2.2, 0.0, 0.5), fitted(2.3, 3.0, 0.6)]
    kept = moves_looks.best_of_each_shape(fits, cast(Any, candidate))
    assert [one.rms for one in kept] == [2.2, 2.5]


def test_a_second_look_is_for_what_may_still_be_the_best(monkeypatch: Any) -> None:
    """Not for what is as near as a right one, nor, once one explains nearly all, for what is not about as near; and
    what is far off at first is not even looked at, unless it may be a right one that begins slowly."""
    begun = {"right": 1.1, "rival": 1.3, "hopeful": 1.9, "slow": 3.2, "behind": 4.5}
    nowhere = {"far": 5.0, "farther": 6.0}
    valleys: set[str] = set()
    looked: list[str] = []
    again: list[str] = []
    afar: list[str] = []
    second = 1.2
    fits = {name: [stub(rms, name)] for name, rms in (begun | nowhere).items()}
    monkeypatch.setattr(
        moves_looks,
        "all_glimpsed",
        lambda _s, _f, of, *_, **__: ({one.name: fits[one.name] for one in of}, (), []),
    )
    monkeypatch.setattr(
        moves_looks,
        "looked_at",
        lambda f: looked.append(f[0].name) or [stub(round(f[0].rms - 0.1, 1), f[0].name)],
    )
    monkeypatch.setattr(
        moves_looks, "second_look", lambda *args: again.append(args[-1].name) or [stub(second)]
    )
    monkeypatch.setattr(moves_looks, "from_afar", lambda *args: afar.append(args[-1].name) or [])
    monkeypatch.setattr(moves_looks, "grounds", lambda *_: [])
    monkeypatch.setattr(moves_looks, "on_a_few_moves", lambda found: found)
    monkeypatch.setattr(moves_looks, "best_looks", lambda looks, *_: sorted(looks, key=lambda one: one.rms))
    monkeypatch.setattr(moves_looks, "glanced", lambda looks, *_: looks)

    def compared(rms: float, names: Sequence[str] = tuple(begun), known: float = np.inf) -> Any:
        looked.clear()
        again.clear()
        library = [
            SimpleNamespace(name=name, effect=SimpleNamespace(many_valleys=name in valleys)) for name in names
        ]
        scene = cast(Any, SimpleNamespace(smooth_left=np.inf))
        found, _ = moves_looks.compared(scene, stub(rms), cast(Any, library), known)
        return {name: [one.rms for one in looks] for name, looks in found.items()}

    near = {"right": [1.0], "rival": [1.2, 1.2], "hopeful": [1.8]}
    assert compared(3.0) == near | {"slow": [3.1], "behind": [4.5]}
    assert (looked, again) == (["right", "rival", "hopeful", "slow"], ["rival"])
    compared(6.0, ("right", "behind", "far"))
    assert looked == ["right", "behind"], "what has gone a part of its way is, however near another is"
    compared(3.0, ("rival", "hopeful"), known=1.02)
    assert (looked, again) == (["rival"], ["rival"]), "what is known explains nearly all"
    compared(3.0, ("slow", "hopeful"))
    assert again == ["hopeful"], "after which one explains nearly all"
    second = 1.7
    compared(3.0, ("slow", "hopeful"))
    assert again == ["hopeful", "slow"]
    compared(1.1, ("rival", "hopeful"))
    assert not again, "where nothing drives a fit away another start is no better"
    valleys.add("behind")
    compared(3.0, ("behind", "hopeful"))
    assert again == ["hopeful", "behind"], "of many valleys the first look tells little"
    second = 1.2
    compared(3.0, ("behind", "hopeful"))
    assert again == ["hopeful"], "one explains nearly all"
    assert not afar, "as long as one is near"
    valleys.add("farther")
    assert compared(6.8, tuple(nowhere)) == {"far": [4.9], "farther": [5.9]}
    assert not again, "where they are out of reach, the first look is all"
    second = 3.5
    compared(9.0, tuple(nowhere))
    assert again == list(nowhere)
    assert afar == [*nowhere, *nowhere]
    valleys.clear()
    monkeypatch.setattr(moves_looks, "HOPES", 1)
    compared(9.0, tuple(nowhere))
    assert again == ["far"], "of all only the nearest"
    compared(3.0, ("slow", "hopeful"))
    assert again == ["hopeful"]
    monkeypatch.setattr(moves_looks, "from_afar", lambda *args: [stub(1.5)] if args[-1].name == "far" else [])
    assert compared(6.8, tuple(nowhere)) == {"far": [1.5, 3.5, 4.9], "farther": [5.9]}
    assert again == ["far"], "what is near from there is looked at again"


@pytest.mark.parametrize(
    ("left", "turns"),
    [(13.0, [[HUNG], [FORCE, FRICTION]]), (4.0, [[FORCE, HUNG, FRICTION]])],
    ids=["explains little", "explains most"],
)
def test_what_is_smooth_is_begun_from_afar_last_where_all_of_it_together_explains_little(
    left: float, turns: list[list[str]]
) -> None:
    """Beside a machine body that left 14.3, all smooth effects together left 14.0."""
    library = [cast(Any, SimpleNamespace(name=name)) for name in (FORCE, HUNG, FRICTION)]
    scene = cast(Any, SimpleNamespace(smooth_left=left))
    found = [[one.name for one in some] for some in moves_looks.in_turn(scene, stub(14.3), library)]
    assert found == turns


@pytest.mark.parametrize(
    ("strong", "closer", "known", "sparing", "begun", "looked"),
    [
        (2.0, 1.1, np.inf, True, ["right"], ["right"]),
        (2.0, 1.5, np.inf, True, ["right", "other", "far"], ["right"]),
        (5.0, 1.1, np.inf, True, ["right", "other", "far"], []),
        (2.0, 1.1, 1.2, True, [], []),
        (2.0, 1.1, np.inf, False, ["right", "other", "far"], ["right"]),
    ],
    ids=["describes the few moves", "hardly", "is far off", "something is known", "nothing is spared"],
)
def test_once_one_describes_the_few_moves_the_others_have_no_strong_starts(
    monkeypatch: Any,
    strong: float,
    closer: float,
    known: float,
    sparing: bool,
    begun: list[str],
    looked: list[str],
) -> None:
    glimpses = {"far": 9.9, "right": 6.0, "other": 8.0}
    stronger, later = list[str](), list[str]()
    monkeypatch.setattr(moves_looks, "on_a_few_moves", lambda _found: stub(10.0))
    monkeypatch.setattr(moves_looks, "likely", lambda *_: [{}])
    monkeypatch.setattr(
        moves_looks, "glimpsed", lambda _f, one, _values: [stub(glimpses[one.name], one.name)]
    )

    def strongly_glimpsed(_scene: Any, _found: Any, one: Any, _shape: Any) -> list[Any]:
        stronger.append(one.name)
        return [stub(strong if one.name == "right" else 9.0, one.name)]

    def looked_at(fits: Any) -> list[Any]:
        best = min(fits, key=lambda f: f.rms)
        later.append(best.name)
        return [stub(closer, best.name)]

    monkeypatch.setattr(moves_looks, "strongly_glimpsed", strongly_glimpsed)
    monkeypatch.setattr(moves_looks, "looked_at", looked_at)
    library = [SimpleNamespace(name=name, effect=SimpleNamespace(many_valleys=False)) for name in glimpses]
    looks, seen, spared = moves_looks.all_glimpsed(
        cast(Any, None), stub(10.0), cast(Any, library), known, sparing, strong=True
    )
    assert (stronger, later, sorted(seen)) == (begun, looked, looked)
    assert [one.name for one in spared] == [name for name in ("right", "other", "far") if name not in begun]
    assert {name: len(fits) for name, fits in looks.items()} == {
        name: 1 if name in looked else 1 + (name in begun) for name in glimpses
    }
    stronger.clear()
    _, _, spared = moves_looks.all_glimpsed(
        cast(Any, None), stub(10.0), cast(Any, library), known, sparing, strong=False
    )
    assert (stronger, spared) == ([], []), (
        "a further effect has none: the first took its half of what was missing"
    )


@pytest.mark.parametrize(
    ("rms", "many_valleys", "spared"), [(1.1, False, 0), (3.0, True, 0), (3.0, False, 1)]
)
def test_nothing_is_spared_that_would_have_no_strong_starts(
    monkeypatch: Any, rms: float, many_valleys: bool, spared: int
) -> None:
    monkeypatch.setattr(moves_looks, "on_a_few_moves", lambda found: found)
    monkeypatch.setattr(moves_looks, "likely", lambda *_: [{}])
    monkeypatch.setattr(moves_looks, "glimpsed", lambda *_: [stub(2.0)])
    one = SimpleNamespace(name="one", effect=SimpleNamespace(many_valleys=many_valleys))
    _, _, left = moves_looks.all_glimpsed(
        cast(Any, None), stub(rms), cast(Any, [one]), 0.9, sparing=True, strong=True
    )
    assert len(left) == spared


@pytest.mark.parametrize(
    ("least", "present", "near"),
    [(1.0, 16.0, 4.0 / 3.0), (1.0, 1.2, np.sqrt(1.22)), (1.0, 1.0, 1.0), (1.0, 0.9, 1.0)],
)
def test_about_as_near_as_the_best_is_what_explains_half_as_much(
    least: float, present: float, near: float
) -> None:
    """Where little is missing, all effects are within a third of the best, those that explain nothing with them."""
    assert moves_looks.as_near(least, present) == pytest.approx(near)


def test_of_further_effects_only_what_comes_nearer_than_the_present_fit_is_followed(monkeypatch: Any) -> None:
    monkeypatch.setattr(moves_looks, "on_a_few_moves", lambda _found: stub(2.0))
    monkeypatch.setattr(moves_looks, "likely", lambda *_: [{}])
    monkeypatch.setattr(moves_looks, "glimpsed", lambda _f, one, _values: [stub(one.begun)])
    monkeypatch.setattr(moves_looks, "strongly_glimpsed", lambda *_: [])
    monkeypatch.setattr(moves_looks, "looked_at", lambda fits: fits)
    monkeypatch.setattr(moves_looks, "second_look", lambda *_: [])
    monkeypatch.setattr(moves_looks, "grounds", lambda *_: [])
    monkeypatch.setattr(moves_looks, "best_looks", lambda *_: [stub(1.5, "followed")])
    monkeypatch.setattr(moves_looks, "glanced", lambda *_: [stub(1.5, "glanced")])
    library = [
        SimpleNamespace(name=str(rms), begun=rms, effect=SimpleNamespace(many_valleys=False))
        for rms in (1.5, 1.9)
    ]
    found, scene = stub(2.0), cast(Any, None)
    first, _ = moves_looks.compared(scene, found, cast(Any, library))
    further, _ = moves_looks.compared(scene, found, cast(Any, library), taken=("sensor_gain",))
    assert [looks[0].name for looks in cast(Any, first).values()] == ["followed", "followed"]
    assert [looks[0].name for looks in cast(Any, further).values()] == ["followed", "glanced"]


def test_from_afar_typical_machines_are_begun_with_a_typical_play_and_the_estimators(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A filter of 45 Hz leaves no gap in the present machine, and one of a typical width is a third of the right."""
    candidate = moves_starts.candidates(Model(("X1",), 2), (DRIVEN["sensor_filter"],), ())[0]
    play = [p.name for p in candidate.model.parameters].index("X1.backlash")
    begun: list[float] = []

    def fit(_moves: Any, model: Any, at: Any, _rounds: int) -> Any:
        begun.append(float(model.parameters[play].value(at.shared[play])))
        return SimpleNamespace(rms=1.0, at=at, model=model)

    monkeypatch.setattr(moves_looks, "fewer", lambda _found: ())
    monkeypatch.setattr(moves_looks, "of_speed", lambda few, _lasting: few)
    monkeypatch.setattr(moves_looks, "standing", lambda fit: fit.rms)
    monkeypatch.setattr(moves_looks, "strong_at", lambda *_: [])
    monkeypatch.setattr(moves_looks, "fit", fit)
    scene: Any = SimpleNamespace(rich={"X1.backlash": 2.5e-4, "X1.contact_stiffness": 5e4})
    moves_looks.from_afar(scene, cast(Any, None), candidate)
    assert begun[:2] == pytest.approx([5e-5, 2.5e-4])
