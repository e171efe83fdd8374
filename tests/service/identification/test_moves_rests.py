"""What swings through the rests between moves, and how a move begins by it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from service.backlash.moves import Moves, moves_of
from service.backlash.moves_begun import point_at
from service.backlash.moves_fit import Fitted
from service.backlash.moves_point import Point, every, resting
from service.backlash.moves_predicted import left_over, predict, simulated
from service.captures import read_capture
from service.dynamics.driven import wider
from service.dynamics.driven_model import Model
from service.dynamics.driven_motion import of_motors
from service.dynamics.effects.driven_bodies import DrivenHungMass, DrivenMachineBody, free_swing
from service.dynamics.effects.driven_guide import DrivenCurvedFriction
from service.dynamics.effects.driven_sensors import DrivenBias, DrivenGain
from service.dynamics.effects.driven_transmission import DrivenClearance, DrivenLocalBacklash, DrivenPreload
from service.identification import held_out
from service.identification.held_out import no_such_effect, too_heavy
from service.identification.moves_rests import KNOWN, at_near_frequencies, swinging_on
from tests.service.identification.a_machine import MACHINE


@pytest.fixture(scope="module")
def moves(request: pytest.FixtureRequest) -> Moves:
    shared: Path = request.getfixturevalue("shared_dir")
    return moves_of(read_capture(shared / "captures" / "none-train.parquet"), ("X1",))


def test_a_free_swing_is_what_an_integrator_makes_of_it() -> None:
    """x\u0308 + 2\u03b6\u03c9x\u0307 + \u03c9\u00b2x = 0, and back again."""
    law, duration = (np.array([13.0]), np.array([0.03])), np.array([0.4])
    begun = {"body_displacement": np.array([2e-4]), "body_speed": np.array([-7e-3])}
    omega = 2 * np.pi * 13.0
    course = solve_ivp(
        lambda _t, y: (y[1], -(omega**2) * y[0] - 2 * 0.03 * omega * y[1]),
        (0.0, 0.4),
        (2e-4, -7e-3),
        rtol=1e-10,
        atol=1e-14,
    )
    after = free_swing("body", law, begun, duration)
    assert after["body_displacement"][0, 0] == pytest.approx(course.y[0, -1], rel=1e-6)
    assert after["body_speed"][0, 0] == pytest.approx(course.y[1, -1], rel=1e-6)
    back = free_swing("body", law, {name: value[0] for name, value in after.items()}, -duration)
    assert back["body_displacement"][0, 0] == pytest.approx(2e-4)
    assert back["body_speed"][0, 0] == pytest.approx(-7e-3)
    assert not free_swing("X1.hung", law, begun, duration), "nothing is known of another body"


@pytest.mark.parametrize("kind", [DrivenHungMass, DrivenMachineBody])
def test_moves_begin_as_before_when_what_is_left_is_told(
    moves: Moves, kind: type[DrivenHungMass] | type[DrivenMachineBody]
) -> None:
    """Only the coordinates count from elsewhere; and begun from there, the moves go through to each other."""
    model = Model(("X1",), 1, (kind(("X1",)),), "whole_move", ("constant", "skew"), bridge=False)
    prefix = "X1.hung" if kind is DrivenHungMass else "body"
    swing = {f"{prefix}_ratio": 0.1, f"{prefix}_frequency": 12.0, f"{prefix}_damping": 0.03}
    at = point_at(model, MACHINE | swing, [moves])
    local = at.local[0].copy()
    local[:, 2:4] = np.random.default_rng(4).normal(0.0, 0.5, (len(local), 2))
    at = Point(at.shared, (local,))
    before = predict(moves, model, at.shared[None], at.local[0][None]).states
    (told,), shifted = swinging_on([moves], model, at, 1.0)
    after = predict(told, model, shifted.shared[None], shifted.local[0][None]).states
    np.testing.assert_allclose(after, before, rtol=0.0, atol=1e-9)

    at, told = replace(at, local=resting([moves], model)), moves
    states = []
    for _ in range(2 + len(local)):
        (told,), _ = swinging_on([told], model, at, 1.0)
        states.append(predict(told, model, at.shared[None], at.local[0][None]).states[0, :, 0])
    assert np.max(np.abs(states[-1][1:, -2])) > 1e-6, "something swings"
    np.testing.assert_allclose(states[-1][:, -2:], states[-2][:, -2:], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("share", [-0.02, 0.012])
def test_of_frequencies_close_by_the_one_is_found_with_which_swings_arrive_as_moves_begin(
    moves: Moves, share: float
) -> None:
    """A fit that is off by one or two parts in a hundred, with every move's beginning as it was."""
    model = Model(("X1",), 1, (DrivenHungMass(("X1",)),), "whole_move", ("constant", "skew"), bridge=False)
    swing = {"X1.hung_ratio": 0.1, "X1.hung_frequency": 12.0, "X1.hung_damping": 0.03}
    at, told = replace(point_at(model, MACHINE | swing, [moves]), local=resting([moves], model)), moves
    for _ in range(2 + len(moves.grids)):
        (told,), _ = swinging_on([told], model, at, 1.0)
    begun = left_over(told, model, model.complete(model.values(at.shared[None])))
    local = at.local[0].copy()
    local[:, :2] += told.loads
    for j, p in enumerate(model.nuisance, 2):
        local[:, j] = begun[p.name][0] / p.spread
    which = [p.name for p in model.parameters].index("X1.hung_frequency")
    shared = at.shared.copy()
    shared[which] = model.parameters[which].internal(12.0 * (1.0 + share))
    found = Fitted(model, (moves,), Point(shared, (local,)), np.zeros(10), every(model))
    near = [float(model.parameters[which].value(one.shared[which])) for one in at_near_frequencies(found)]
    assert near[0] == pytest.approx(12.0, rel=2e-3)
    assert len(near) == 3 and all(abs(other / near[0] - 1.0) > 0.004 for other in near[1:])


