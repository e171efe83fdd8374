"""What a drive does alike in several moves, told from the noise of its channels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from service.backlash.alike_moves import averaged, groups, made_alike, on_one_course
from service.recording import FloatArray, Move, Trace

NOISE, COUNT, APART = 0.003, 10, 0.4405


def moves(lengths: tuple[float, ...] = (0.004,)) -> tuple[Move, ...]:
    """Moves to and fro, of each length in turn, half a sample of 1 kHz apart in their phase."""
    return tuple(
        Move(0.35 + APART * k, 1 if k % 2 == 0 else -1, lengths[k // 2 % len(lengths)], 200.0, 0.0862)
        for k in range(COUNT)
    )


def course(time: FloatArray, made: tuple[Move, ...]) -> FloatArray:
    """A speed [rad/s] that is the same function of the time since each move began, but for its sign."""
    out = np.zeros_like(time)
    for move in made:
        t = np.clip((time - move.start) / move.duration, 0.0, 1.0)
        out += move.direction * (30.0 * np.sin(np.pi * t) ** 2 + 0.5 * t * np.sin(40.0 * t))
    return out


def recorded(odd: FloatArray | float = 0.0, seed: int = 4) -> tuple[Trace, FloatArray, FloatArray]:
    """A noisy trace of the moves, its true values, and which samples lie in a move; `odd` is added to the third."""
    made, rng = moves(), np.random.default_rng(seed)
    time = 0.001 * np.arange(5000)
    third = (time >= made[2].start) & (time < made[2].end)
    true = course(time, made) + odd * third
    inside = np.any([(time >= m.start) & (time < m.end) for m in made], axis=0)
    return Trace(time, true + NOISE * rng.standard_normal(len(time))), true, inside


def error(trace: Trace, true: FloatArray, at: FloatArray) -> float:
    return float(np.sqrt(np.mean((trace.value - true)[at] ** 2)))


def test_the_noise_of_five_moves_alike_falls_by_nearly_the_root_of_five_and_it_says_so() -> None:
    trace, true, inside = recorded()
    quiet, left = averaged(trace, moves(), NOISE, 0.0)
    assert error(quiet, true, inside) < 0.65 * error(trace, true, inside)
    assert NOISE * np.sqrt(np.mean(left[inside] ** 2)) == pytest.approx(error(quiet, true, inside), rel=0.15)


def test_samples_at_rest_stay_what_they_are() -> None:
    trace, _, inside = recorded()
    quiet, left = averaged(trace, moves(), NOISE, 0.0)
    np.testing.assert_array_equal(quiet.value[~inside], trace.value[~inside])
    assert np.all(left[~inside] == 1.0)


@pytest.mark.parametrize("size", [0.5, 1.0, 2.0, 4.0, 30.0])
def test_what_one_move_does_differently_costs_no_move_more_than_its_noise(size: float) -> None:
    """The risk of positive-part shrinkage is never above that of the samples themselves (James and Stein)."""
    trace, true, inside = recorded(size * NOISE)
    quiet, _ = averaged(trace, moves(), NOISE, 0.0)
    for move in moves():
        own = inside & (trace.time >= move.start) & (trace.time < move.end)
        assert error(quiet, true, own) < 1.1 * NOISE


@pytest.mark.parametrize("size", [0.0, 0.3, 0.6, 1.0, 2.0])
def test_the_way_of_a_move_is_known_nearly_as_well_as_by_its_own_samples_whatever_swings_slowly(
    size: float,
) -> None:
    """Every move swings in a phase of its own, by less than its noise shows, as on a machine that still swings."""

    def way(of: FloatArray) -> float:
        """Root of the mean square of how far the way of a fifth of a move is off."""
        first = [np.searchsorted(trace.time, m.start) for m in moves()]
        return float(
            np.sqrt(np.mean([of[k + 17 * n : k + 17 * (n + 1)].sum() ** 2 for k in first for n in range(5)]))
        )

    ways = []
    for seed in range(5):
        trace, true, _ = recorded(seed=seed)
        swing = size * NOISE * np.sin(2.0 * np.pi * 14.0 * trace.time)
        quiet, _ = averaged(Trace(trace.time, trace.value + swing), moves(), NOISE, 0.0)
        ways.append((way(quiet.value - true - swing), way(trace.value - true)))
    averaged_over, own = np.sqrt(np.mean(np.square(ways), axis=0))
    assert averaged_over < 1.1 * own


def test_moves_of_other_directions_and_lengths_are_no_groups() -> None:
    assert groups(moves()) == [[0, 2, 4, 6, 8], [1, 3, 5, 7, 9]]
    assert groups(moves((0.004, 0.005))) == [[0, 4, 8], [1, 5, 9], [2, 6], [3, 7]]


def test_a_move_that_is_alone_stays_what_it_is() -> None:
    trace, _, _ = recorded()
    quiet, left = averaged(trace, moves()[:2], NOISE, 0.0)
    np.testing.assert_array_equal(quiet.value, trace.value)
    assert np.all(left == 1.0)


def test_a_move_at_the_end_of_the_recording_is_compared_with_what_there_is() -> None:
    trace, true, inside = recorded()
    end = moves()[-1].end - 0.005
    cut = Trace(trace.time[trace.time < end], trace.value[trace.time < end])
    quiet, _ = averaged(cut, moves(), NOISE, 0.03)
    at = inside[: len(cut)] & (cut.time < end - 0.01)
    assert error(quiet, true[: len(cut)], at) < 1.1 * NOISE


def test_moves_that_differ_by_chance_or_by_where_their_samples_lie_in_a_swing_are_made_alike() -> None:
    """A swing of 700 Hz of ten times the noise is met otherwise by samples at 1 kHz that begin between one another."""
    made = tuple(replace(move, start=0.35 + (APART - 2.5e-4) * k) for k, move in enumerate(moves()))
    every, time = ((2, 4, 6, 8), (1, 3, 5, 7, 9)), 0.001 * np.arange(5000)
    noise = NOISE * np.random.default_rng(6).standard_normal(len(time))
    assert made_alike(made, [(Trace(time, course(time, made) + noise), NOISE)], 0.0) == every
    since = time[:, None] - np.array([move.start for move in made])
    within = (since > 0.0) & (since < made[0].duration)
    swing = np.sum(np.where(within, 10.0 * NOISE * np.sin(2 * np.pi * 700.0 * since), 0.0), axis=1)
    third, fifth = (swing[np.flatnonzero(within[:, k])[:80]] for k in (2, 4))
    assert np.std(third - fifth) > 3.0 * NOISE
    assert made_alike(made, [(Trace(time, course(time, made) + swing + noise), NOISE)], 0.0) == every


def test_a_move_that_lasts_otherwise_is_made_like_none() -> None:
    """By twice the noise of a sample, in the speed or in the torque; the rest of its direction stay alike."""
    odd, _, _ = recorded(odd=2.0 * NOISE)
    quiet, _, _ = recorded(seed=5)
    without = ((4, 6, 8), (1, 3, 5, 7, 9))
    assert made_alike(moves(), [(odd, NOISE)], 0.0) == without
    assert made_alike(moves(), [(quiet, NOISE), (odd, NOISE)], 0.0) == without


def test_moves_of_other_lengths_are_made_alike_only_by_themselves() -> None:
    made = moves((0.004, 0.006))
    quiet, _, _ = recorded()
    assert [made[k].length for group in made_alike(made, [(quiet, NOISE)], 0.0) for k in group] == [
        *[0.004] * 2,
        *[0.004] * 3,
        *[0.006] * 2,
        *[0.006] * 2,
    ]


def test_the_mean_motion_is_that_of_all_and_each_stays_where_it_was() -> None:
    """Speeds in error by ±1 mm/s, and two places 0.1 mm apart; places to 20 nm."""
    starts, places = (0.4, 1.3), (0.0, 1e-4)
    times = np.linspace(0.0, 0.09, 181)
    motions = []
    for start, place, sign in zip(starts, places, (1.0, -1.0), strict=True):
        speed = 0.1 * np.sin(np.pi * times / 0.09) + sign * 1e-3 * np.sin(2 * np.pi * 100.0 * times)
        way = CubicSpline(times + start, speed).antiderivative()
        way.c[-1] += place
        motions.append(way)
    mean = on_one_course(motions, starts)
    for motion, before, start in zip(mean, motions, starts, strict=True):
        np.testing.assert_allclose(motion(times + start, 1), 0.1 * np.sin(np.pi * times / 0.09), atol=2e-6)
        assert np.mean(motion(times + start)) == pytest.approx(np.mean(before(times + start)), abs=2e-8)
