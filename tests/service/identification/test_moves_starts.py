"""Where fits of an added effect are started, and with how many moves starts are compared."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.backlash.moves import moves_of
from service.backlash.moves_fit import fit
from service.backlash.moves_point import Point
from service.backlash.moves_refined import reconstructed
from service.captures import read_capture
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_library import DRIVEN
from service.identification import moves_starts
from service.recording import Move
from tests.service.identification.a_search import stub

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
