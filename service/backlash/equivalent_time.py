"""A drive's channels between their samples, by moves alike that were sampled at other phases.

A contact may swing near half the rate of the samples, and no interpolation of them shows it. But a drive repeats
itself, and unless its moves begin whole periods apart its samples fall on other parts of each: laid over one another,
those of alike moves show their common course as often as there are phases (equivalent-time sampling, as of an
oscilloscope); an axis that is alike in both directions shows it in both. What is a move's own is a spline through what
its samples differ by. Only moves stand for one another that repeat to within the noise: the first one, before which
the pinion rests anywhere, mostly does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, make_smoothing_spline

from service.backlash.alike_moves import groups
from service.recording import FloatArray, Move, Trace

BEFORE, AFTER = 0.004, 0.03
"""What of the rests around a move is its course too [s]: until the controller has settled."""
PER_PERIOD = 4
"""Samples for each of the drive's own."""
PASSED = 0.5
"""Frequency that the common course has lost half of, times the distance of its samples: 0.5 is the most they show."""
ALIKE = 2.0
"""Root mean square that moves may differ by from their common course, over the noise (chosen)."""
FEWEST = 3
"""Moves that are alike by more than chance."""
CLOSE = 0.7
"""Greatest distance of the common course's samples, over a period, at which it tells more than any of the moves."""
UNEVEN = (0.9, 0.7)
"""Quantile of its samples' distances, and the share of it, that the course is at least as smooth as (chosen): phases
lie unevenly."""
AT_ONCE = 2e-5
"""Time within which samples are taken as one [s]."""


@dataclass(frozen=True)
class Common:
    """What moves have in common.

    Attributes
    ----------
    course : value, positive in the move's direction, by the time since it began [s]
    apart : (moves,) root mean square of what each differs by
    widest : greatest distance of the samples that the course is known by [s]
    """

    course: BSpline
    apart: FloatArray
    widest: float


def common(since: Sequence[FloatArray], values: Sequence[FloatArray]) -> Common:
    """The common course of moves, from their samples' times since each began [s] and their values along the move."""
    time = np.concatenate(since)
    order = np.argsort(time)
    together = np.concatenate(([0], np.cumsum(np.diff(time[order]) > AT_ONCE)))
    count = np.bincount(together).astype(np.float64)
    at = np.bincount(together, time[order]) / count
    mean = np.bincount(together, np.concatenate(values)[order]) / count
    distance = np.diff(at)
    spacing = float(distance.mean())
    quantile, share = UNEVEN
    slowest = max(spacing, share * float(np.quantile(distance, quantile)))
    penalty = (slowest / (2.0 * np.pi * PASSED)) ** 4 / spacing
    course = make_smoothing_spline(at, mean, w=count, lam=penalty)
    apart = [
        float(np.sqrt(np.mean((value - course(own)) ** 2))) for own, value in zip(since, values, strict=True)
    ]
    return Common(course, np.array(apart), float(distance.max()))


def repeated(
    trace: Trace, moves: Sequence[Move], group: Sequence[int], noise: float
) -> tuple[list[int], Common] | None:
    """Those of a group of moves that repeat to within the noise, and what they have in common; None where no more than
    half of them do, or where they were sampled at one phase. The first move of a run is the first that is left out."""
    period = float(np.median(np.diff(trace.time)))
    parts = {k: around(trace, moves[k]) for k in group}
    kept = [k for k in group if len(parts[k]) > PER_PERIOD]
    while len(kept) >= FEWEST and 2 * len(kept) > len(group):
        found = common(
            [parts[k].time - moves[k].start for k in kept],
            [moves[k].direction * parts[k].value for k in kept],
        )
        if found.widest > CLOSE * period:
            return None
        if found.apart.max() < ALIKE * noise:
            return kept, found
        del kept[0 if kept[0] == 0 else int(np.argmax(found.apart))]
    return None


def around(trace: Trace, move: Move) -> Trace:
    """The samples of a move and of what of the rests around it is its course too."""
    return trace.between(move.start - BEFORE, move.end + AFTER)


def in_common(trace: Trace, moves: Sequence[Move], noise: float) -> dict[int, BSpline]:
    """The moves that repeat, and the course that each has in common with others: with those of both directions, or of
    its own."""
    out: dict[int, BSpline] = {}
    of_both = groups([replace(move, direction=1) for move in moves])
    for group in (*of_both, *groups(moves)):
        found = repeated(trace, moves, [k for k in group if k not in out], noise)
        if found is not None:
            out |= dict.fromkeys(found[0], found[1].course)
    return out


def interleaved(trace: Trace, moves: Sequence[Move], noise: float) -> Trace:
    """A drive's channel with PER_PERIOD values for each sample in moves that repeat; its own samples stay as they are.

    Parameters
    ----------
    noise : standard deviation of one sample, in the trace's unit
    """
    times, values = [trace.time], [trace.value]
    for k, course in in_common(trace, moves, noise).items():
        own, begun, s = around(trace, moves[k]), moves[k].start, moves[k].direction
        left = CubicSpline(own.time, own.value - s * course(own.time - begun))
        share = np.arange(1, PER_PERIOD) / PER_PERIOD
        between = (own.time[:-1, None] + np.diff(own.time)[:, None] * share).ravel()
        times.append(between)
        values.append(s * course(between - begun) + left(between))
    time, value = np.concatenate(times), np.concatenate(values)
    order = np.argsort(time, kind="stable")
    return replace(trace, time=time[order], value=value[order])
