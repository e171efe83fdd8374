"""What the drive does alike in all moves of one direction, told from the noise of its channels.

A drive repeats itself: moves of one direction are made by one controller after one set-point, so that their speed and
torque differ by the noise and by what the load does differently. Where the samples of alike moves, laid over one
another, differ by no more than the noise, their mean stands for each of them; where they differ by more, each keeps
its own (the positive-part shrinkage of James and Stein, 1961, in a window that runs along the move). What differs
slowly, of which the integral is a way that a single window hardly shows, is judged by all moves together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline, PPoly
from scipy.ndimage import uniform_filter1d

from service.recording import FloatArray, Move, Trace

WINDOW = 0.012
"""Length of the window [s]; chosen: about the time in which a gap is crossed."""
LASTING = 1.0
"""RMS of what lasts, over the noise of one sample, up to which moves are made alike (chosen: some four times what
chance does at 1 kHz)."""
FINE = 5e-5
"""Spacing of the points of a mean motion [s] (chosen: a twentieth of a swing of 1 kHz)."""
ALIKE = 0.02
"""Share by which lengths and durations of alike moves may differ (chosen)."""


def groups(moves: Sequence[Move]) -> list[list[int]]:
    """Indices of the moves of one direction, length and duration, group by group."""
    out: list[list[int]] = []
    for k, move in enumerate(moves):
        for group in out:
            if alike(move, moves[group[0]]):
                group.append(k)
                break
        else:
            out.append([k])
    return out


def alike(one: Move, other: Move) -> bool:
    """Whether two moves have one set-point."""
    length, duration = abs(one.length - other.length), abs(one.duration - other.duration)
    near = length <= ALIKE * other.length and duration <= ALIKE * other.duration
    return one.direction == other.direction and near


def averaged(trace: Trace, moves: Sequence[Move], noise: float, after: float) -> tuple[Trace, FloatArray]:
    """A drive's channel with the samples of each move, until `after` [s] from its end, taken nearer to those of the
    moves alike, as far as they differ by chance.

    Parameters
    ----------
    noise : standard deviation of one sample, in the trace's unit

    Returns
    -------
    The trace, and the share (n,) of its samples' noise that is left.
    """
    value, left = trace.value.copy(), np.ones(len(trace))
    course, begin, end = CubicSpline(trace.time, trace.value), trace.time[0], trace.time[-1]
    width = window_of(trace)
    for group in groups(moves):
        places = [np.searchsorted(trace.time, (moves[k].start, moves[k].end + after)) for k in group]
        count, length = len(group), int(np.min(np.diff(places)))
        if count < 2 or length < width:
            continue
        own = np.stack([trace.value[first : first + length] for first, _ in places])
        mean = np.empty_like(own)
        for row, (k, (first, _)) in enumerate(zip(group, places, strict=True)):
            since = trace.time[first : first + length] - moves[k].start
            mean[row] = np.mean([course(np.clip(since + moves[j].start, begin, end)) for j in group], axis=0)
        variance = noise**2 * (1.0 - 1.0 / count)
        slow = uniform_filter1d(own - mean, width, axis=1, mode="nearest")
        fast = own - mean - slow
        together = real_share(np.mean(slow**2, axis=0), variance / width)
        each = real_share(
            uniform_filter1d(fast**2, width, axis=1, mode="nearest"), variance * (1.0 - 1.0 / width)
        )
        for row, (first, _) in enumerate(places):
            value[first : first + length] = mean[row] + together * slow[row] + each[row] * fast[row]
            kept = together**2 / width + each[row] ** 2 * (1.0 - 1.0 / width)
            left[first : first + length] = np.sqrt((1.0 + kept * (count - 1)) / count)
    return replace(trace, value=value), left


def real_share(power: FloatArray, by_chance: float) -> FloatArray:
    """Share of deviations that is no chance, from their power and the power that chance has."""
    return np.asarray(np.clip(1.0 - by_chance / np.maximum(power, 1e-300), 0.0, 1.0))


def made_alike(
    moves: Sequence[Move], channels: Sequence[tuple[Trace, float]], after: float
) -> tuple[tuple[int, ...], ...]:
    """Groups of two and more moves that the drives made alike: whatever of their `channels`, speeds and torques with
    the noise of a sample each, lasts as long as the window differs by less than that. What is quicker may differ all
    the same, where samples that lie otherwise in a swing show it otherwise. The first of a recording is in none: before
    it nothing was left to swing."""
    courses = [(trace, CubicSpline(trace.time, trace.value), noise) for trace, noise in channels]
    out = []
    for group in groups(moves):
        left = [k for k in group if k > 0]
        while len(left) > 1:
            others = {k: [moves[j].start for j in left if j != k] for k in left}
            apart = [
                max(slowly_apart(*channel, moves[k], others[k], after) for channel in courses) for k in left
            ]
            if max(apart) <= LASTING:
                out.append(tuple(left))
                break
            left.pop(int(np.argmax(apart)))
    return tuple(out)


def slowly_apart(
    trace: Trace, course: CubicSpline, noise: float, move: Move, others: Sequence[float], after: float
) -> float:
    """RMS, over the noise of a sample, of how far a move's samples are in a window from the median of those that began
    at `others` [s], read off the `course` through all samples."""
    first, last = np.searchsorted(trace.time, (move.start, move.end + after))
    since, width = trace.time[first:last] - move.start, window_of(trace)
    if last - first <= 3 * width:
        return np.inf
    begin, end = trace.time[0], trace.time[-1]
    theirs = [course(np.clip(since + start, begin, end)) for start in others]
    apart = trace.value[first:last] - np.median(theirs, axis=0)
    # Twice: one window passes a tenth of what swings three times in it.
    slow = uniform_filter1d(uniform_filter1d(apart, width), width)[width:-width]
    return float(np.sqrt(np.mean(slow**2)) / max(noise, 1e-300))


def window_of(trace: Trace) -> int:
    """Samples of the window, four at least."""
    return max(4, round(WINDOW / float(np.median(np.diff(trace.time)))))


def on_one_course(motions: Sequence[PPoly], starts: Sequence[float]) -> list[PPoly]:
    """Motions [m] of moves that the drives made alike and that began at `starts` [s], each on the mean of their speeds
    and where it was itself: what the samples of one miss, those of another meet that lie otherwise in the move."""
    since = [
        (float(m.x[0]) - start, float(m.x[-1]) - start) for m, start in zip(motions, starts, strict=True)
    ]
    begin, end = max(first for first, _ in since), min(last for _, last in since)
    times = np.linspace(begin, end, 1 + round((end - begin) / FINE))
    speed = np.mean([m(times + start, 1) for m, start in zip(motions, starts, strict=True)], axis=0)
    way = CubicSpline(times, speed).antiderivative()
    out = []
    for motion, start in zip(motions, starts, strict=True):
        own = PPoly(way.c.copy(), way.x + start)
        own.c[-1] += float(np.mean(motion(times + start) - way(times)))
        out.append(own)
    return out
