"""Where a fit of whole moves begins: values that were found elsewhere, every move's zeros searched for at them, the
motors' motion made to agree, and what a right model is expected to miss there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from service.backlash.expected_errors import expected_errors
from service.backlash.moves import Moves
from service.backlash.moves_fit import Fitted, fit
from service.backlash.moves_point import Point, limits, resting
from service.backlash.moves_refined import (
    CLOSE_PLACES,
    best_of_each,
    reconstructed,
    rests_found,
    rms_of_moves,
)
from service.dynamics.driven_model import Model
from service.recording import FloatArray

Values = Mapping[str, float]
OUTSTANDING = 1.25
"""RMS of a move, over the median of all, from which on it is begun anew (chosen)."""


def point_at(model: Model, values: Values, moves: Sequence[Moves]) -> Point:
    """The point with these values, others at their typical value, every move's zero chosen among a few."""
    return rests_found(moves, model, Point(shared_at(model, values), resting(moves, model)))


def shared_at(model: Model, values: Values) -> FloatArray:
    """Coordinates (P,) of these values, others at their typical value."""
    shared = [float(p.internal(values[p.name])) if p.name in values else 0.0 for p in model.parameters]
    return np.asarray(np.clip(np.nan_to_num(shared), *limits(model).T), dtype=np.float64)


def resettled(moves: Sequence[Moves], model: Model, at: Point) -> Fitted:
    """The moves' own coordinates fitted and the motors' motion reconstructed, with the shared coordinates held."""
    held = np.zeros(0, dtype=np.int64)
    found = fit(moves, model, at, 6, free=held)
    for _ in range(2):
        moves = reconstructed(found)
        found = fit(moves, model, rests_found(moves, model, found.at, CLOSE_PLACES), 4, free=held)
    return found


def begun_anew(found: Fitted) -> Fitted:
    """The fit, and where one of its moves stands out, every move begun where it rests by the fit's own numbers: one
    move that began a swing too early or too late draws the shared numbers after it, and all others with them."""
    of_moves = rms_of_moves(found)
    if np.max(of_moves) < OUTSTANDING * np.median(of_moves):
        return found
    at = rests_found(found.moves, found.model, found.at, CLOSE_PLACES)
    anew = fit(found.moves, found.model, at, 4, free=np.zeros(0, dtype=np.int64))
    return fit(found.moves, found.model, best_of_each([found, anew]), 0, free=found.free)


def with_expected_errors(moves: Moves, found: Fitted, fitted: bool) -> Moves:
    """The moves with the spread that a right model's residuals would have, judged at a fit."""
    at = rests_found([moves], found.model, Point(found.at.shared, resting([moves], found.model)))
    expected = expected_errors(moves, found.model, at.shared, at.local[0], fitted=fitted)
    return replace(moves, expected=expected.acceleration, wander=expected.wander, force_off=expected.force)


def expecting_its_own(found: Fitted) -> tuple[Moves, ...]:
    """The moves of a fit with what is expected of its own model; models are compared as before."""
    again = (with_expected_errors(part, found, fitted=True) for part in found.moves)
    return tuple(
        replace(now, judged=part.expected if part.judged is None else part.judged)
        for now, part in zip(again, found.moves, strict=True)
    )
