"""Where loads and pinions lie when a move begins."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from service.backlash.moves import Moves, moves_of
from service.backlash.moves_begun import point_at, shared_at
from service.backlash.moves_fit import Fitted
from service.backlash.moves_parts import some_of
from service.backlash.moves_point import Point, every
from service.backlash.moves_predicted import predict
from service.captures import read_capture
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_transmission import DrivenClearance, DrivenPreload
from service.identification import moves_lying
from service.identification.moves_lying import (
    LYING,
    as_left_and_told,
    costs_of,
    elsewhere,
    first_elsewhere,
    left_lying,
    lying_as_left,
    lying_now,
    motors_asked,
    pinions,
    pinions_lie,
    places,
)
from service.identification.moves_valleys import as_anywhere, as_left, places_of_loads
from service.recording import FloatArray
from tests.undeclared import capture
from tests.undeclared.generate import Campaign, cases, channels, simulate_batch
from tests.undeclared.machine import TICK

CLOSE = 1.5e-6
"""How near to where it lay a pinion must be told to lie [m]: its gap is some tens of \u00b5m wide."""


@dataclass(frozen=True)
class Chattering:
    """A machine with two gaps, simulated by other code: its moves, the model with its numbers, where its pinion lay
    when each move began, beside the motor [m]: (T,)."""

    moves: Moves
    model: Model
    at: Point
    pinion: FloatArray


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Chattering:
    """The train recording of the first machine of a campaign."""
    case = cases(Campaign("gearbox_clearance", 1, 53, pairs=True), 0)[0]
    traces, _, _ = simulate_batch([case])
    m, path = case.machines[0], tmp_path_factory.mktemp("lying") / "train.parquet"
    about = capture.metadata(["X1"], m["transmission"], case.sensor, case.steps, case.declared)
    capture.write(path, channels(case, traces, 0), about, None)
    moves = moves_of(read_capture(path), ("X1",))
    model = Model(("X1",), 2, (DrivenClearance(("X1",)),), "whole_move", ("constant", "skew"), bridge=False)
    ticks = np.round(moves.start / TICK).astype(int)
    motor = traces.motor_position[ticks, 0]
    pinion = traces.flank[ticks, 0] + traces.load_position[ticks, 0] - motor
    at = point_at(model, planted(m), [moves])
    return Chattering(moves, model, at, pinion)


def planted(m: dict[str, float]) -> dict[str, float]:
    """The values of the model that are the machine's: all per moved mass."""
    per = {
        name: m[name] / m["m_load"] for name in ("kp", "k_gear", "k_shaft", "m_gear", "m_pinion", "fc", "fv")
    }
    return {
        "X1.backlash": m["backlash"],
        "X1.clearance": m["clearance"],
        "X1.contact_stiffness": per["kp"],
        "X1.gear_stiffness": per["k_gear"],
        "X1.gear_mass": per["m_gear"],
        "X1.pinion_stiffness": per["k_shaft"],
        "X1.pinion_mass": per["m_pinion"],
        "X1.coulomb": per["fc"],
        "X1.viscous": per["fv"],
        "X1.pinion_friction": m["fc_pinion"] / m["m_load"],
        "X1.pinion_viscous": m["fv_pinion"] / m["m_load"],
    }


def test_the_move_before_tells_where_a_pinion_lies(machine: Chattering) -> None:
    """Friction holds it inside its gap, and not at either end."""
    ((_, left),) = left_lying(
        machine.moves, machine.model, machine.at.shared[None], machine.at.local[0][None]
    ).items()
    assert np.isnan(left[0, 0]), "nothing is known of what was before the first"
    assert np.max(np.abs(left[0, 1:] - machine.pinion[1:])) < CLOSE
    half = 0.5 * machine.model.numbers(machine.at.shared)["X1.clearance"]
    assert np.max(np.abs(machine.pinion[1:])) < half - CLOSE, "else any end would do"


