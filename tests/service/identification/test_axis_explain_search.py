"""Where the search for what is missing begins, and when nothing is searched."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from service.dynamics.work import count, counted, up_to
from service.identification import axis_explain
from service.identification.axis_explain import HIDDEN, missing_in
from service.identification.axis_selected import BEYOND, LIMITS, WITNESSED
from service.identification.explanation import Candidate
from service.identification.moves_repeated import PureError
from service.identification.moves_search import SEARCH
from service.identification.selection import Selection, Trial
from tests.service.identification.a_search import heard, motors_leave, trial


@pytest.mark.parametrize(
    ("errors", "accepted", "wanders", "asked", "by_motors"),
    [
        ((1.1, 2.4), (), False, ["all but hidden"], 1.2),
        ((1.1, 2.4), (), False, ["all"], 0.0),
        ((1.1, 2.4), ("hung_mass_mode",), False, [], 1.2),
        ((1.7, 1.8), ("hung_mass_mode",), False, ["beyond"], 1.2),
        ((1.1, 1.2), ("hung_mass_mode",), True, ["zero"], 1.2),
        ((1.1, 1.2), ("sensor_bias",), True, [], 1.2),
        ((1.7, 1.8), (), True, ["zero", "all but hidden"], 1.2),
        ((0.97, 1.22), (), False, ["hidden"], 0.0),
        ((0.97, 1.22), (), False, ["all but hidden"], 1.2),
        ((0.97, 1.12), (), False, ["all but hidden"], 1.2),
        ((1.1, 1.22), (), False, ["all but hidden"], 1.2),
        ((1.21, 1.25), (), False, ["all but hidden", "motors"], 3.0),
        ((0.97, 1.12), (), False, ["motors", "all but hidden"], 3.0),
        ((1.6, 1.7), (), False, ["all but hidden", "motors"], 3.0),
        ((1.6, 1.7), (), True, ["zero", "all but hidden", "motors"], 3.0),
        ((6.1, 7.0), (), False, ["all but hidden", "motors"], 3.0),
        ((8.1, 9.0), (), False, ["all"], 3.0),
        ((1.1, 1.2), ("hung_mass_mode",), False, [], 3.0),
    ],
)
def test_beyond_what_is_accepted_only_more_than_a_law_leaves_is_searched(
    monkeypatch: pytest.MonkeyPatch,
    errors: tuple[float, float],
    accepted: tuple[str, ...],
    wanders: bool,
    asked: list[str],
    by_motors: float,
) -> None:
    said: list[str] = []

    def searched(
        _scene: Any, before: Trial[Any], _tell: Any, limits: Any, first: Any = (), but: Any = ()
    ) -> Selection[Any]:
        names = {
            id(LIMITS): "all",
            id(BEYOND): "beyond",
            id(WITNESSED): "hidden" if first == HIDDEN else "zero",
        }
        assert bool(first) == (limits is WITNESSED)
        said.append(names[id(limits)] + (" but hidden" if but == HIDDEN else ""))
        return Selection(before, before, (), (), ())

    def hidden(_scene: Any, before: Trial[Any], *_: Any) -> Selection[Any]:
        said.append("motors")
        return Selection(before, before, (), (Candidate("gearbox_clearance", 1.0, 1.0),), ())

    heard(monkeypatch)
    monkeypatch.setattr(axis_explain, "searched", searched)
    monkeypatch.setattr(axis_explain, "finding_of", lambda _found: ("none", ()))
    monkeypatch.setattr(axis_explain, "hidden", hidden)
    motors_leave(monkeypatch, lambda _fitted: np.array([0.5, 1.0]) * by_motors)
    scene: Any = SimpleNamespace(zero_wanders=wanders, smooth_left=np.inf)
    found = missing_in(scene, trial(*errors), accepted, lambda _text: None)
    assert said == asked
    assert found.effects == ()


@pytest.mark.parametrize(
    ("nearer", "train_rms"), [(False, 1.0), (True, 2.5)], ids=["no nearer", "no two gaps that one imitates"]
)
def test_what_may_be_hidden_and_is_not_likely_to_be_is_asked_for_last(
    monkeypatch: pytest.MonkeyPatch, nearer: bool, train_rms: float
) -> None:
    """However plainly the motors speak; and not at all where all is described with another effect."""
    before, after = trial(train_rms, 2.6), trial(1.0, 1.05)
    said: list[str] = []
    left = {id(before): 9.0, id(after): 1.2}
    for one in (before, after):
        one.model.fitted = one
    heard(monkeypatch)
    found = [Selection(before, after, ("sensor_gain",), (), ()), Selection(before, before, (), (), ())]

    def hidden(*_: Any) -> Selection[Any]:
        said.append("motors")
        return Selection(before, before, (), (), ())

    def searched(*_: Any, **__: Any) -> Selection[Any]:
        said.append("all")
        return found.pop(0)

    monkeypatch.setattr(axis_explain, "leads", lambda *_: nearer)
    monkeypatch.setattr(axis_explain, "hidden", hidden)
    monkeypatch.setattr(axis_explain, "searched", searched)
    monkeypatch.setattr(axis_explain, "finding_of", lambda _found: ("none", ()))
    motors_leave(monkeypatch, lambda of: np.array([0.5, left[id(of)]]))
    scene: Any = SimpleNamespace(zero_wanders=False, smooth_left=np.inf)
    assert missing_in(scene, before, (), lambda _text: None).effects == ("sensor_gain",)
    assert said == ["all"]
    assert missing_in(scene, before, (), lambda _text: None).effects == ()
    assert said == ["all", "all", "motors"]


def test_where_the_held_out_moves_have_no_torque_what_may_be_hidden_is_searched_with_all_else(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before, left_out = trial(1.1, 1.4), []

    def searched(_scene: Any, before: Trial[Any], *_: Any, but: Any = ()) -> Selection[Any]:
        left_out.append(but)
        return Selection(before, before, (), (), ())

    heard(monkeypatch, 0.0)
    motors_leave(monkeypatch, lambda _fitted: np.array([5.0]))
    monkeypatch.setattr(axis_explain, "hidden", lambda *_: Selection(before, before, (), (), ()))
    monkeypatch.setattr(axis_explain, "searched", searched)
    scene: Any = SimpleNamespace(zero_wanders=False, smooth_left=np.inf)
    assert missing_in(scene, before, (), lambda _text: None).effects == ()
    assert left_out == [()]


def test_nothing_is_searched_where_alike_moves_differ_by_what_is_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """But a zero that wanders, which does not follow the motion either."""
    before = trial(5.0, 6.0)
    before.model.fitted = SimpleNamespace(
        model=SimpleNamespace(effects=(SimpleNamespace(name="sensor_gain"),))
    )
    first = []

    def searched(_scene: Any, before: Trial[Any], *_: Any, **asked: Any) -> Selection[Any]:
        first.append([kind.name for kind in asked["first"]])
        return Selection(before, before, (), (), ())

    heard(monkeypatch)
    monkeypatch.setattr(axis_explain, "searched", searched)
    monkeypatch.setattr(axis_explain, "pure_error", lambda _fitted: PureError(5.0, 4.5))
    scene: Any = SimpleNamespace(zero_wanders=True, smooth_left=np.inf)
    found = missing_in(scene, before, (), lambda _text: None)
    assert first == [["sensor_bias"]]
    assert found.effects == ()
    refused = [candidate.effect for candidate in found.candidates]
    assert "sensor_latency" in refused
    assert "sensor_gain" not in refused, "it is in the model already"
    assert "sensor_bias" not in refused, "it does not follow the motion"
    assert not any(candidate.accepted for candidate in found.candidates)


@pytest.mark.parametrize(
    ("limits", "left", "found", "effects"),
    [
        (("X1.gear_damping_ratio",), 1.7, "effect", ("asymmetric_friction", "sensor_latency")),
        (("X1.gear_damping_ratio",), 1.7, "unknown", ()),
        (("X1.gear_damping_ratio",), 3.0, "effect", ()),
        (("X1.ripple_period",), 1.7, "effect", ()),
        ((), 1.7, "effect", ()),
    ],
    ids=["two effects", "no explanation", "leaves too much", "no such effect", "refused otherwise"],
)
def test_what_explains_nearly_all_but_for_its_chain_is_searched_for_company(
    monkeypatch: pytest.MonkeyPatch,
    limits: tuple[str, ...],
    left: float,
    found: str,
    effects: tuple[str, ...],
) -> None:
    """Friction that differs by direction, and a late sensor: what is late was described by a chain that is damped as
    none is, so neither had its name."""

    def named(name: str, train: float, held_out: float, at_limits: tuple[str, ...] = ()) -> Trial[Any]:
        model = SimpleNamespace(model=SimpleNamespace(effects=(SimpleNamespace(name=name),)))
        one = replace(trial(train, held_out), model=SimpleNamespace(fitted=model), at_limits=at_limits)
        return replace(one, validation_blocks=np.full(5, held_out**2), independent=100.0)

    before = named("dead_zone", 3.6, 6.6)
    first = named("asymmetric_friction", 1.4, left, limits)
    both = named("sensor_latency", 1.0, 1.0)
    rejected = Candidate("asymmetric_friction", left, 1e-9, False, "only with a chain where none is")
    taken = Candidate("sensor_latency", 1.0, 1e-9, True, "significant")
    monkeypatch.setattr(axis_explain, "overdamped", lambda _found: ("X1.gear_damping_ratio",))
    monkeypatch.setattr(axis_explain, "finding_of", lambda _selection: (found, ()))
    asked: list[Any] = []

    def selected(_scene: Any, begun: Trial[Any], proposed: Any, _tell: Any, limits: Any) -> Selection[Any]:
        asked.append(limits)
        assert begun is first
        return Selection(begun, both, ("sensor_latency",), (taken,), ())

    monkeypatch.setattr(axis_explain, "selected", selected)
    alone: Selection[Any] = Selection(
        before, before, (), (rejected,), (), tried=(first, named("c", 1.4, 2.5))
    )
    nothing: Any = None
    out = axis_explain.in_company(nothing, before, alone, (), lambda _text: None)
    assert out.effects == effects
    if effects:
        assert (out.before, out.after, out.tried) == (before, both, alone.tried)
        assert out.candidates == (rejected, taken)
        assert (asked[0].enough, asked[0].most) == (0.0, 1)
    else:
        assert out is alone


@pytest.mark.parametrize(
    ("amount", "left", "effects"),
    [(1.0, 1.6, ("sensor_gain",)), (9.0, 1.6, ()), (9.0, 1.02, ("sensor_gain",))],
    ids=["all were followed", "not all were", "it describes all"],
)
def test_where_not_all_were_followed_to_their_ends_only_what_describes_all_is_named(
    monkeypatch: pytest.MonkeyPatch, amount: float, left: float, effects: tuple[str, ...]
) -> None:
    before, after = trial(3.0, 3.0), trial(left, left)
    before.model.fitted = SimpleNamespace(model=SimpleNamespace(effects=()))
    taken = Candidate("sensor_gain", left, 1e-9, True, "significant")

    def propose(*_: Any) -> dict[str, Trial[Any]]:
        for _round in range(2):
            up_to(SEARCH, lambda: count(amount), None)
        return {"sensor_gain": after}

    def selected(_scene: Any, begun: Trial[Any], proposed: Any, *_: Any) -> Selection[Any]:
        (best,) = proposed(begun, ()).values()
        return Selection(begun, best, ("sensor_gain",), (taken,), ())

    monkeypatch.setattr(axis_explain, "propose", propose)
    monkeypatch.setattr(axis_explain, "selected", selected)
    monkeypatch.setattr(
        axis_explain, "finding_of", lambda found: ("effect" if found.effects else "unknown", ())
    )
    monkeypatch.setattr(axis_explain, "left", lambda _trial: 1.0)
    monkeypatch.setattr(axis_explain, "asked_of_impurities", lambda *_: True)
    monkeypatch.setattr(axis_explain, "with_another", lambda _scene, found, *_: found)
    nothing: Any = None
    with counted(10.0):
        found = axis_explain.searched(nothing, before, lambda _text: None, LIMITS)
    assert found.effects == effects
    assert found.after is (after if effects else before)
    assert [candidate.accepted for candidate in found.candidates] == [bool(effects)]
