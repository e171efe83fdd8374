"""From a gantry's fit of the first steps to the begin of one of all steps.

Begun anew from the spline of the speed samples, the later steps would be as far away as the first ones were before
they were fitted, and no machine is fitted to that. But the steps repeat: of the same direction they need the same
force, and so their motors move between their samples as those of the steps before. The distance of the two motors does
not repeat. It wanders: a motor that creeps at rest by less than the speed's resolution moves some micrometres from step
to step, mostly the same way. So it is followed from each step to the next.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from service.backlash.model_fit_data import Measured
from service.backlash.model_fit_problem import Fit, Point, Problem, fit
from service.backlash.model_fit_stages import Outcome, Reconstruction, repeated
from service.recording import FloatArray

ROUNDS = 6
"""Rounds in which the initial state of one step is found, everything else held."""


ALIKE = 2.0
"""Misfit of a step over that of the first ones at which it is one of them."""


def onward(
    measured: Measured, whole: Problem, found: Outcome, motors: Reconstruction
) -> tuple[Problem, Point]:
    """The problem of all steps and where its fit begins, from the fit of the first ones."""
    n, few, shared = len(found.problem.grids), found.problem, found.fit.point.shared
    if few.force is None:
        return whole, Point(shared, repeated(whole, found.fit.point.local))
    begun = motors(measured, whole, with_forces_repeated(whole, found))
    assert begun.force is not None
    echoes = few.echoes + begun.echoes[n:] if few.echoes and begun.echoes else begun.echoes
    force = np.concatenate((few.force, begun.force[n:]))
    begun = replace(begun, motion=few.motion + begun.motion[n:], force=force, echoes=echoes)
    return begun, Point(shared, followed_local(begun, found.fit))


def with_forces_repeated(whole: Problem, found: Outcome) -> Fit:
    """The fit of the first steps as if it were one of all: later ones need the mean force of those that went the same
    way, or the opposite one where none did."""
    force, s = found.fit.response.force[0], whole.s
    first = s[: len(force)]
    later = [
        force[first == way].mean(axis=0) if np.any(first == way) else -force.mean(axis=0)
        for way in s[len(force) :]
    ]
    response = replace(found.fit.response, force=np.stack([*force, *later])[None])
    return replace(found.fit, response=response)


def followed_local(begun: Problem, found: Fit) -> FloatArray:
    """Nuisance of all steps (T, X, L) from that of the first ones: from each step to the next, of motors that are as
    far apart as in the one before, and where that does not fit, of motors that went on as before."""
    shared, first = found.point.shared, found.point.local
    local = repeated(begun, first)
    for t in range(len(first), len(local)):
        one, ends = only_step(begun, t), list[Fit]()
        for further in (0.0, 1.0 / max(1, t - 1)):
            guess = local[t].copy()
            guess[:, 2] = local[t - 1, :, 2] + further * (local[t - 1, :, 2] - local[0, :, 2])
            ends.append(fit(one, Point(shared, guess[None]), ROUNDS, 1.0))
            if ends[-1].misfit < ALIKE * found.misfit:
                break
        local[t] = min(ends, key=lambda f: f.cost).point.local[0]
    return local


def only_step(problem: Problem, t: int) -> Problem:
    """The problem of one step, of which only the initial state is free."""
    part = slice(t, t + 1)
    force = None if problem.force is None else problem.force[part]
    held = replace(problem, free=(False,) * len(problem.free), force=force)
    return replace(held, grids=held.grids[part], motion=held.motion[part], echoes=held.echoes[part])
