"""Valleys beside that in which a fit ended."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.backlash.moves_begun import shared_at
from service.backlash.moves_fit import Fitted, fit, values_at
from service.backlash.moves_point import FAR, Point
from service.backlash.moves_predicted import predict
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_bodies import DrivenHungMass
from service.identification import moves_ridges, moves_starts
from service.identification.moves_ridges import (
    at_all_frequencies,
    on_typical_chain,
    otherwise_rubbing,
    over_ridges,
    put_back,
    swinging_otherwise,
)
from service.identification.moves_starts import ROUNDS, across_samples, widened


def begun_with(found: Fitted, **factors: float) -> Fitted:
    """A fit of all moves, begun with some numbers of X1 wrong by these factors."""
    names = [p.name for p in found.model.parameters]
    shared = found.at.shared.copy()
    for name, factor in factors.items():
        k = names.index(f"X1.{name}")
        shared[k] = float(found.model.parameters[k].internal(factor * found.value(names[k])))
    return fit(found.moves, found.model, Point(shared, found.at.local), ROUNDS)


def ended(found: Fitted) -> Fitted:
    """The fit followed on: how far down its valley it is after a few rounds differs from processor to processor."""
    return fit(found.moves, found.model, found.at, 2 * ROUNDS)


@pytest.mark.parametrize(
    "wrong",
    [
        {"contact_stiffness": 0.4},
        {"gear_stiffness": 0.3, "pinion_stiffness": 3.0},
        {
            "contact_stiffness": 0.24,
            "gear_stiffness": 400.0,
            "gear_damping_ratio": 10.0,
            "pinion_mass": 12.0,
            "pinion_damping_ratio": 30.0,
        },
    ],
    ids=["every impact comes late", "springs otherwise divided", "chain and contact in a corner"],
)
def test_a_fit_that_ended_in_another_valley_is_carried_to_the_right_one(
    found: Fitted, wrong: dict[str, float]
) -> None:
    right = ended(found)
    other = begun_with(found, **wrong)
    assert ended(other).rms > 1.015 * right.rms
    assert ended(over_ridges(other)).rms < 1.005 * right.rms


def test_fits_that_stopped_where_a_flank_is_met_at_a_sample_are_led_across_it(found: Fitted) -> None:
    """Over several beginnings: at which sample one of them stops differs from processor to processor."""
    right = ended(found)
    beginnings: list[dict[str, float]] = [
        {"contact_stiffness": 0.4},
        {"gear_stiffness": 0.3},
        {"gear_stiffness": 0.3, "pinion_stiffness": 3.0},
        {"gear_stiffness": 0.5, "pinion_stiffness": 2.0},
    ]
    stopped = [ended(begun_with(found, **wrong)) for wrong in beginnings]
    on = [across_samples(each.moves, each) for each in stopped]
    assert all(after.squares <= before.squares for after, before in zip(on, stopped, strict=True))
    before, after = (sum(each.rms - right.rms for each in fits) for fits in (stopped, on))
    assert before > 0.05 * right.rms
    assert after < 0.5 * before


def test_a_fit_that_comes_no_nearer_by_speed_stays_where_it_is(monkeypatch: Any, found: Fitted) -> None:
    asked: list[float] = []

    def farther(moves: Any, _model: Any, _at: Any, _rounds: int, **_: Any) -> Fitted:
        asked.append(moves[0].lasting)
        return replace(found, r=1.01 * found.r)

    monkeypatch.setattr(moves_starts, "fit", farther)
    assert across_samples(found.moves, found) is found
    h = found.moves[0].h
    assert asked == [pytest.approx(8.0 * h), 0.0, pytest.approx(16.0 * h), 0.0]


def test_a_fit_stays_where_no_other_valley_is_nearer_and_none_is_looked_for_there_again(
    monkeypatch: Any, found: Fitted
) -> None:
    right = fit(found.moves, found.model, found.at, ROUNDS)
    stayed = over_ridges(right)
    np.testing.assert_array_equal(stayed.at.shared, right.at.shared)
    assert stayed.rms == right.rms
    further = fit(stayed.moves, stayed.model, stayed.at, 1)
    aside = replace(further, at=replace(further.at, shared=further.at.shared + 2.0 * moves_ridges.SAME))
    nearer = replace(further, r=0.9 * further.r)

    def looked_for(_found: Fitted) -> None:
        raise AssertionError("looked for")

    monkeypatch.setattr(moves_ridges, "fewer", looked_for)
    assert over_ridges(further) is further
    for other, where in ((aside, None), (nearer, None), (further, moves_ridges.other_sizes), (right, None)):
        with pytest.raises(AssertionError, match="looked for"):
            over_ridges(other, where)


@pytest.mark.parametrize(
    ("here", "elsewhere", "axes", "led"),
    [
        (6.3, 1.3, ("X1",), True),
        (6.3, 5.0, ("X1",), False),
        (2.5, 1.3, ("X1",), False),
        (6.3, 1.3, ("X1", "X2"), False),
    ],
    ids=["far nearer", "no other valley", "the motors agree", "two axes"],
)
def test_a_fit_begins_once_more_where_its_motors_tell_another_valley(
    monkeypatch: Any, found: Fitted, here: float, elsewhere: float, axes: tuple[str, ...], led: bool
) -> None:
    """An axis that is pressed against one flank all the way: 2.6 of the samples, 6.3 with its motor, which many
    machines with as much friction leave far less of."""
    begun = list[float]()
    coulomb = [p.name for p in found.model.parameters].index("X1.coulomb")

    def fitted(_moves: Any, _model: Any, at: Any, *_: Any) -> Any:
        return SimpleNamespace(
            model=found.model, at=at, rms=2.6, rms_with_motors=here if at == "here" else elsewhere
        )

    def by_speeds(_moves: Any, _model: Any, at: Point, *_: Any) -> Any:
        begun.append(at.shared[coulomb])
        return fitted(_moves, _model, "begun")

    for name, stand_in in (
        ("asked", lambda _found: found.moves),
        ("Point", lambda *_: "here"),
        ("fit", fitted),
        ("speeds_first", by_speeds),
        ("values_at", lambda one: one.at),
        ("fitted_from", lambda _found, values, _rounds: f"from {values}"),
    ):
        monkeypatch.setattr(moves_ridges, name, stand_in)
    of_axes = replace(found, model=replace(found.model, axes=axes)) if len(axes) > 1 else found
    end = cast(Any, moves_ridges.as_motors_tell(of_axes))
    assert end == "from begun" if led else end is of_axes
    assert sorted(begun) == (list(moves_ridges.RUBBED) if begun else [])


def test_another_machine_is_followed_however_far_it_is_after_a_few_rounds(
    monkeypatch: Any, found: Fitted
) -> None:
    """On a typical chain a body's fit stood at 4.7, behind all that began near by, and led to 1.2."""

    def fitted(_few: Any, _model: Any, at: Any, *_: Any) -> Any:
        return SimpleNamespace(at=at, rms=4.7 if isinstance(at, str) else 3.0)

    for name in ("fit", "speeds_first"):
        monkeypatch.setattr(moves_ridges, name, fitted)
    monkeypatch.setattr(moves_ridges, "begun_at", lambda *_: "machine")
    monkeypatch.setattr(moves_ridges, "if_nearer", lambda _found, _here, others: [one.at for one in others])
    followed = cast(Any, over_ridges(found, lambda _found: iter([found.at.shared] * 4)))
    assert followed[moves_ridges.LAST :] == ["machine"] * 3
    assert "machine" not in followed[: moves_ridges.LAST]


