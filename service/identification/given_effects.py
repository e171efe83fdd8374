"""Fits of a model whose effects are given: those of an accepted revision, with nothing to choose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from service.backlash.moves_begun import Values, point_at, resettled
from service.backlash.moves_fit import fit, values_at
from service.backlash.moves_point import found_again
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_library import DRIVEN
from service.identification.explanation import Accepted
from service.identification.held_out import Explained, anew, trial_of
from service.identification.moves_end import HOWEVER_FAR, ended, settled
from service.identification.moves_search import propose
from service.identification.moves_starts import ROUNDS
from service.identification.scene import Scene
from service.identification.selection import LEFT, Trial


def searched_for(scene: Scene, declared: Trial[Explained], effects: Sequence[str]) -> Trial[Explained]:
    """The declared model's trial with the effects, found from nothing, one after the other; as many of them as do."""
    present, taken = declared, tuple[str, ...]()
    for name in effects:
        trials = propose(scene, (DRIVEN[name],), present, taken, lambda _text: None)
        if name not in trials:  # a few moves show that it will not do
            break
        present, taken = trials[name], (*taken, name)
    return ended(scene, present)


def begun_with(scene: Scene, model: Model, values: Values) -> Trial[Explained]:
    """The model begun with numbers that it has of another recording; its zeros are found again."""
    at = anew(scene.train, model, point_at(model, values, scene.train), found_again(model))
    begun = resettled(scene.train, model, at)
    found = settled(fit(begun.moves, model, begun.at, ROUNDS), ROUNDS, HOWEVER_FAR)
    return ended(scene, trial_of(scene, found))


def names_of(accepted: Mapping[str, Accepted], axes: Sequence[str]) -> tuple[str, ...]:
    """The effects that axes which are fitted together are accepted to have, of those that moves have a model of."""
    every = (name for axis in axes if axis in accepted for name in accepted[axis].effects)
    return tuple(name for name in dict.fromkeys(every) if name in DRIVEN)


def as_accepted(
    scene: Scene, declared: Trial[Explained], accepted: Mapping[str, Accepted]
) -> Trial[Explained]:
    """The trial of the model with the accepted effects: begun with the numbers that they were accepted with, and where
    these do not lead to what explains the moves, searched for, too."""
    axes = scene.declared.axes
    names = names_of(accepted, axes)
    effects = tuple(DRIVEN[name](axes).refined for name in names)
    model = replace(scene.declared, lumps=2, effects=(*scene.declared.effects, *effects))
    found = begun_with(scene, model, numbers_in(model, accepted))
    if found.train_rms <= LEFT:
        return found
    searched = searched_for(scene, declared, names)
    complete = len(searched.model.fitted.model.effects) == len(model.effects)
    return min(found, searched, key=lambda trial: trial.train_rms) if complete else found


def numbers_in(model: Model, accepted: Mapping[str, Accepted]) -> Values:
    """The accepted numbers by the names of the model's parameters; what two axes have in common is the first one's."""
    out: dict[str, float] = {}
    for p in model.parameters:
        of, _, short = p.name.rpartition(".")
        said = short + ("_s" if p.unit == "s" else "")
        for axis in (of,) if of else model.axes:
            numbers = accepted[axis].numbers if axis in accepted else {}
            if said in numbers:
                out.setdefault(p.name, numbers[said])
    return out


def with_effects_of(scene: Scene, trial: Trial[Explained]) -> Scene:
    """The scene, its places with the numbers that the effects of a trial have."""
    found = trial.model.fitted
    own = {p.name for effect in found.model.effects for p in effect.parameters}
    numbers = {name: value for name, value in values_at(found).items() if name in own}
    return replace(
        scene,
        rich={**numbers, **scene.rich},
        smooth={**numbers, **scene.smooth},
        plain={**numbers, **scene.plain},
    )
