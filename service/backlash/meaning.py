"""What a run's value means: of each direction, and at each place along the rack.

A rack wears where it is used. Steps at several places are several experiments: each place is estimated by
itself, with an interval of its own, and the run's value is their mean. Where the axis stood is in the move
(`Move.position`), or in a recorded motor position.

The gap is the same in both directions; a difference of the two is a sign that something else moves the load.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from service.backlash.results import AxisResult, ByProduct, DirectionValue, PlaceValue, StepResult
from service.recording import Move, Recording, Trace

SAME_PLACE = 0.5
"""Steps whose middles are nearer than this share of a step's length are at one place. Chosen: to and fro are one."""

MARGIN = 0.1
"""Standstill that a place's recording keeps before its first and after its last move [s]: the shortest rest."""

Method = Callable[[Recording], Sequence[AxisResult]]


@dataclass(frozen=True)
class Experiment:
    """The steps at one place: index of the first in the run, the recording around them, its middle [m]."""

    first: int
    recording: Recording
    position: float | None


def place_of(recording: Recording, move: Move) -> float | None:
    """The middle of a step along the rack [m]; None where neither the move nor the motor's position says it."""
    start = move.position
    if start is None:
        axis = recording.axes[0]
        trace = recording.trace(axis.name, "motor_position")
        if trace is None or not len(trace):
            return None
        start = axis.transmission * float(np.interp(move.start, trace.time, trace.value))
    return start + 0.5 * move.direction * move.length


def experiments(recording: Recording) -> list[Experiment]:
    """The run cut into the steps at each place, in their order; the whole run where no place is known."""
    places = [place_of(recording, move) for move in recording.moves]
    known = [place for place in places if place is not None]
    if not known or len(known) < len(places):
        return [Experiment(0, recording, None)]
    firsts = [0]
    for k, move in enumerate(recording.moves):
        if abs(known[k] - known[firsts[-1]]) > SAME_PLACE * move.length:
            firsts.append(k)
    if len(firsts) == 1:
        return [Experiment(0, recording, float(np.mean(known)))]
    ends = [*firsts[1:], len(known)]
    return [
        Experiment(first, _cut(recording, first, end), float(np.mean(known[first:end])))
        for first, end in zip(firsts, ends, strict=True)
    ]


def _cut(recording: Recording, first: int, end: int) -> Recording:
    """The recording of some moves only: between two places the axis travels, which is neither move nor rest."""
    moves = recording.moves[first:end]
    span = moves[0].start - MARGIN, moves[-1].end + MARGIN
    traces: dict[tuple[str, str], Trace] = {key: t.between(*span) for key, t in recording.traces.items()}
    return replace(recording, moves=moves, traces=traces)


def at_each_place(recording: Recording, method: Method) -> tuple[AxisResult, ...]:
    """A method's results per axis: each place by itself, and the run's value as their mean."""
    parts = experiments(recording)
    answers = [tuple(_placed(result, part) for result in method(part.recording)) for part in parts]
    joined = [_joined(parts, of_axis) for of_axis in zip(*answers, strict=True)]
    return tuple(replace(result, by_direction=by_direction(result)) for result in joined)


def _placed(result: AxisResult, part: Experiment) -> AxisResult:
    """The result with its steps' numbers in the run, their places, and its own as a point of the map."""
    moves = part.recording.moves
    steps = tuple(
        replace(step, index=part.first + step.index, position=place_of(part.recording, moves[step.index]))
        for step in result.steps
    )
    return replace(result, steps=steps, by_place=_point(result, part.position))


def _point(result: AxisResult, position: float | None) -> tuple[PlaceValue, ...]:
    if position is None:
        return ()
    r = result
    return (PlaceValue(position, r.verdict, r.reason, r.detail, r.backlash, r.interval_95),)


def _joined(parts: Sequence[Experiment], results: Sequence[AxisResult]) -> AxisResult:
    """One result of the axis: the mean over the places; refused as soon as one is, whose mean would be another."""
    if len(results) == 1:
        return results[0]
    steps = tuple(step for result in results for step in result.steps)
    places = tuple(place for result in results for place in result.by_place)
    for part, result in zip(parts, results, strict=True):
        if result.backlash is None or result.interval_95 is None:
            where = f"At {part.position:.3f} m: {result.detail or result.reason}"
            return replace(result, detail=where, steps=steps, by_place=places, by_products=())
    b = float(np.mean([r.backlash for r in results if r.backlash is not None]))
    low, high = np.mean([r.interval_95 for r in results if r.interval_95 is not None], axis=0)
    return replace(
        results[0],
        detail=None,
        backlash=b,
        interval_95=(float(low), float(high)),
        steps=steps,
        by_place=places,
        by_products=_mean_products([r.by_products for r in results]),
    )


def _mean_products(found: Sequence[tuple[ByProduct, ...]]) -> tuple[ByProduct, ...]:
    """Means of the by-products that every place gave."""
    by_name = [{p.name: p for p in products} for products in found]
    return tuple(
        ByProduct(
            name,
            float(np.mean([d[name].value for d in by_name])),
            float(np.sqrt(np.mean([d[name].std ** 2 for d in by_name]) / len(by_name))),
            first.unit,
        )
        for name, first in by_name[0].items()
        if all(name in d for d in by_name)
    )


def by_direction(result: AxisResult) -> tuple[DirectionValue, ...]:
    """Mean of the steps of each direction; their scatter is added to what the run's own interval holds."""
    if result.backlash is None or result.interval_95 is None:
        return ()
    below, above = result.backlash - result.interval_95[0], result.interval_95[1] - result.backlash
    found = []
    for direction in (1, -1):
        b = np.array([s.backlash for s in _sound(result.steps) if s.direction == direction])
        if len(b) > 1:
            mean = float(np.mean(b))
            random = float(stats.t.ppf(0.975, len(b) - 1) * np.std(b, ddof=1) / np.sqrt(len(b)))
            ends = mean - float(np.hypot(below, random)), mean + float(np.hypot(above, random))
            found.append(DirectionValue(direction, mean, ends, len(b)))
    return tuple(found)


def _sound(steps: Sequence[StepResult]) -> list[StepResult]:
    return [step for step in steps if step.verdict == "ok" and step.backlash is not None]