@pytest.mark.parametrize(
    "wrong",
    [{"gear_mass": 4.0, "pinion_mass": 0.3}, {"gear_stiffness": 0.3, "pinion_stiffness": 3.0}],
    ids=["masses otherwise divided", "springs otherwise divided"],
)
def test_a_chain_that_damps_too_much_is_led_to_one_that_hardly_does(
    found: Fitted, wrong: dict[str, float]
) -> None:
    """A Stribeck curve stood at such a chain, a tenth above the noise and two fifths in the other moves."""
    right = ended(found)
    other = begun_with(found, gear_damping_ratio=25.0, pinion_damping_ratio=25.0, **wrong)
    assert ended(other).rms > 1.5 * right.rms
    assert ended(moves_ridges.hardly_damped_chain(other)).rms < 1.005 * right.rms
    stayed = moves_ridges.hardly_damped_chain(right)
    np.testing.assert_array_equal(stayed.at.shared, right.at.shared)


def test_other_chains_differ_in_nothing_but_the_chain_and_the_tolerances(found: Fitted) -> None:
    names, other = with_contact_and_shaft(found, 6e5, 7e5)
    tried = list(moves_ridges.other_chains(other))
    assert len(tried) == moves_ridges.CHAINS
    for at_random in tried:
        changed = {n for n, a, b in zip(names, other.at.shared, at_random, strict=True) if a != b}
        assert {"gear_mass", "pinion_stiffness", "clock_offset"} <= changed
        assert not changed & {"backlash", "coulomb", "viscous", "contact_stiffness"}
        assert at_random[names.index("clock_offset")] == 0.0
        assert np.all(np.abs(at_random) <= FAR)
    np.testing.assert_array_equal(tried, list(moves_ridges.other_chains(other)))


