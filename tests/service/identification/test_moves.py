"""Whole moves as a problem of output error: what is expected of residuals, and what a prediction may see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from service.backlash.expected_errors import WAYS, expected_errors, speed_errors, wander_of
from service.backlash.moves import Moves, moves_of, sensor_zero
from service.backlash.moves_begun import begun_anew
from service.backlash.moves_fit import Fitted, fit
from service.backlash.moves_point import Point
from service.backlash.moves_predicted import REST_SPREAD, predict
from service.backlash.moves_refined import rms_of_moves
from service.backlash.rest_noise import noise_at_rest, sample_noise
from service.backlash.signals import summed
from service.identification.held_out import told_by_train
from service.identification.moves_end import steady
from service.identification.scene import smeared
from service.recording import Recording, Trace


def test_residuals_of_speed_fade_by_their_share_and_stay_white_ones_of_one() -> None:
    impulse = np.zeros((2, 5))
    impulse[1, 1] = 1.0
    faded = np.sqrt(1.0 - 0.8**2) * 0.8 ** np.arange(4)
    np.testing.assert_allclose(summed(impulse, 0.8)[1], [0.0, *faded], rtol=1e-12)
    np.testing.assert_array_equal(summed(impulse, 0.8)[0], 0.0)
    noise = np.random.default_rng(8).normal(0.0, 1.0, 200_000)
    assert np.std(summed(noise, 0.95)) == pytest.approx(1.0, abs=0.03)


def test_a_noisier_drive_makes_larger_errors_expected(
    captures: tuple[Recording, Recording], found: Fitted
) -> None:
    train, rng = captures[0], np.random.default_rng(5)
    speed = train.traces["X1", "motor_speed"]
    noisy = Trace(speed.time, speed.value + 0.05 * rng.standard_normal(len(speed)))
    loud = moves_of(replace(train, traces={**train.traces, ("X1", "motor_speed"): noisy}), ("X1",))
    quiet = found.moves[0]
    assert sample_noise(noisy, train) == pytest.approx(0.05, rel=0.1)
    spreads = [
        expected_errors(m, found.model, found.at.shared, found.at.local[0], fitted=True)[0]
        for m in (quiet, loud)
    ]
    assert np.all(spreads[0] >= 1.0)
    assert np.mean(spreads[1]) > 2.0 * np.mean(spreads[0])


@pytest.mark.parametrize("noise", [0.01, 0.1])
def test_what_the_noise_of_the_speed_does_to_force_and_acceleration_is_expected(
    captures: tuple[Recording, Recording], found: Fitted, noise: float
) -> None:
    """A load that is about to come off a flank does so in one recording and not in the other: there all samples
    together do what none of them does alone (7 times as much beside the larger noise, before this was expected)."""
    train, rng = captures[0], np.random.default_rng(5)
    speed, shared, own = train.traces["X1", "motor_speed"], found.at.shared, found.at.local[0]

    def with_noise() -> Moves:
        value = speed.value + noise * rng.standard_normal(len(speed))
        traces = {**train.traces, ("X1", "motor_speed"): Trace(speed.time, value)}
        moves = moves_of(replace(train, traces=traces), ("X1",))
        return replace(moves, noise_left=(np.ones(len(speed)),))

    expected = expected_errors(with_noise(), found.model, shared, own, fitted=True)
    courses = [predict(with_noise(), found.model, shared[None], own[None]) for _ in range(30)]
    over_noise = np.concatenate([course.acceleration() for course in courses]) / found.moves[0].noise[:, None]
    force = np.concatenate([course.force() for course in courses])
    off = np.sqrt(np.sum(expected.force**2, axis=0))
    for drawn, spread in ((over_noise, expected.acceleration), (force, off)):
        ratio = np.std(drawn, axis=0, ddof=1) / np.maximum(spread, 1e-3)
        assert np.quantile(ratio, 0.99) < 4.0
    moved = expected.acceleration > 2.0
    of_speed = np.sqrt(expected.acceleration**2 - 1.0)
    assert np.median((np.std(over_noise, axis=0) / of_speed)[moved]) == pytest.approx(0.95, abs=0.2)
    acts = off > 0.1 * np.max(off)
    assert np.median(np.std(force, axis=0)[acts] / off[acts]) == pytest.approx(0.95, abs=0.2)


def test_the_errors_of_single_samples_add_up_to_the_error_of_all(
    captures: tuple[Recording, Recording],
) -> None:
    """A spline is linear in its samples: one standard deviation on all of them is a speed that is off by as much."""
    moves, speed = moves_of(captures[0], ("X1",)), captures[0].traces["X1", "motor_speed"]
    moves = replace(moves, noise_left=(np.ones(len(speed)),))
    together = speed_errors(moves, 0, 0.0).sum(axis=0)[0]
    off = sample_noise(speed, captures[0]) * captures[0].axis("X1").transmission
    np.testing.assert_allclose(together[:, 1], off, rtol=1e-9)
    np.testing.assert_allclose(together[:, 0], off * moves.h * np.arange(moves.samples), atol=1e-15)


def test_a_wander_of_a_few_ways_is_whitened_to_the_identity() -> None:
    """(I − C·Cᵀ)·D^(−1/2) makes the covariance D + G·Gᵀ white, for any G of as few ways as are kept."""
    rng = np.random.default_rng(8)
    shape = (1, 1, 40)
    used = np.ones(shape, dtype=bool)
    used[..., 7] = False
    together = 3.0 * rng.standard_normal((WAYS, *shape)) * used
    beside = 1.0 + rng.random(shape)
    wander = wander_of(together, beside, used)
    columns = np.concatenate(
        (together, np.sqrt(beside)[0, 0, :, None, None, None] * np.eye(40)[:, None, None, :])
    )
    columns = np.where(used, columns, np.nan)
    white = wander.whitened(columns, used)[:, 0, 0]
    np.testing.assert_allclose(white.T @ white, np.diag(used[0, 0].astype(float)), atol=1e-9)
    columns[..., 8] = np.nan
    assert np.all(
        np.isnan(wander.whitened(columns, used)[..., used[0, 0]])
    )  # a simulation that ran away stays one


def test_a_fit_that_was_ended_early_and_its_motion_go_on_until_they_agree(
    captures: tuple[Recording, Recording], found: Fitted
) -> None:
    """Coulomb and viscous friction traded for one another as far as the gap's crossing does not tell them apart."""
    names = [p.name for p in found.model.parameters]
    moves = tuple(
        replace(m, wander=expected_errors(m, found.model, found.at.shared, own, fitted=True)[1])
        for m, own in zip(found.moves, found.at.local, strict=True)
    )
    shared = found.at.shared.copy()
    shared[names.index("X1.coulomb")] += 0.2
    shared[names.index("X1.viscous")] -= 0.2
    off = fit(moves, found.model, Point(shared, found.at.local), 0)
    ends = [steady(one) for one in (off, Fitted(found.model, moves, found.at, found.r, found.free))]
    for name in ("X1.coulomb", "X1.viscous", "X1.backlash"):
        k = names.index(name)
        spread = np.sqrt(told_by_train(ends[0])[k, k])
        assert ends[0].at.shared[k] == pytest.approx(ends[1].at.shared[k], abs=0.3 * spread), name
    assert not any(m.white for one in ends for m in one.moves)


