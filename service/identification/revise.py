"""The backlash of a recording by a model that has effects beyond the declared one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from service.dynamics.effects.driven_library import DRIVEN
from service.identification.axis_verdict import LEFT, backlash_of
from service.identification.explanation import CannotExplain
from service.identification.moves_search import in_full, refitted, settled, steady
from service.identification.moves_starts import Candidate, compared
from service.identification.scene import declared_fit, scene_of
from service.recording import Recording

ROUNDS = 14


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
    recording: Recording, axes: Sequence[str], effects: Sequence[str]
) -> Mapping[str, RevisedValue]:
    """Fit one axis, or two that move together, with the named effects added to the declared model.

    Parameters
    ----------
    recording : with motor speed and load acceleration of the axes, and diagnostic moves
    effects : identifiers of the library, in the order in which they were found

    Raises
    ------
    CannotExplain : an effect has no model of moves
    """
    unknown = [name for name in effects if name not in DRIVEN]
    if unknown:
        raise CannotExplain(f"{', '.join(unknown)}: the model of diagnostic moves has no such effect")
    library = tuple(DRIVEN.values())
    with np.errstate(all="ignore"):  # a random machine may be unstable; its cost counts as infinite
        scene = scene_of([recording], recording, tuple(axes), tuple(axes) in recording.gantry, library)
        found = declared_fit(scene)
        for name in effects:
            effect = DRIVEN[name](found.model.axes)
            model = replace(found.model, effects=(*found.model.effects, effect))
            brief = compared(scene, found, [Candidate(effect, model)])[effect.name]
            found = refitted(found, brief, brief[0].rms)
        found = steady(settled(in_full(found), ROUNDS))
    values = {}
    for x, axis in enumerate(axes):
        b, std = backlash_of(found, x)
        values[axis] = RevisedValue(b, (max(0.0, b - 1.96 * std), b + 1.96 * std), found.rms)
    return values