def test_an_effect_of_another_size_is_begun_out_of_the_corner_that_the_wrong_one_drove_friction_into(
    found: Fitted,
) -> None:
    """A hung mass at 22 Hz, where it swings at 28 Hz, took the guide's friction for its damping."""
    model = Model(("X1",), 2, (DrivenHungMass(("X1",)),), "whole_move", ("constant", "skew"), bridge=False)
    names = [p.name.removeprefix("X1.") for p in model.parameters]
    shared = np.zeros(len(names))
    shared[[names.index(name) for name in ("backlash", "coulomb", "hung_ratio", "hung_frequency")]] = (
        0.7,
        -5.0,
        2.0,
        -2.0,
    )
    tried = list(moves_ridges.other_sizes(replace(found, model=model, at=Point(shared, found.at.local))))
    assert len(tried) == moves_ridges.CHAINS
    for at in tried:
        own = [k for k, name in enumerate(names) if name.startswith("hung_")]
        assert np.all(at[own] != shared[own])
        np.testing.assert_allclose(
            np.delete(at, own), [0.7 * (n == "backlash") for n in names if "hung" not in n]
        )


def test_a_contact_that_is_stiffer_than_the_shaft_may_be_the_shaft(found: Fitted) -> None:
    names, other = with_contact_and_shaft(found, 2e6, 7e5)
    exchanged, *at_random = moves_ridges.other_chains(other)
    assert len(at_random) == moves_ridges.CHAINS
    for name, now in (("contact_stiffness", 7e5), ("pinion_stiffness", 2e6)):
        k = names.index(name)
        assert found.model.parameters[k].value(exchanged[k]) == pytest.approx(now)
    others = [k for k, name in enumerate(names) if name not in ("contact_stiffness", "pinion_stiffness")]
    np.testing.assert_allclose(exchanged[others], other.at.shared[others], atol=1e-9)


def with_contact_and_shaft(found: Fitted, contact: float, shaft: float) -> tuple[list[str], Fitted]:
    """A fit's numbers by name, and the fit with two stiffnesses of these values and a clock that is off."""
    names = [p.name.removeprefix("X1.") for p in found.model.parameters]
    shared = found.at.shared.copy()
    shared[names.index("clock_offset")] = 1.5
    for name, value in (("contact_stiffness", contact), ("pinion_stiffness", shaft)):
        shared[names.index(name)] = float(found.model.parameters[names.index(name)].internal(value))
    return names, Fitted(found.model, found.moves, Point(shared, found.at.local), found.r, found.free)


def test_friction_is_otherwise_divided_and_as_much_at_the_mean_speed_of_the_moves(found: Fitted) -> None:
    """From a dry guide to one in which half of it and more grows with the speed; nothing else is begun otherwise."""
    values, made = values_at(found), found.moves[0].made
    speed = np.mean([move.length for move in made]) / np.mean([move.duration for move in made])
    friction = values["X1.coulomb"] + speed * values["X1.viscous"]
    shares = []
    for other in otherwise_rubbing(found):
        assert other["X1.coulomb"] + speed * other["X1.viscous"] == pytest.approx(friction)
        assert {k for k in values if other[k] != values[k]} == {"X1.coulomb", "X1.viscous"}
        shares.append(other["X1.coulomb"] / friction)
    assert min(shares) < 0.7 < 0.95 < max(shares)