def test_noise_at_rest_counts_neither_a_swing_nor_impacts(captures: tuple[Recording, Recording]) -> None:
    train, rng = captures[0], np.random.default_rng(3)
    time = train.traces["X1", "acceleration"].time
    swinging = 2.0 * np.sin(2 * np.pi * 15.0 * time) + 0.03 * rng.standard_normal(len(time))
    swinging[::200] += 5.0
    assert noise_at_rest(Trace(time, swinging), train) == pytest.approx(0.03, rel=0.08)


def test_a_sensors_zero_is_found_beside_a_machine_that_swings_in_the_rests(
    captures: tuple[Recording, Recording],
) -> None:
    """An axis that stands at the beginning and at the end has no mean acceleration, whatever it did between."""
    train, rng = captures[0], np.random.default_rng(8)
    time = train.traces["X1", "acceleration"].time
    along = (time - time[0]) / (time[-1] - time[0])
    speed = along**2 * (1.0 - along) ** 2 * np.sin(2 * np.pi * 11.0 * time)
    swinging = 0.07 + np.gradient(speed, time) + 0.03 * rng.standard_normal(len(time))
    resting = 0.07 + 0.03 * rng.standard_normal(len(time))
    assert sensor_zero(Trace(time, swinging), train, 0.03) == pytest.approx(0.07, abs=0.001)
    assert sensor_zero(Trace(time, resting), train, 0.03) == pytest.approx(0.07, abs=0.001)


def test_smearing_keeps_area_and_place_and_has_its_spread() -> None:
    pulse = np.zeros((1, 1, 101))
    pulse[..., 50] = 1.0
    passed = smeared(pulse, np.array([1.5]))[0, 0]
    k = np.arange(101)
    assert passed.sum() == pytest.approx(1.0)
    assert passed @ k == pytest.approx(50.0, abs=1e-6)
    assert np.sqrt(passed @ (k - 50.0) ** 2) == pytest.approx(1.5, rel=0.01)


def test_a_move_that_begins_at_the_wrong_flank_stands_out_and_is_begun_anew(found: Fitted) -> None:
    """It alone: all others, and all shared numbers, are where they were. Where none stands out, all are."""
    held = np.zeros(0, dtype=np.int64)
    own = fit(found.moves, found.model, found.at, 8, free=held)
    assert begun_anew(own) is own
    local = own.at.local[0].copy()
    local[3, 0] += found.value("X1.backlash") / REST_SPREAD[0]
    wrong = fit(found.moves, found.model, Point(own.at.shared, (local,)), 0)
    assert rms_of_moves(wrong)[3] > 3.0 * rms_of_moves(own)[3]
    again = begun_anew(wrong)
    np.testing.assert_allclose(rms_of_moves(again), rms_of_moves(own), rtol=0.05)
    np.testing.assert_array_equal(again.at.shared, own.at.shared)
    np.testing.assert_array_equal(again.free, wrong.free)
