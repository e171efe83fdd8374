"""How two gaps divide the play of one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import pytest

from service.backlash.moves_point import Point
from service.identification import moves_divided
from service.identification.moves_divided import (
    divisions,
    held_otherwise,
    led_through_rests,
    otherwise_divided,
)
from service.identification.moves_ridges import SPRINGS, hardly_damped
from tests.service.identification.a_second_gap import two_gaps


@pytest.mark.parametrize(
    ("ends", "best", "steps"),
    [
        ((1.4, 1.5, 0.98, 1.1, 1.2), 0.98, 4),
        ((2.5, 2.4, 2.3, 2.2, 2.1), 2.0, 4),
        ((1.9, 1.8, 1.7, 1.6, 1.5, 1.4, 1.3, 1.2, 1.1), 1.2, 8),
    ],
)
def test_a_fit_goes_on_uphill_from_where_its_numbers_leave_the_pinions(
    monkeypatch: pytest.MonkeyPatch, ends: tuple[float, ...], best: float, steps: int
) -> None:
    """A few steps at least, as long as they lead nearer, and not without end."""
    left = iter(ends)
    taken: list[float] = []

    def fit(_moves: Any, _model: Any, _at: Any, _rounds: int) -> Any:
        taken.append(next(left))
        return cast(Any, Step(taken[-1]))

    @dataclass(frozen=True)
    class Step:
        rms_with_motors: float
        moves: Any = ()
        model: Any = "two gaps"
        at: Any = "at"

    monkeypatch.setattr(moves_divided, "pinions_lie", lambda _model: True)
    monkeypatch.setattr(moves_divided, "lying_as_left", lambda moves, _model, at: (moves, at))
    monkeypatch.setattr(moves_divided, "reconstructed", lambda found, **_asked: found.moves)
    monkeypatch.setattr(moves_divided, "fit", fit)
    assert led_through_rests(cast(Any, Step(2.0))).rms_with_motors == best
    assert len(taken) == steps
    monkeypatch.setattr(moves_divided, "pinions_lie", lambda _model: False)
    assert led_through_rests(cast(Any, Step(2.0))).rms_with_motors == 2.0


@pytest.mark.parametrize(("contact", "chains"), [(1e6, 1), (5e6, 2)])
@pytest.mark.parametrize("near_by", [False, True])
def test_all_play_is_divided_from_end_to_end_and_then_near_by(
    monkeypatch: pytest.MonkeyPatch, contact: float, chains: int, near_by: bool
) -> None:
    monkeypatch.setattr(moves_divided, "values_at", lambda found: found.values)
    begun = list(divisions(two_gaps(80e-6, 20e-6, contact=contact), near_by))
    shares = [one["X1.backlash"] / 100e-6 for one in begun]
    assert [one["X1.backlash"] + one["X1.clearance"] for one in begun] == pytest.approx([100e-6] * len(begun))
    assert len(begun) == chains * (6 if near_by else 19)
    spread = (0.72, 0.88) if near_by else (0.05, 0.95)
    assert (min(shares), max(shares)) == pytest.approx(spread)
    assert {one["X1.contact_stiffness"] for one in begun} == ({1e6} if chains == 1 else {5e6, 2e6})
    assert {"X1.contact_damping_ratio" in one for one in begun} == {near_by}, "the wrong division's corner"


def test_a_chain_that_is_hardly_damped_has_all_springs_about_those_found() -> None:
    """What a wrong chain damps away it keeps, as it is divided; both springs go either way, each with each."""
    found = two_gaps(80e-6, 20e-6)
    begun = list(hardly_damped(found.model, found.values))
    springs = {(one["X1.gear_stiffness"] / 1e6, one["X1.pinion_stiffness"] / 2e6) for one in begun}
    assert springs == {(gear, pinion) for gear in SPRINGS for pinion in SPRINGS}
    assert min(SPRINGS) < 0.5 < 1.0 in SPRINGS
    assert max(SPRINGS) > 2.0
    for one in begun:
        assert one["X1.gear_damping_ratio"] == one["X1.pinion_damping_ratio"] <= 0.01
        assert (one["X1.backlash"], one["X1.clearance"]) == (80e-6, 20e-6)
        assert one["X1.contact_damping_ratio"] == 3.1


@pytest.mark.parametrize(("rms", "turns"), [(2.0, 2), (1.25, 1), (0.99, 1)])
def test_play_is_divided_otherwise_as_long_as_that_is_nearer(
    monkeypatch: pytest.MonkeyPatch, rms: float, turns: int
) -> None:
    """The few moves choose three starts, some on chains that are hardly damped, and all moves and their motors one of
    these; the second time near by, if that was nearer and more than noise is left, one start."""
    asked_for: list[bool] = []

    def begun(_found: Any, near_by: bool) -> list[float]:
        asked_for.append(near_by)
        return [1.9, 1.3] if near_by else [1.9, 1.3, 1.7]

    monkeypatch.setattr(moves_divided, "divisions", begun)
    with_few_moves(monkeypatch, rms)
    monkeypatch.setattr(moves_divided, "hardly_damped", lambda _model, _values: [1.2])
    carried: list[float] = []
    monkeypatch.setattr(
        moves_divided, "fitted_from", lambda _found, values, _rounds: carried.append(values) or values
    )
    on_all = {1.2: 1.6, 1.3: 1.5, 1.7: 1.8}
    monkeypatch.setattr(moves_divided, "jointly", lambda begun: two_gaps(0.0, 0.0, on_all[begun]))
    led: list[float] = []
    monkeypatch.setattr(
        moves_divided, "led_through_rests", lambda found: led.append(found.rms_with_motors) or found
    )
    assert otherwise_divided(two_gaps(0.0, 0.0, rms)).rms_with_motors == min(rms, 1.5)
    assert asked_for == [False, True][:turns]
    assert carried == [1.2, 1.3, 1.7, *[1.3] * (turns - 1)]
    assert led == [1.5, 1.6, *[1.5] * (turns - 1)], "what is far behind the nearest goes nowhere"


@pytest.mark.parametrize(("begun", "others"), [(1.7, False), (1.9, True)])
def test_play_is_divided_otherwise_where_no_pinion_that_is_held_otherwise_comes_plainly_nearer(
    monkeypatch: pytest.MonkeyPatch, begun: float, others: bool
) -> None:
    asked_for: list[float] = []
    with_few_moves(monkeypatch, 2.0)
    monkeypatch.setattr(moves_divided, "held_otherwise", lambda _found: [begun])
    monkeypatch.setattr(moves_divided, "divisions", lambda _found, _near_by: asked_for.append(1.95) or [1.95])
    monkeypatch.setattr(moves_divided, "fitted_from", lambda _found, values, _rounds: values)
    monkeypatch.setattr(moves_divided, "jointly", lambda at: two_gaps(0.0, 0.0, 0.9 if at == begun else 1.8))
    monkeypatch.setattr(moves_divided, "led_through_rests", lambda found: found)
    assert otherwise_divided(two_gaps(0.0, 0.0, 2.0)).rms_with_motors == 0.9
    assert bool(asked_for) is others


def test_a_pinion_is_held_more_and_less_on_a_chain_that_is_damped_and_on_one_that_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(moves_divided, "values_at", lambda found: found.values)
    found = two_gaps(80e-6, 20e-6)
    begun = list(held_otherwise(found))
    friction = [one["X1.pinion_friction"] / found.values["X1.pinion_friction"] for one in begun]
    assert friction == pytest.approx(
        [one["X1.pinion_viscous"] / found.values["X1.pinion_viscous"] for one in begun]
    )
    assert (min(friction), max(friction)) == pytest.approx((0.125, 4.0))
    assert 1.0 not in friction
    others = {
        n: v for n, v in found.values.items() if n.endswith(("mass", "stiffness", "backlash", "clearance"))
    }
    for one in begun:
        assert {n: one[n] for n in others} == others
    dampings = ["X1.gear_damping_ratio" in one for one in begun]
    assert sum(dampings) == len(begun) // 2


def with_few_moves(monkeypatch: pytest.MonkeyPatch, present: float) -> None:
    """Fits of a few moves leave what they are begun with, the present one as much of them."""

    def fit(_few: Any, _model: Any, at: Any, _rounds: int) -> Any:
        found = two_gaps(0.0, 0.0, present if isinstance(at, Point) else at)
        found.at = at
        return found

    monkeypatch.setattr(moves_divided, "hardly_damped", lambda _model, _values: [])
    monkeypatch.setattr(moves_divided, "held_otherwise", lambda _found: [])
    monkeypatch.setattr(moves_divided, "by_rests", lambda _few, found: found)
    monkeypatch.setattr(moves_divided, "asked", lambda _found: ())
    monkeypatch.setattr(moves_divided, "own_of_few", lambda _found: ())
    monkeypatch.setattr(moves_divided, "begun_at", lambda _few, _model, values, _own: values)
    monkeypatch.setattr(moves_divided, "fit", fit)
    monkeypatch.setattr(moves_divided, "values_at", lambda found: found.rms_with_motors)


@pytest.mark.parametrize(
    ("present", "otherwise", "followed"),
    [(3.3, 3.29, False), (3.3, 3.4, False), (3.3, 1.7, True), (1.25, 1.27, True)],
)
def test_a_division_is_followed_only_if_it_comes_nearer_to_few_moves_or_these_are_nearly_described(
    monkeypatch: pytest.MonkeyPatch, present: float, otherwise: float, followed: bool
) -> None:
    """A sensor that is bent is described by no two gaps, however their play is divided."""
    monkeypatch.setattr(moves_divided, "divisions", lambda _found, near_by: [otherwise])
    with_few_moves(monkeypatch, present)
    carried: list[float] = []
    monkeypatch.setattr(
        moves_divided, "fitted_from", lambda found, values, _rounds: carried.append(values) or found
    )
    monkeypatch.setattr(moves_divided, "jointly", lambda begun: begun)
    monkeypatch.setattr(moves_divided, "led_through_rests", lambda found: found)
    found = two_gaps(0.0, 0.0, 3.4)
    assert otherwise_divided(found) is found
    assert carried == [otherwise] * followed
