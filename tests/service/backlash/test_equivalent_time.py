"""A drive's channels between their samples: on courses of which everything is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from service.backlash.equivalent_time import AFTER, BEFORE, PER_PERIOD, interleaved
from service.recording import FloatArray, Move, Trace

PERIOD, NOISE, DURATION = 2e-3, 1e-3, 0.08
Course = Callable[[FloatArray], FloatArray]


def swing(frequency: float, late: float = 0.0) -> Course:
    """A speed that swings in the middle of a move, by the time since it began; along the move."""

    def at(since: FloatArray) -> FloatArray:
        inside = np.clip((since - late) / DURATION, 0.0, 1.0)
        burst = np.exp(-(((since - late - 0.04) / 0.008) ** 2)) * np.cos(
            2 * np.pi * frequency * (since - late)
        )
        return np.asarray(30.0 * np.sin(np.pi * inside) ** 2 + burst)

    return at


def recorded(courses: Sequence[Course], apart: float, back: float = -1.0) -> tuple[Trace, list[Move]]:
    """Moves to and fro that begin `apart` after one another [s]; those back are `back` times their course."""
    moves = [
        Move(0.3 + apart * k, 1 if k % 2 == 0 else -1, 0.004, 200.0, DURATION) for k in range(len(courses))
    ]
    time = np.arange(0.0, moves[-1].end + 0.3, PERIOD)
    value = NOISE * np.random.default_rng(3).standard_normal(len(time))
    for move, course in zip(moves, courses, strict=True):
        there = (time >= move.start - BEFORE) & (time < move.end + AFTER)
        value[there] += (1.0 if move.direction > 0 else back) * course(time[there] - move.start)
    return Trace(time, value), moves


def errors(trace: Trace, moves: list[Move], courses: Sequence[Course]) -> FloatArray:
    """RMS (moves,) of what was put between the samples."""
    out = []
    for move, course in zip(moves, courses, strict=True):
        part = trace.between(move.start, move.end)
        out.append(np.sqrt(np.mean((part.value - move.direction * course(part.time - move.start)) ** 2)))
    return np.array(out)


def test_a_swing_near_half_the_rate_is_shown_by_moves_that_begin_between_the_samples() -> None:
    """220 Hz at 500 Hz: five phases of 0.4 ms. A spline between a move's own samples is five times as far off."""
    courses = [swing(220.0)] * 10
    trace, moves = recorded(courses, 0.4004)
    closer = interleaved(trace, moves, NOISE)
    assert len(closer.between(moves[3].start, moves[3].end)) > 0.9 * PER_PERIOD * DURATION / PERIOD
    off = errors(closer, moves, courses).max()
    assert off < 0.05
    own = Trace(closer.time, CubicSpline(trace.time, trace.value)(closer.time))
    assert errors(own, moves, courses).max() > 5.0 * off
    np.testing.assert_array_equal(closer.value[np.isin(closer.time, trace.time)], trace.value)


@pytest.mark.parametrize("apart", [0.4, 0.4004])
def test_moves_at_one_phase_or_that_differ_are_left_as_they_are(apart: float) -> None:
    """Each move swings at a moment of its own, or all were sampled alike."""
    late = np.zeros(10) if apart == 0.4 else 1e-3 * np.random.default_rng(5).standard_normal(10)
    trace, moves = recorded([swing(220.0, float(d)) for d in 4.0 * late], apart)
    np.testing.assert_array_equal(interleaved(trace, moves, NOISE).time, trace.time)


def test_a_first_move_that_differs_is_left_out_and_a_machine_that_is_not_alike_both_ways_is_told_by_each() -> (
    None
):
    first = swing(120.0, 5e-3)
    courses = [first, *([swing(220.0)] * 11)]
    trace, moves = recorded(courses, 0.4004, back=-1.3)
    closer = interleaved(trace, moves, NOISE)
    denser = [len(closer.between(m.start, m.end)) > 2 * len(trace.between(m.start, m.end)) for m in moves]
    assert denser == [False] + [True] * 11