def test_after_a_while_a_pinion_lies_still_and_only_its_motor_moves(
    machine: Chattering, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However long the rests are, they are simulated for a while only."""
    lasted = 0.18
    rests = np.diff(machine.moves.start) - machine.moves.h * machine.moves.samples
    assert np.min(rests) > lasted + 0.1
    monkeypatch.setattr(moves_lying, "HELD_AFTER", lasted)
    (left,) = left_lying(
        machine.moves, machine.model, machine.at.shared[None], machine.at.local[0][None]
    ).values()
    assert np.max(np.abs(left[0, 1:] - machine.pinion[1:])) < CLOSE


def test_in_a_part_of_a_recording_the_first_lies_like_the_third(machine: Chattering) -> None:
    few = some_of(machine.moves, 4)
    local = machine.at.local[0][1:5]
    ((_, left),) = left_lying(few, machine.model, machine.at.shared[None], local[None]).items()
    assert np.max(np.abs(left[0] - machine.pinion[1:5])) < CLOSE
    (alone,) = left_lying(
        some_of(machine.moves, 1), machine.model, machine.at.shared[None], local[None, :1]
    ).values()
    assert np.isnan(alone).all()


def test_a_pinion_as_left_is_known_closely_and_the_load_stays_where_it_lay(machine: Chattering) -> None:
    (moves,), at = lying_as_left([machine.moves], machine.model, machine.at)
    ((k, p),) = pinions(machine.model)
    assert moves.swings is not None
    assert moves.swings.width[0] == 1.0
    assert np.all(moves.swings.width[1:] == LYING)
    now = lying_now(moves, machine.model, at.shared[None], at.local[0][None], k)[0]
    assert np.max(np.abs(now[1:] - machine.pinion[1:])) < CLOSE
    before, after = (loads_of(m, machine.model, a) for m, a in ((machine.moves, machine.at), (moves, at)))
    assert after == pytest.approx(before, abs=1e-12)
    moved = at.local[0].copy()
    moved[:, k] += 1.0
    lies = lying_now(moves, machine.model, at.shared[None], moved[None], k)[0] - now
    assert lies[1:] == pytest.approx(LYING * p.spread)
    (again,), at_again = lying_as_left([moves], machine.model, at)
    assert loads_of(again, machine.model, at_again) == pytest.approx(before, abs=1e-12)


def loads_of(moves: Moves, model: Model, at: Point) -> FloatArray:
    """Where the loads lie when their moves begin (T,)."""
    return np.asarray(
        predict(moves, model, at.shared[None], at.local[0][None]).states[0, :, 0, model.load(0)]
    )


def test_the_same_point_among_moves_that_do_not_say_where_pinions_lie(machine: Chattering) -> None:
    (moves,), at = lying_as_left([machine.moves], machine.model, machine.at)
    plain = as_anywhere(Fitted(machine.model, (moves,), at, np.zeros(10), every(machine.model)))
    said = [
        predict(m, machine.model, a.shared[None], a.local[0][None])
        for m, a in ((moves, at), (machine.moves, plain))
    ]
    assert said[1].acceleration() == pytest.approx(said[0].acceleration(), rel=1e-9, abs=1e-9)


def test_sets_begin_with_their_own_pinions_and_the_loads_of_the_fit_before(machine: Chattering) -> None:
    """However their play is divided."""
    shared = np.stack([machine.at.shared, machine.at.shared])
    names = [p.name for p in machine.model.parameters]
    shared[1, names.index("X1.backlash")] -= 0.1
    local = np.stack([machine.at.local[0]] * 2)
    where = places_of_loads(machine.moves, machine.model, machine.at.shared, machine.at.local[0])
    sets = as_left(machine.moves, machine.model, shared, local, where)
    before = loads_of(machine.moves, machine.model, machine.at)
    for one, own in zip(shared, sets, strict=True):
        assert loads_of(machine.moves, machine.model, Point(one, (own,))) == pytest.approx(before, abs=1e-12)
    ((k, p),) = pinions(machine.model)
    assert np.max(np.abs(p.value(sets[0, 1:, k]) - machine.pinion[1:])) < CLOSE


def test_elsewhere_begins_no_move_farther_from_what_was_measured(machine: Chattering) -> None:
    """With pinions at the wrong end of their gaps."""
    ((k, p),) = pinions(machine.model)
    wrong = machine.at.local[0].copy()
    half = 0.5 * machine.model.numbers(machine.at.shared)["X1.clearance"]
    wrong[:, k] = p.internal(-np.sign(machine.pinion) * half)
    at = Point(machine.at.shared, (wrong,))
    asked = motors_asked([machine.moves], machine.model, at)
    assert asked[0].motors, "the motors of a recording with torque are asked"
    found = elsewhere(asked, machine.model, at)
    first, then = (costs_of(asked[0], machine.model, one, one.local[0][None])[0] for one in (at, found))
    assert np.all(then <= first)
    assert np.sum(then) < 0.5 * np.sum(first)


def test_the_first_pinion_of_a_recording_lies_where_its_move_is_described_best(machine: Chattering) -> None:
    """Begun at the other end of its gap, among moves that know where those before them left theirs."""
    ((k, p),) = pinions(machine.model)
    wrong = machine.at.local[0].copy()
    half = 0.5 * machine.model.numbers(machine.at.shared)["X1.clearance"]
    wrong[0, k] = p.internal(-np.sign(machine.pinion[0]) * half)
    moves, at = lying_as_left([machine.moves], machine.model, Point(machine.at.shared, (wrong,)))
    asked = motors_asked(moves, machine.model, at)
    found = first_elsewhere(asked, machine.model, at)
    assert np.array_equal(found.local[0][1:], at.local[0][1:])
    lies = lying_now(asked[0], machine.model, found.shared[None], found.local[0][None], k)[0]
    assert abs(lies[0] - machine.pinion[0]) < 2.0 * CLOSE < half
    later = replace(asked[0], grids=tuple(replace(g, index=g.index + 3) for g in asked[0].grids))
    assert np.array_equal(first_elsewhere([later], machine.model, at).local[0], at.local[0])


def test_places_leave_a_pinion_where_the_move_before_left_it(machine: Chattering) -> None:
    ((k, _),) = pinions(machine.model)
    (moves,), at = lying_as_left([machine.moves], machine.model, machine.at)
    own, half = at.local[0], 0.5 * machine.model.numbers(at.shared)["X1.clearance"]
    tried = np.stack(list(places(moves, machine.model, at, own)))
    assert np.array_equal(tried[:, 1:, k], np.tile(own[1:, k], (len(tried), 1)))
    lies = np.array([lying_now(moves, machine.model, at.shared[None], one[None], k)[0, 0] for one in tried])
    assert (lies.min(), lies.max()) == pytest.approx((-half, half))


def test_held_out_pinions_lie_where_moves_and_motors_say(machine: Chattering) -> None:
    found = Fitted(machine.model, (machine.moves,), machine.at, np.zeros(10), every(machine.model))
    (moves,), at = as_left_and_told(found, 0.45)
    ((k, _),) = pinions(machine.model)
    now = lying_now(moves, machine.model, at.shared[None], at.local[0][None], k)[0]
    assert np.max(np.abs(now[1:] - machine.pinion[1:])) < CLOSE


def test_nothing_lies_anywhere_where_there_is_one_gap(machine: Chattering) -> None:
    model = Model(("X1",), 2, (DrivenPreload(("X1",)),), "whole_move", ("constant", "skew"), bridge=False)
    assert not pinions_lie(model)
    at = Point(shared_at(model, {}), (np.zeros((len(machine.moves.grids), 2)),))
    moves, same = lying_as_left([machine.moves], model, at)
    assert moves == (machine.moves,)
    assert same is at