def test_a_guide_whose_friction_is_otherwise_divided_leads_over_a_ridge(
    monkeypatch: Any, found: Fitted
) -> None:
    """Where no other beginning does: here none is nearer than where the fit stands, which leaves twice the noise."""
    monkeypatch.setattr(moves_ridges, "across", lambda one: one)
    monkeypatch.setattr(moves_ridges, "other_chains", lambda _found: iter(()))
    lost = SimpleNamespace(rms=9.0)
    begun: list[Any] = []

    def fit_of(_few: Any, _model: Any, at: Any, _rounds: int) -> Any:
        begun.append(at)
        return SimpleNamespace(rms=1.0 if at == "dry" else 2.0, at=at, model=found.model)

    monkeypatch.setattr(moves_ridges, "fit", fit_of)
    monkeypatch.setattr(moves_ridges, "speeds_first", lambda *_: lost)
    monkeypatch.setattr(moves_ridges, "otherwise_rubbing", lambda _found: iter(("dry", "oiled")))
    monkeypatch.setattr(moves_ridges, "begun_at", lambda _few, _model, values, _own: values)
    monkeypatch.setattr(moves_ridges, "values_at", lambda one: one.at)
    nearer = replace(found, r=0.5 * found.r)
    monkeypatch.setattr(moves_ridges, "put_back", lambda *_: "back")
    monkeypatch.setattr(moves_ridges, "on_typical_chain", lambda _found: "typical")
    monkeypatch.setattr(
        moves_ridges, "fitted_from", lambda _found, values, _: nearer if values == "dry" else found
    )
    assert over_ridges(found) is nearer
    assert {"dry", "oiled"} <= {at for at in begun if isinstance(at, str)}


def test_what_a_wrong_model_drove_away_is_put_back_and_a_link_that_is_damped_as_none_is(
    monkeypatch: Any,
) -> None:
    names = ("backlash", "coulomb", "contact_stiffness", "gear_stiffness", "gear_mass", "pinion_mass")
    values = {f"X1.{name}": 1.0 for name in names} | {"body_ratio": 0.3}
    monkeypatch.setattr(moves_ridges, "values_at", lambda _found: values)
    found = cast(Any, SimpleNamespace(model=Model(("X1",), 2)))
    for odd, too, gone in (
        ((), (), {"coulomb"}),
        (("X1.gear_damping_ratio",), (), {"coulomb", "gear_stiffness", "gear_mass"}),
        ((), ("gear_mass", "pinion_mass"), {"coulomb", "gear_mass", "pinion_mass"}),
    ):
        monkeypatch.setattr(moves_ridges, "overdamped", lambda _found, odd=odd: odd)
        assert set(values) - set(put_back(found, too)) == {f"X1.{name}" for name in gone}


def test_all_but_play_friction_and_effects_is_typical(monkeypatch: Any) -> None:
    names = ("backlash", "coulomb", "viscous", "contact_stiffness", "gear_mass", "clock_offset", "hung_ratio")
    values = {f"X1.{name}": 1.0 for name in names}
    monkeypatch.setattr(moves_ridges, "values_at", lambda _found: values)
    declared = Model(("X1",), 2)
    model = replace(declared, effects=(*declared.effects, DrivenHungMass(("X1",))))
    kept = on_typical_chain(cast(Any, SimpleNamespace(model=model)))
    assert set(kept) == {"X1.backlash", "X1.coulomb", "X1.viscous", "X1.hung_ratio"}
    assert "X1.hung_ratio" not in on_typical_chain(cast(Any, SimpleNamespace(model=declared)))


def with_a_hung_mass(found: Fitted, frequency: float) -> Fitted:
    """The fit of a clean machine with a hung mass of its typical ratio that swings at a frequency [Hz]."""
    model = replace(found.model, effects=(*found.model.effects, DrivenHungMass(("X1",))))
    shared = shared_at(model, {**values_at(found), "X1.hung_frequency": frequency, "X1.hung_ratio": 0.15})
    return fit(found.moves, model, Point(shared, widened(found.at.local, model)), 0)


