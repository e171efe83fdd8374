"""What the rests say of a sensor's zero: a course is told from noise, from a swing and from an axis that is pushed."""

from __future__ import annotations

import numpy as np
import pytest

from service.identification.rest_zero import means_at_rest, wander, zero_wanders
from service.recording import AxisDescription, FloatArray, Move, Recording, Trace

RATE, NOISE = 2000.0, 0.04
MOVES = tuple(Move(0.5 * k, 1 if k % 2 else -1, 0.005, 100.0, 0.15) for k in range(1, 11))
INSTANTS = np.arange(0.0, 6.0, 1.0 / RATE)


def recording(course: FloatArray, seed: int = 1, moves: tuple[Move, ...] = MOVES) -> Recording:
    """Of a sensor whose zero goes this course [m/s²]; moves of 5 m/s² besides."""
    value = np.random.default_rng(seed).normal(0.0, NOISE, len(INSTANTS)) + course
    time = INSTANTS
    for move in moves:
        value += np.where((time > move.start) & (time < move.end), 5.0, 0.0)
    return Recording(
        "m", (AxisDescription("X1", 0.004),), {("X1", "acceleration"): Trace(time, value)}, moves
    )


def test_the_mean_of_a_rest_is_the_zero_there() -> None:
    one = recording(0.1 * INSTANTS)
    time, mean, error = means_at_rest(one.traces["X1", "acceleration"], one)
    assert len(time) == len(MOVES)
    assert np.all(np.abs(mean - 0.1 * time) < 5.0 * error)
    assert error == pytest.approx(NOISE / np.sqrt(RATE * 0.24), rel=0.2)


@pytest.mark.parametrize("warm", [False, True])
def test_a_drift_and_a_warm_up_wander(warm: bool) -> None:
    course = 0.2 * (1.0 - np.exp(-INSTANTS / 2.0)) if warm else 0.05 * INSTANTS
    one = recording(course)
    rests = np.array([move.start - 0.12 for move in MOVES])
    true = float(np.std(np.interp(rests, INSTANTS, course), ddof=1)) / NOISE
    assert wander(one.traces["X1", "acceleration"], one) == pytest.approx(true, rel=0.1)
    assert zero_wanders(one, ("X1",))


@pytest.mark.parametrize("seed", range(10))
def test_noise_and_a_constant_zero_do_not(seed: int) -> None:
    one = recording(np.full(len(INSTANTS), 0.3), seed)
    assert wander(one.traces["X1", "acceleration"], one) < 0.1


@pytest.mark.parametrize("frequency", [1.3, 2.7, 9.0])
def test_what_goes_up_and_down_from_rest_to_rest_is_no_course(frequency: float) -> None:
    one = recording(0.3 * np.sin(2.0 * np.pi * frequency * INSTANTS))
    assert not zero_wanders(one, ("X1",))


def test_a_little_of_it_is_none_of_the_things_that_a_model_lacks() -> None:
    assert not zero_wanders(recording(0.008 * INSTANTS), ("X1",))


def test_few_rests_say_nothing() -> None:
    one = recording(0.2 * INSTANTS, moves=MOVES[:4])
    assert wander(one.traces["X1", "acceleration"], one) == 0.0