def test_a_move_begins_where_the_move_before_left_the_load_also_in_a_gap_that_waves(moves: Moves) -> None:
    """Simulated on through the rest; not half of what the gap is wider there beside it."""
    effects = (DrivenHungMass(("X1",)), DrivenLocalBacklash(("X1",)).refined)
    model = Model(("X1",), 1, effects, "whole_move", ("constant", "skew"), bridge=False)
    swing = {"X1.hung_ratio": 0.1, "X1.hung_frequency": 12.0, "X1.hung_damping": 0.03}
    gap = {"X1.gap_slope": 0.0, "X1.gap_bow": 8.0, "X1.gap_period": 0.02}
    at = replace(point_at(model, MACHINE | swing | gap, [moves]), local=resting([moves], model))
    (told,), at = swinging_on([moves], model, at, 1.0)
    begun = predict(told, model, at.shared[None], at.local[0][None])
    (following,), _ = swinging_on([told], model, at, 1.0)
    said = predict(following, model, at.shared[None], resting([moves], model)[0][None])
    load, K = model.load(0), round(float(moves.start[1] - moves.start[0]) / moves.h)
    c = of_motors([moves.plain] * len(moves.grids), moves.start, moves.h, K, np.zeros((1, 1)))
    through = simulated(told, model, at.shared[None], at.local[0][None], c).states[0, :-1, -1, load]
    wide = wider(begun.cases, begun.states[:, :, 0, [load]])[0, :, 0]
    assert np.ptp(wide) > 3e-5
    np.testing.assert_allclose(said.states[0, 1:, 0, load] - through, 0.0, atol=2e-6)


@pytest.fixture
def well_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every number of a fit is known to a thousandth of its prior's width."""
    monkeypatch.setattr(held_out, "told_by_train", lambda found: 1e-6 * np.eye(len(found.model.parameters)))


