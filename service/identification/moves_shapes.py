"""An effect in each of its shapes, where the moves that were fitted do not tell which one it is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from service.backlash.moves_begun import Values
from service.backlash.moves_fit import Fitted, fit, values_at
from service.dynamics.driven_model import DrivenEffect, Model
from service.identification.held_out import DESCRIBED, Explained, trial_of
from service.identification.moves_carried import FIRST_ROUNDS
from service.identification.moves_end import SOUND, ended, settled
from service.identification.moves_finals import describes_its_own_only
from service.identification.moves_looks import GLIMPSE
from service.identification.moves_starts import (
    GUIDE,
    ROUNDS,
    Candidate,
    begun_at,
    hardly_any,
    scored,
    unanswering,
    widened,
)
from service.identification.scene import Scene
from service.identification.selection import Trial, distance


def in_best_shape(
    scene: Scene, base: Fitted, candidate: Candidate, trial: Trial[Explained]
) -> Trial[Explained]:
    """The candidate's trial, or a nearer one of another shape. Where the present fit describes the moves that were
    fitted, they hardly tell a shape, such as how friction depends on speed, which shows in other moves: each is fitted
    and judged there, so that the held-out moves choose among a few shapes of one effect as they do among effects. So
    are standard sizes, as long as no more is missing than what every machine has may leave."""
    fits = list(all_shapes(base, candidate))
    fits += (
        standard(base, replace(candidate, effect=effect, model=with_last(candidate.model, effect)))
        for effect in (candidate.effect.standards if base.rms < SOUND else ())
    )
    return min((trial, *(trial_of(scene, f, thorough=False) for f in fits)), key=distance)


def in_other_shapes(
    scene: Scene, base: Fitted, candidate: Candidate, trial: Trial[Explained]
) -> Trial[Explained]:
    """The candidate's trial, or where its fit was ended and yet describes its own moves only, the nearest of its shapes
    that are ended, too: until then the friction of another shape hides in the viscous one."""
    if not (trial.model.ended and describes_its_own_only(trial)):
        return trial
    others = (trial_of(scene, settled(f, ROUNDS)) for f in all_shapes(base, candidate))
    return min((trial, *(ended(scene, one) for one in others)), key=distance)


def all_shapes(base: Fitted, candidate: Candidate) -> Iterator[Fitted]:
    """The candidate in every shape of friction, where the train moves do not tell it."""
    if candidate.effect.bends_friction and base.rms < DESCRIBED:
        for shape in scored(base, candidate, values_at(base)):
            yield shaped(base, candidate, shape)


def with_last(model: Model, effect: DrivenEffect) -> Model:
    """The model with another effect in the place of its last."""
    return replace(model, effects=(*model.effects[:-1], effect))


def standard(base: Fitted, candidate: Candidate) -> Fitted:
    """The candidate on all moves, with a number of a standard size, from the best of its starts."""
    moves, model = unanswering(base.moves), candidate.model
    begun = (
        fit(moves, model, begun_at(moves, model, values, widened(base.at.local, model)), GLIMPSE)
        for values in scored(base, candidate, values_at(base))
    )
    best = min(begun, key=lambda f: f.rms)
    return fit(moves, model, best.at, ROUNDS)


def shaped(base: Fitted, candidate: Candidate, shape: Values) -> Fitted:
    """The candidate on all moves, begun with next to nothing of the effect: friction is fitted first, then all but the
    effect's shape, then all."""
    model, moves = candidate.model, unanswering(base.moves)
    amounts = {p.name for p in candidate.effect.parameters if p.dose}
    form = {p.name for p in candidate.effect.parameters if not p.dose}
    names = [p.name for p in model.parameters]
    friction = [k for k, name in enumerate(names) if name in amounts or name.endswith(GUIDE)]
    all_but_shape = [k for k, name in enumerate(names) if name not in form]
    at = begun_at(moves, model, hardly_any(candidate, shape), widened(base.at.local, model))
    found = fit(moves, model, at, FIRST_ROUNDS, free=np.array(friction))
    found = fit(moves, model, found.at, ROUNDS, free=np.array(all_but_shape))
    return fit(moves, model, found.at, ROUNDS)