def test_a_mass_that_swings_at_another_frequency_than_where_a_fit_ended_is_found_at_it(found: Fitted) -> None:
    """Moves made with a mass that swings at 32 Hz, and a fit that took it for one at 13 Hz."""
    right = with_a_hung_mass(found, 32.0)
    (part,) = right.moves
    said = predict(part, right.model, right.at.shared[None], right.at.local[0][None]).acceleration()[0]
    noise = part.noise[0] * np.random.default_rng(3).standard_normal(said.shape)
    grids = tuple(replace(g, measured=one) for g, one in zip(part.grids, said + noise, strict=True))
    made = replace(right, moves=(replace(part, grids=grids),))
    names = [p.name for p in right.model.parameters]
    wrong = made.at.shared.copy()
    k = names.index("X1.hung_frequency")
    wrong[k] = float(right.model.parameters[k].internal(13.0))
    ended = fit(made.moves, right.model, Point(wrong, made.at.local), ROUNDS)
    assert ended.value("X1.hung_frequency") < 25.0, "the fit by itself does not find to it"
    again = swinging_otherwise(ended)
    assert again.value("X1.hung_frequency") == pytest.approx(32.0, rel=0.03)
    assert again.rms < 0.5 * ended.rms


def test_what_does_not_swing_is_not_looked_for_at_other_frequencies(found: Fitted) -> None:
    assert swinging_otherwise(found) is found


def test_what_swings_is_begun_on_the_machines_of_given_places_too(monkeypatch: Any, found: Fitted) -> None:
    swinging, asked = with_a_hung_mass(found, 32.0), list[Any]()
    here = SimpleNamespace(rms=1.0)
    monkeypatch.setattr(moves_ridges, "fit", lambda *_: here)
    monkeypatch.setattr(
        moves_ridges, "at_all_frequencies", lambda _few, _model, machines: asked.extend(machines) or []
    )
    monkeypatch.setattr(moves_ridges, "if_nearer", lambda found, _here, _others: found)
    place = {"X1.gear_mass": 0.05}
    assert swinging_otherwise(swinging, (place,)) is swinging
    assert asked == [put_back(swinging), place]


def test_every_frequency_is_begun_with_as_strong_as_it_may_well_be(monkeypatch: Any, found: Fitted) -> None:
    model = replace(found.model, effects=(*found.model.effects, DrivenHungMass(("X1",))))
    begun: list[dict[str, float]] = []
    continued: list[float] = []

    def fit(_few: Any, _model: Any, at: Any, rounds: int, *, free: Any = None) -> Any:
        """The nearer the further from 20 Hz they are begun."""
        if free is None and rounds == moves_ridges.BRIEF - moves_ridges.QUICK:
            continued.append(at)
        return SimpleNamespace(at=at, rms_with_motors=1.0 / abs(np.log(at / 20.0)))

    def point_at(_model: Any, values: dict[str, float], _few: Any) -> float:
        begun.append(values)
        return values["X1.hung_frequency"]

    monkeypatch.setattr(moves_ridges, "point_at", point_at)
    monkeypatch.setattr(moves_ridges, "fit", fit)
    fits = at_all_frequencies(
        found.moves,
        model,
        ({"X1.gear_mass": 0.2, "X1.hung_ratio": 1e-4}, {"X1.gear_mass": 0.1, "X1.latency": 1e-3}),
    )
    assert [one.at for one in fits] == continued
    assert len(continued) == 8 and all(hz < 6.5 or hz > 60.0 for hz in continued)
    ratio = next(p for p in model.parameters if p.name == "X1.hung_ratio")
    assert {(one["X1.gear_mass"], one["X1.hung_ratio"]) for one in begun} == {
        (0.2, ratio.spread),
        (0.1, ratio.spread),
    }
    assert not any("X1.latency" in one for one in begun), "the smooth fit has more than the model"
    frequencies = [one["X1.hung_frequency"] for one in begun if one["X1.gear_mass"] == 0.2]
    assert frequencies == [one["X1.hung_frequency"] for one in begun if one["X1.gear_mass"] == 0.1]
    assert (frequencies[0], frequencies[-1]) == pytest.approx((6.0, 120.0))
    assert np.all(np.diff(np.log(frequencies)) < 0.12)
