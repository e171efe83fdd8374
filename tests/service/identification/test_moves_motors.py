"""The motors' equations of motion beside the accelerometer's samples in a fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.backlash import moves_refined
from service.backlash.moves import Moves
from service.backlash.moves_fit import Fitted, fit, jacobian
from service.backlash.moves_parts import early_part, some_of
from service.backlash.moves_point import every
from service.backlash.moves_predicted import predict, residuals
from service.backlash.moves_refined import hearing_motors, reconstructed
from service.identification import moves_motors
from service.identification.moves_motors import CONTRADICTED, left_by_motors, plainly_against
from service.identification.moves_valleys import asked as of_few
from service.recording import FloatArray, Recording, Trace


@pytest.fixture(scope="module")
def asked(found: Fitted) -> Fitted:
    """The fit with its motors asked."""
    moves = reconstructed(found, asked=True)
    return replace(found, moves=moves)


def test_what_the_motors_say_stands_behind_the_samples_of_their_move(asked: Fitted) -> None:
    moves = asked.moves[0]
    said = predict(moves, asked.model, asked.at.shared[None], asked.at.local[0][None])
    all_rows, samples = residuals(moves, said)[0], residuals(replace(moves, motors=()), said)[0]
    np.testing.assert_array_equal(all_rows[moves.of_samples], samples)
    last = moves.ends[3] + int(np.sum(moves.used[3]))
    own = moves.motors[3][0].of(said.force()[:, 3, 0])[0]
    np.testing.assert_array_equal(all_rows[last : moves.ends[4]], own)
    assert len(all_rows) == moves.ends[-1]


def test_parts_of_the_moves_keep_their_own_motors(asked: Fitted) -> None:
    moves = asked.moves[0]
    assert some_of(moves, 2).motors == moves.motors[1:3]
    assert early_part(moves, 0.5).motors == ()


def test_a_fit_counts_what_the_motors_say_and_returns_samples_alone(asked: Fitted, found: Fitted) -> None:
    on = fit(asked.moves, asked.model, asked.at, 2)
    assert len(on.r) == len(found.r)
    assert not any(part.motors for part in on.moves)
    alone = fit([replace(part, motors=()) for part in asked.moves], asked.model, asked.at, 2)
    assert np.any(on.at.shared != alone.at.shared)


def test_the_torque_alone_tells_viscous_friction_to_a_tenth(asked: Fitted) -> None:
    """By the accelerometer it is known from when the flanks meet; the torque has to overcome it all the way."""
    k = [p.name for p in asked.model.parameters].index("X1.viscous")
    known = []
    for moves in (asked.moves, [replace(part, motors=()) for part in asked.moves]):
        r, slopes = jacobian(moves, asked.model, asked.at, every(asked.model))
        H, _ = slopes.normal(r)
        known.append(1.0 / float(np.linalg.inv(H + np.eye(len(H)))[k, k]))
    assert known[0] - known[1] > 1.0 / 0.1**2


def test_the_motors_are_heard_over_their_noise_where_valleys_are_told_apart(found: Fitted) -> None:
    (few,) = of_few(found)
    assert len(few.grids) < len(found.moves[0].grids)
    own = [np.concatenate([rows.of(np.zeros((1, few.samples + 1)))[0] for rows in of]) for of in few.motors]
    assert np.sqrt(np.mean(np.concatenate(own) ** 2)) > 5.0, "the load is felt far over the noise"


def with_more_torque(found: Fitted, more: Callable[[FloatArray], FloatArray]) -> Fitted:
    """The fit on moves whose motor gives this torque besides [N m], by times [s]."""
    recording = found.moves[0].recording
    torque = recording.traces["X1", "motor_torque"]
    more_of_it = Trace(torque.time, torque.value + more(torque.time))
    disturbed = replace(recording, traces={**recording.traces, ("X1", "motor_torque"): more_of_it})
    return replace(found, moves=(replace(found.moves[0], recording=disturbed),))


def test_a_force_that_the_model_does_not_know_contradicts_it(found: Fitted) -> None:
    """Something between motor and load holds the motor back for a few milliseconds in the middle of every move."""

    def pulse(time: FloatArray) -> FloatArray:
        out = np.zeros(len(time))
        for move in found.moves[0].recording.moves:
            into = (time - move.start) / move.duration
            out += 0.2 * move.direction * np.exp(-(((into - 0.4) / 0.03) ** 2))
        return out

    assert 0.5 < left_by_motors(found)[0] < CONTRADICTED
    assert left_by_motors(with_more_torque(found, pulse))[0] > CONTRADICTED


def test_what_repeats_with_the_motors_position_is_taken_off_and_what_repeats_in_time_is_not(
    found: Fitted,
) -> None:
    place = found.moves[0].plain[0]

    def cogging(time: FloatArray) -> FloatArray:
        return np.asarray(0.2 * np.sin(2.0 * np.pi * place(time) / 0.9e-3 + 1.0))

    def humming(time: FloatArray) -> FloatArray:
        return np.asarray(0.2 * np.sin(2.0 * np.pi * time / 9e-3))

    cogs, hums = (left_by_motors(with_more_torque(found, more))[0] for more in (cogging, humming))
    assert cogs < 0.6 * hums


def test_motors_whose_equations_hold_worse_than_their_noise_say_the_less(found: Fitted) -> None:
    def humming(time: FloatArray) -> FloatArray:
        return np.asarray(0.2 * np.sin(2.0 * np.pi * time / 9e-3))

    def left(one: Fitted, moves: Sequence[Moves]) -> float:
        return float(np.sqrt(np.mean(fit(moves, one.model, one.at, 0).motors ** 2)))

    hums = with_more_torque(found, humming)
    assert left(hums, reconstructed(hums, asked=True)) > 1.5
    assert left(hums, hearing_motors(hums)) == pytest.approx(1.0)


def test_motors_that_leave_less_than_their_noise_say_no_more(monkeypatch: Any, found: Fitted) -> None:
    """So the noise is put at too much, or a fit follows it: neither makes them better witnesses."""
    (part,) = reconstructed(found, asked=True)
    quiet = replace(part, motors=tuple(tuple(rows.over(3.0) for rows in move) for move in part.motors))
    monkeypatch.setattr(moves_refined, "reconstructed", lambda *_, **__: (quiet,))
    (heard,) = hearing_motors(found)
    np.testing.assert_array_equal(heard.motors[0][0].weight, quiet.motors[0][0].weight)


def test_without_torque_the_samples_alone_are_fitted_and_nothing_contradicts(found: Fitted) -> None:
    def without(recording: Recording) -> Recording:
        traces = {key: trace for key, trace in recording.traces.items() if key[1] != "motor_torque"}
        return replace(recording, traces=traces)

    moves = tuple(replace(part, recording=without(part.recording)) for part in found.moves)
    silent = replace(found, moves=moves)
    assert not any(part.motors for part in reconstructed(silent, asked=True))
    assert left_by_motors(silent)[0] == 0.0


@pytest.mark.parametrize(
    ("motors", "samples", "against"),
    [((7.0, 8.2), 1.1, True), ((7.0, 2.6), 1.1, False), ((7.0, 4.5), 2.0, False), ((0.0, 0.0), 1.1, False)],
    ids=["no less", "far less", "not plainly", "no torque"],
)
def test_the_motors_speak_against_what_they_contradict_plainly_and_hardly_less(
    monkeypatch: pytest.MonkeyPatch, motors: tuple[float, float], samples: float, against: bool
) -> None:
    monkeypatch.setattr(moves_motors, "left_by_motors", lambda left: np.array([0.2, left]))
    before, after = (
        SimpleNamespace(train_rms=samples, model=SimpleNamespace(fitted=left)) for left in motors
    )
    assert plainly_against(cast(Any, before), cast(Any, after)) is against
