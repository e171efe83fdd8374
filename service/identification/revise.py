"""The backlash of a recording by a model that has effects beyond the declared one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from service.backlash.moves_fit import Fitted, values_at
from service.dynamics.effects.driven_library import DRIVEN
from service.identification.axis_numbers import interval_95
from service.identification.explanation import CannotExplain
from service.identification.given_effects import begun_with, searched_for
from service.identification.held_out import trial_of
from service.identification.moves_end import HOWEVER_FAR, settled
from service.identification.moves_starts import ROUNDS
from service.identification.scene import Scene, declared_fits, scene_of
from service.identification.selection import LEFT
from service.recording import Recording


@dataclass(frozen=True)
class RevisedValue:
    """backlash [m], its 95 % interval [m], and the fit's RMS residual over what is expected of a right model."""

    backlash: float
    interval_95: tuple[float, float]
    misfit: float

    @property
    def explained(self) -> bool:
        """Whether the effects leave about the noise."""
        return self.misfit <= LEFT


def revised_values(
    recording: Recording, axes: Sequence[str], effects: Sequence[str], others: Sequence[Recording] = ()
) -> Mapping[str, RevisedValue]:
    """Fit one axis, or two that move together, with the named effects added to the declared model, as the search for
    them does, with nothing to choose.

    Parameters
    ----------
    recording : with motor speed and load acceleration of the axes, and diagnostic moves
    effects : identifiers of the library, in the order in which they were found
    others : recordings of the same axes. Where a fit ends in a wrong valley, it is begun once more with the numbers
        that describe one of these; it lends a place to begin, and no value

    Raises
    ------
    CannotExplain : an effect has no model of moves
    """
    unknown = [name for name in effects if name not in DRIVEN]
    if unknown:
        raise CannotExplain(f"{', '.join(unknown)}: the model of diagnostic moves has no such effect")
    with np.errstate(all="ignore"):  # a random machine may be unstable; its cost counts as infinite
        scene = _scene(recording, axes)
        found = _searched(scene, effects)
        for other in others:
            if found.rms <= LEFT:
                break
            there = _searched(_scene(other, axes), effects)
            if there.rms <= LEFT:
                found = min(found, _begun_from(scene, there), key=lambda f: f.rms)
    values = {}
    for x, axis in enumerate(axes):
        values[axis] = RevisedValue(*interval_95(found, x), found.rms)
    return values


def _scene(recording: Recording, axes: Sequence[str]) -> Scene:
    together = tuple(axes) in recording.gantry
    return scene_of([recording], recording, tuple(axes), together, tuple(DRIVEN.values()))


def _searched(scene: Scene, effects: Sequence[str]) -> Fitted:
    """The model with the effects, found from nothing."""
    declared = trial_of(scene, settled(next(declared_fits(scene)), ROUNDS, HOWEVER_FAR))
    return searched_for(scene, declared, effects).model.fitted


def _begun_from(scene: Scene, there: Fitted) -> Fitted:
    """The model begun with the numbers that it has of another recording."""
    return begun_with(scene, there.model, values_at(there)).model.fitted
