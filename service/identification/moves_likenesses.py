"""What does much the same as the right effect: the right one begun where its likeness ended, and ended beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from service.backlash.moves_fit import Fitted, fit, values_at
from service.identification.held_out import Explained
from service.identification.moves_carried import AGAINST, FIRST_ROUNDS, SECOND, carried, ground_of
from service.identification.moves_end import SOUND, ended, settled
from service.identification.moves_finals import (
    BEHIND,
    FINALISTS,
    ended_if_named,
    judged,
    leading,
    may_be_named,
)
from service.identification.moves_looks import ENDED, noted
from service.identification.moves_starts import BRIEF, ROUNDS, Candidate, fitted_from, placed
from service.identification.scene import Scene
from service.identification.selection import EXPLAINED, Trial, distance, gone_from_all, most_left


def beside_likeness(
    scene: Scene,
    present: Trial[Explained],
    base: Fitted,
    tried: Sequence[Candidate],
    trials: Mapping[str, Trial[Explained]],
) -> dict[str, Trial[Explained]]:
    """Where the nearest of all is no such effect by its limits, the others that are nearer once they begin on the
    machine that it found, by name: a likeness of the right effect leads to the right machine, from which that one's own
    starts were too far. A few moves say which of them explain anything there; these are fitted to all, and ended where
    they come nearer than the likeness."""
    best = min(trials.values(), key=distance)
    others = [c for c in tried if c.name != best.model.fitted.model.effects[-1].name]
    if not (best.at_limits and others):
        return {}
    ground = ground_of(base, best.model.fitted)
    begun = [fit(ground.moves, c.model, placed(ground, c).at, BRIEF) for c in others]
    usual = np.median([one.rms for one in begun])
    out = dict[str, Trial[Explained]]()
    for brief in sorted((one for one in begun if one.rms < SECOND * usual), key=lambda f: f.rms)[:FINALISTS]:
        name = brief.model.effects[-1].name
        again = carried(base, noted(brief, base.moves), FIRST_ROUNDS)
        if again.rms < SECOND * trials[name].train_rms:
            nearer = judged(scene, present, settled(again, ROUNDS))
            if nearer.train_rms < best.train_rms and may_be_named(present, nearer):
                nearer = ended(scene, nearer)
            out[name] = min((trials[name], nearer), key=distance)
    return out


def by_other_laws(
    scene: Scene,
    present: Trial[Explained],
    tried: Sequence[Candidate],
    trials: Mapping[str, Trial[Explained]],
) -> dict[str, Trial[Explained]]:
    """Where the nearest of all leaves more than the right one does, what does nearly the same by another law, begun in
    each of its shapes where that one ended, by name, and ended where it is about as near: a likeness has found the
    machine, and hardly differs there."""
    best = min(trials.values(), key=distance)
    if not may_be_likeness(best):
        return {}
    found, out = best.model.fitted, dict[str, Trial[Explained]]()
    values = values_at(found)
    for candidate in tried:
        other = replace(found, model=candidate.model)
        begun = [
            fitted_from(other, values | dict(numbers), FIRST_ROUNDS)
            for numbers in candidate.effect.imitating(values)
        ]
        if begun:
            nearest = min(begun, key=lambda f: f.rms)
            trial = judged(scene, present, fit(nearest.moves, nearest.model, nearest.at, ROUNDS))
            if distance(trial) < AGAINST * distance(best):
                trial = ended_if_named(scene, present, trial)
            out[candidate.name] = min((trials[candidate.name], trial), key=distance)
    return out


def as_near(
    scene: Scene, present: Trial[Explained], trials: Mapping[str, Trial[Explained]]
) -> dict[str, Trial[Explained]]:
    """Where the nearest of all leaves more than the right one does, the next with their fits ended, by name, of those
    that explain nearly all and are not far behind: on a chain that is not the machine's, and that a fit leaves over a
    ridge only, the right one stands behind its likeness."""
    best = min(trials.values(), key=distance)
    if not may_be_likeness(best):
        return {}
    near = {
        name: distance(trial)
        for name, trial in trials.items()
        if not trial.model.ended
        and gone_from_all(present, trial, EXPLAINED)
        and distance(trial) <= BEHIND * distance(best)
    }
    return {
        name: min((trials[name], ended_if_named(scene, present, trials[name])), key=distance)
        for name in leading(near, FINALISTS)
    }


def may_be_likeness(best: Trial[Explained]) -> bool:
    """Whether the nearest of all is near and yet leaves more than the right one does."""
    return best.train_rms < SOUND and most_left(best) > ENDED
