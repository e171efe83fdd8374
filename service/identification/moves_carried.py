"""What was fitted to a few moves of a fit, on all of them, and fits begun once more where another one ended."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from service.backlash.moves_begun import point_at, shared_at
from service.backlash.moves_fit import Fitted, fit, values_at
from service.backlash.moves_point import Point
from service.backlash.moves_refined import CLOSE_PLACES, best_of_each, reconstructed, rests_found
from service.identification.moves_end import HOWEVER_FAR, settled, with_own_errors
from service.identification.moves_looks import ENDED, GLIMPSE, Brief, noted, standing
from service.identification.moves_starts import (
    BRIEF,
    ROUNDS,
    Candidate,
    begun_at,
    fewer,
    fitted_from,
    placed,
    unanswering,
    widened,
)
from service.identification.scene import Scene
from service.identification.selection import PART, gone

FIRST_ROUNDS = 6
"""Rounds of a first fit of all moves."""
TURNS_OF_RESTS = 2
"""How often the rests of two coupled axes are found anew after the first time."""
RIVAL = 0.75
"""How near to the best of a candidate's fits of a few moves another must come to be fitted to all moves beside it."""
AGAINST = 1.1
"""How much farther than the best from the moves and the motors' equations of motion a fit may be, and from all moves
what does much the same by another law (chosen)."""
SECOND = 0.9
"""How much nearer to the moves a place must be for a fit to begin there once more."""


def glanced_at(found: Fitted, brief: Brief) -> Fitted:
    """What was fitted to a few moves of a fit, on all of them: every move's zeros taken along, and one round of a fit.
    As far as one that is far behind the best has to be known."""
    moves, held = unanswering(found.moves), np.zeros(0, dtype=np.int64)
    shared = shared_at(brief.model, brief.values)
    starts = (Point(shared, local) for local in (brief.local, widened(found.at.local, brief.model)))
    at = best_of_each([fit(moves, brief.model, at, 1, free=held) for at in starts])
    return fit(moves, brief.model, at, 1)


def carried(found: Fitted, brief: Brief, rounds: int) -> Fitted:
    """What was fitted to a few moves of a fit, fitted to all of them."""
    moves = unanswering(found.moves)
    at = begun_at(moves, brief.model, brief.values, brief.local, widened(found.at.local, brief.model))
    return fit(moves, brief.model, at, rounds)


def refitted(found: Fitted, brief: Sequence[Brief], enough: float) -> list[Fitted]:
    """The candidate on all moves, from the best of its fits of a few, the nearest first; of an effect with many valleys
    one in each, with the motor's motion that it makes, for how near a few moves come says little of them, unless the
    motors speak against it. One that is not near `enough` is only looked at."""
    if brief[0].rms > enough:
        return [glanced_at(found, brief[0])]
    fits = [carried(found, one, FIRST_ROUNDS) for one in brief if brief[0].rms > RIVAL * one.rms]
    if fits[0].model.effects[-1].many_valleys:
        fits = [fit(reconstructed(f, asked=True), f.model, f.at, ROUNDS) for f in fits]
        least = min(f.rms_with_motors for f in fits)
        held = [f for f in fits if f.rms_with_motors <= AGAINST * least]
        return sorted(held, key=lambda f: f.rms)
    return [min(fits, key=standing)]


def bridges(candidate: Candidate) -> bool:
    """Whether the effect is a bridge between two axes, which the estimator has fitted by itself."""
    return "bridge_stiffness" in {p.name for p in candidate.effect.parameters}


def as_coupled(scene: Scene, found: Fitted, candidate: Candidate) -> Fitted:
    """The candidate on all moves from where the estimator puts two axes with a bridge between them. Where each side
    rests tells only once it is known where the other one does, and until then the masses and the friction of both are
    driven away; so the rests are found first, in turns. What takes a part of what is missing is led on from there
    before anything else is tried, however far it still is: two drives have many numbers, and two gaps many valleys."""
    moves, held = unanswering(found.moves), np.zeros(0, dtype=np.int64)
    begun = fit(
        moves, candidate.model, point_at(candidate.model, scene.coupled, moves), FIRST_ROUNDS, free=held
    )
    for _ in range(TURNS_OF_RESTS):
        at = rests_found(moves, candidate.model, begun.at, CLOSE_PLACES)
        begun = fit(moves, candidate.model, at, FIRST_ROUNDS, free=held)
    coupled = fit(moves, candidate.model, begun.at, ROUNDS)
    far = coupled.rms > ENDED and gone(found.rms, coupled.rms, PART)
    return settled(with_own_errors(coupled), ROUNDS, HOWEVER_FAR) if far else coupled


def as_other(found: Fitted, other: Fitted) -> Fitted:
    """The fit of an effect, begun once more where one ended that contains it, or does much the same, and that came
    nearer."""
    if other.rms > found.rms:
        return found
    values = values_at(other) | dict(found.model.effects[-1].instead(values_at(other)))
    return min(found, fitted_from(found, values, ROUNDS), key=lambda f: f.rms)


def ground_of(found: Fitted, best: Fitted) -> Fitted:
    """The present model with the machine that the best of all candidates found, on a few moves: while an axis moves,
    effects are alike that are not at its turning points, and the best has left the declared model's corner."""
    few, held = fewer(found), np.zeros(0, dtype=np.int64)
    return fit(few, found.model, point_at(found.model, values_at(best), few), BRIEF, free=held)


def seconded(ground: Fitted, first: Fitted, candidate: Candidate, nearest: float, far: float) -> Fitted:
    """The candidate, fitted `first`, begun once more from such a ground, unless it is `far` off after a glimpse;
    `nearest` is the RMS of its best fit so far."""
    glimpse = fit(ground.moves, candidate.model, placed(ground, candidate).at, GLIMPSE)
    if glimpse.rms > far:
        return first
    brief = fit(ground.moves, candidate.model, glimpse.at, BRIEF - GLIMPSE)
    if brief.rms > SECOND * nearest:
        return first
    again = carried(first, noted(brief, first.moves), FIRST_ROUNDS)
    return min(first, again, key=lambda f: f.rms)
