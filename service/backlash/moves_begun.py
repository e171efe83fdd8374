"""Where a fit of whole moves begins: values that were found elsewhere, every move's zeros searched for at them, the
motors' motion made to agree, and what a right model is expected to miss there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from service.backlash.expected_errors import expected_errors
from service.backlash.moves import Moves
from service.backlash.moves_fit import (
    CLOSE_PLACES,
    Fitted,
    Point,
    fit,
    limits,
    reconstructed,
    resting,
    rests_found,
)
from service.dynamics.driven_model import Model
from service.recording import FloatArray

Values = Mapping[str, float]


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


def with_expected_errors(moves: Moves, found: Fitted, fitted: bool) -> Moves:
    """The moves with the spread that a right model's residuals would have, judged at a fit."""
    at = rests_found([moves], found.model, Point(found.at.shared, resting([moves], found.model)))
    expected, wander = expected_errors(moves, found.model, at.shared, at.local[0], fitted=fitted)
    return replace(moves, expected=expected, wander=wander)


def expecting_its_own(found: Fitted) -> tuple[Moves, ...]:
    """The moves of a fit with what is expected of its own model; models are compared as before."""
    again = (with_expected_errors(part, found, fitted=True) for part in found.moves)
    return tuple(
        replace(now, judged=part.expected if part.judged is None else part.judged)
        for now, part in zip(again, found.moves, strict=True)
    )