@pytest.mark.usefixtures("well_known")
def test_a_swing_that_the_moves_before_did_not_leave_is_none_of_the_machines_own(moves: Moves) -> None:
    model = Model(("X1",), 1, (DrivenHungMass(("X1",)),), "whole_move", ("constant", "skew"), bridge=False)
    swing = {"X1.hung_ratio": 0.1, "X1.hung_frequency": 12.0, "X1.hung_damping": 0.03}
    at = point_at(model, MACHINE | swing, [moves])
    (left_by_it,), _ = swinging_on([moves], model, at, KNOWN[-1])
    near, far = np.zeros(10), np.full(10, 9.0)
    own = ("X1.hung_displacement", "X1.hung_speed")
    assert no_such_effect(Fitted(model, (moves,), at, near, every(model))) == own
    assert no_such_effect(Fitted(model, (left_by_it,), at, near, every(model))) == ()
    assert no_such_effect(Fitted(model, (moves,), at, far, every(model))) == (), (
        "a fit that is far off tells nothing of it"
    )


@pytest.mark.usefixtures("well_known")
@pytest.mark.parametrize(
    ("name", "u", "odd"),
    [
        ("contact_damping_ratio", 4.9, True),
        ("contact_damping_ratio", -4.9, False),
        ("drive_damping_ratio", 4.9, True),
        ("drive_mass", 4.9, False),
        ("drive_mass", -4.9, False),
    ],
)
def test_a_chain_that_no_machine_has_names_nothing(moves: Moves, name: str, u: float, odd: bool) -> None:
    """Such as a contact damped three times over, which makes up for something else; but a heavy gear on a rigid spring
    follows the motor like a light one: a mass at its limit says only that the moves do not tell of it."""
    model = Model(("X1",), 1, (DrivenGain(("X1",)),), "whole_move", ("constant", "skew"), bridge=False)
    at, near = point_at(model, MACHINE | {"X1.gain_error": 0.1}, [moves]), np.zeros(10)
    assert no_such_effect(Fitted(model, (moves,), at, near, every(model))) == ()
    at.shared[[p.name for p in model.parameters].index(f"X1.{name}")] = u
    limits = no_such_effect(Fitted(model, (moves,), at, near, every(model)))
    assert limits == ((f"X1.{name}",) if odd else ())


@pytest.mark.usefixtures("well_known")
@pytest.mark.parametrize(("mass", "heavy"), [(0.2, False), (1.5, True)])
def test_nothing_heavier_than_the_load_lies_between_two_gaps(moves: Moves, mass: float, heavy: bool) -> None:
    """A sensor that rang on its mount was described by a pinion one and a half times as heavy as the carriage."""
    model = Model(("X1",), 1, (DrivenClearance(("X1",)),), "whole_move", ("constant", "skew"), bridge=False)
    at = point_at(model, MACHINE | {"X1.clearance": 3e-5, "X1.drive_mass": mass}, [moves])
    found = Fitted(model, (moves,), at, np.zeros(10), every(model))
    assert too_heavy(found) == (("X1.drive_mass",) if heavy else ())
    assert ("X1.drive_mass" in no_such_effect(found)) == heavy


@pytest.mark.usefixtures("well_known")
@pytest.mark.parametrize(("ratio", "spring"), [(0.05, True), (0.5, False)])
def test_what_brakes_the_load_in_its_gap_and_hardly_pulls_is_no_spring(
    moves: Moves, ratio: float, spring: bool
) -> None:
    """However well the moves are described with it: a film of grease left next to nothing as a spring."""
    model = Model(("X1",), 1, (DrivenPreload(("X1",)),), "whole_move", ("constant", "skew"), bridge=False)
    at = point_at(
        model, MACHINE | {"X1.preload_stiffness": 1400.0, "X1.preload_damping_ratio": ratio}, [moves]
    )
    limits = no_such_effect(Fitted(model, (moves,), at, np.zeros(10), every(model)))
    assert limits == (() if spring else ("X1.preload_damping_ratio",))


