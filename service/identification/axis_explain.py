"""Explain the acceleration channel of an axis with diagnostic moves: from recordings to the verdict."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from service.identification.axis_effects import AxisEffect, axis_effects, gantry_coupling
from service.identification.axis_fit import Fit, errors, rms
from service.identification.axis_problem import AxisProblem, axis_problem
from service.identification.axis_search import (
    bridged_fit,
    candidate_fit,
    declared_fit,
    finished,
    judged,
    near_fit,
    settled,
    without_last,
    zeros_found,
)
from service.identification.axis_verdict import verdict
from service.identification.explanation import AxisExplanation
from service.identification.selection import Trial, independent_samples, select
from service.recording import FloatArray, Recording

SHORT = 3
"""Moves of the short problem in which starts are searched and candidates are first fitted."""
CLEAN = 1.3
"""Held-out RMS over the sensor's noise up to which nothing is missing (the issue's own bound)."""
MATERIAL = 0.15
"""Share of the held-out RMS that an effect must remove: what a wrong structure imitates stays below (chosen)."""
FURTHER = (0.4, 3.5)
"""For a second effect: the share it must remove, and the held-out RMS over the noise that must be left. Below
it the residual is that of an impact placed within a sample, which many effects imitate (measured on captures)."""
EARLY = 0.5
"""Share of a held-out move in which the pinion's zero is found again; the backlash pass comes after it."""
LOOKED_AT = 5
"""Candidates that are fitted further after a first look at all."""
FINALISTS = 2
"""Candidates whose fit is finished on all moves."""


@dataclass(frozen=True)
class Scene:
    """The problems of one axis (or gantry): short and whole train, validate, and the pool of random machines."""

    short: AxisProblem
    whole: tuple[AxisProblem, ...]
    held_out: AxisProblem
    pool: FloatArray
    library: tuple[AxisEffect, ...]


def explain_axes(
    train: Sequence[Recording],
    validate: Recording,
    axes: Sequence[str],
    tell: Callable[[str], None] = lambda _message: None,
) -> tuple[AxisExplanation, ...]:
    """The verdicts on one axis, or on the two of a gantry, in the acceleration channel."""
    tell(f"{' and '.join(axes)}: fitting the declared model")
    with np.errstate(all="ignore"):  # a random machine may be unstable; its cost counts as infinite
        scene, start = prepare(train, validate, axes)
        before = trial(scene, on_all_moves(scene, start))
        tell(f"declared model: held-out RMS {before.validation_rms:.2f} of the noise")
        selection = select(
            before,
            lambda present, taken: propose(scene, present, taken, tell),
            tell=tell,
            challenge=lambda present, best: _challenged(scene, present, best),
            material=MATERIAL,
            enough=CLEAN,
            further=FURTHER,
        )
    return verdict(scene.whole[0], scene.held_out, selection)


def prepare(train: Sequence[Recording], validate: Recording, axes: Sequence[str]) -> tuple[Scene, Fit]:
    """The scene and the declared model's fit; a declared gantry has its bridge, f of eq. (9)."""
    short = axis_problem(train[0], axes, SHORT)
    start, pool = declared_fit(short)
    whole = tuple(axis_problem(recording, axes) for recording in train)
    library = axis_effects()
    if len(axes) == 2 and tuple(axes) in validate.gantry:
        start = settled(short, bridged_fit(short, start, gantry_coupling()), 20)
    elif len(axes) == 2:
        library = (gantry_coupling(), *library)
    return Scene(short, whole, axis_problem(validate, axes), pool, library), start


def on_all_moves(scene: Scene, found: Fit) -> Fit:
    """The fit continued on all moves of the train recordings, each in turn from the one before."""
    for problem in scene.whole:
        found = settled(problem, zeros_found(problem, found.model), 12)
    return found


def trial(scene: Scene, found: Fit) -> Trial[Fit]:
    """A fit with its errors on the held-out moves, whose zeros are found again in each move's first half."""
    held = errors(scene.held_out, judged(scene.held_out, found, scene.whole[-1], EARLY))
    blocks = scene.held_out.blocks()
    sums = np.array([np.sum(held[blocks == b] ** 2) for b in np.unique(blocks)])
    last = scene.whole[-1]
    same = found if len(found.offsets) == len(last.moves) else zeros_found(last, found.model)
    return Trial(found, rms(errors(last, same)), rms(held), sums, np.zeros(0), independent_samples(held))


def propose(
    scene: Scene, present: Trial[Fit], taken: tuple[str, ...], tell: Callable[[str], None]
) -> Mapping[str, Trial[Fit]]:
    """Every effect that is not in yet, fitted to a few moves; the best of them fitted to all."""
    here = zeros_found(scene.short, present.model.model)
    library = {effect.name: effect for effect in scene.library if effect.name not in taken}
    found = {
        name: settled(scene.short, bridged_fit(scene.short, here, effect), 20)
        if effect.stage == "bridge"
        else near_fit(scene.short, here, effect)
        for name, effect in library.items()
    }

    def order() -> list[str]:
        return sorted(found, key=lambda name: rms(errors(scene.short, found[name])))

    for name in order()[:LOOKED_AT]:
        if library[name].stage == "bridge":
            continue
        found[name] = candidate_fit(scene.short, here, found[name], scene.pool, library[name])
        tell(f"tried {name}: {rms(errors(scene.short, found[name])):.2f}")
    for name in order()[:FINALISTS]:
        best = (
            found[name] if library[name].stage == "bridge" else finished(scene.short, found[name], scene.pool)
        )
        found[name] = on_all_moves(scene, best)
    return {name: trial(scene, f) for name, f in found.items()}


def _challenged(scene: Scene, present: Trial[Fit], best: Trial[Fit]) -> Trial[Fit]:
    """The present model fitted once more from where the best candidate ended, without the candidate's effect."""
    if best.validation_rms < 0.4 * present.validation_rms:
        return present
    stripped = without_last(best.model, len(present.model.model.z))
    again = on_all_moves(scene, settled(scene.short, zeros_found(scene.short, stripped.model)))
    other = trial(scene, again)
    return other if other.train_rms < present.train_rms else present