@pytest.mark.usefixtures("well_known")
@pytest.mark.parametrize(("drift", "there"), [(0.1, True), (-0.1, True), (1e-9, False)])
def test_an_effect_of_which_there_is_no_amount_is_none(moves: Moves, drift: float, there: bool) -> None:
    """What explains the moves then is what the effect has anew in every move."""
    model = Model(("X1",), 1, (DrivenBias(("X1",)),), "whole_move", ("constant", "skew"), bridge=False)
    at = point_at(model, MACHINE | {"X1.bias_drift": drift}, [moves])
    fitted = Fitted(model, (moves,), at, np.zeros(10), every(model))
    assert no_such_effect(fitted) == (() if there else ("X1.bias_drift",))


@pytest.mark.usefixtures("well_known")
@pytest.mark.parametrize("gain", [0.1, 1e-9])
def test_an_effect_without_coordinates_of_every_move_is_judged_by_other_moves_alone(
    moves: Moves, gain: float
) -> None:
    """Short moves hardly tell how much a friction bends at the speed of long ones."""
    model = Model(("X1",), 1, (DrivenGain(("X1",)),), "whole_move", ("constant", "skew"), bridge=False)
    at = point_at(model, MACHINE | {"X1.gain_error": gain}, [moves])
    assert no_such_effect(Fitted(model, (moves,), at, np.zeros(10), every(model))) == ()


@pytest.mark.parametrize(("left", "limits"), [(1.0, ()), (1.3, ("X1.curved_power",))])
def test_a_shape_at_its_limit_is_none_where_nothing_is_left_to_explain(
    moves: Moves, monkeypatch: pytest.MonkeyPatch, left: float, limits: tuple[str, ...]
) -> None:
    """Of friction at the speeds of short moves hardly anything tells its power: a limit there is where the fit ended,
    and no sign of something else, as long as the longer moves are predicted."""
    model = Model(
        ("X1",), 1, (DrivenCurvedFriction(("X1",)),), "whole_move", ("constant", "skew"), bridge=False
    )
    at = point_at(model, MACHINE | {"X1.curved_level": 0.4, "X1.curved_power": 4.0}, [moves])
    errors = np.random.default_rng(2).normal(0.0, 1.0, (10, 1, 200))
    held = SimpleNamespace(weighed=left * errors / np.std(errors), doubt=1.0)
    monkeypatch.setattr(held_out, "held_out", lambda *_: held)
    monkeypatch.setattr(held_out, "no_such_effect", lambda _found: ())
    found = Fitted(model, (moves,), at, np.full(10, left), every(model))
    scene = cast(Any, SimpleNamespace(validate=None, zero_wanders=False))
    assert held_out.trial_of(scene, found).at_limits == limits


@pytest.mark.usefixtures("well_known")
@pytest.mark.parametrize(("wanders", "limits"), [(True, ()), (False, ("X1.bias_drift",))])
def test_a_zero_that_is_seen_to_wander_at_rest_needs_no_straight_drift(
    moves: Moves, monkeypatch: pytest.MonkeyPatch, wanders: bool, limits: tuple[str, ...]
) -> None:
    """A warm-up that a drift runs against leaves none of it: what there is, is the zero of every step."""
    model = Model(("X1",), 1, (DrivenBias(("X1",)),), "whole_move", ("constant", "skew"), bridge=False)
    at = point_at(model, MACHINE | {"X1.bias_drift": 1e-9}, [moves])
    held = SimpleNamespace(weighed=np.random.default_rng(2).normal(0.0, 1.0, (10, 1, 200)), doubt=1.0)
    monkeypatch.setattr(held_out, "held_out", lambda *_: held)
    found = Fitted(model, (moves,), at, np.zeros(10), every(model))
    scene = cast(Any, SimpleNamespace(validate=None, zero_wanders=wanders))
    assert held_out.trial_of(scene, found).at_limits == limits
