"""What every real axis does a little beyond the paper's model, as nuisance of the fit.

No mesh runs without error, and the force of no flank grows quite in proportion to its depth. Left out, both bend the
backlash by micrometres while the misfit stays near 1: a flank that starts softly seems to be touched later, and an
error of the mesh adds what it changes between release and impact. Freed under priors of what sound machines have,
they take what is theirs, and the fit's covariance says what not knowing them costs. A clean machine leaves them at
nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import ClassVar

import numpy as np
from numpy.polynomial.legendre import leg2poly

from service.backlash.model_fit_problem import Problem
from service.dynamics.driven_effect import Case, DrivenEffect
from service.dynamics.driven_motion import add_error
from service.dynamics.driven_parameters import Parameter
from service.dynamics.effects.driven_transmission import DrivenBentContact
from service.recording import FloatArray

BEND = 0.1
"""Prior of n − 1: steel on steel in line contact, as tooth flanks bear, has n = 10/9."""

MESH = 3e-6
"""Prior of the mesh error's longest waves [m]: what racks and pinions of medium quality have within a tooth."""

BOWS = 5
"""Legendre polynomials over the stroke that are free. Chosen: a step of 4 to 6 mm is about one tooth, its mesh error
one wave or less, of which these leave a fiftieth; faster ones hardly change between release and impact on average."""

COARSE, FINE = (
    (0.0, 0.06, 0.2, 0.5, 0.9, 1.5, 2.4),
    (0.0, 0.015, 0.05, 0.12, 0.24, 0.4, 0.6, 0.85, 1.2, 1.6, 2.4),
)
"""Depths between which a sound flank is straight, in depths under a typical push. Chosen: of a soft flank that is
pressed by 30 µm the steps between half as many pieces leave a trace above the noise; twice as many change no likelihood
any more."""


def impurities(problem: Problem, fine: bool = False) -> tuple[DrivenEffect, ...]:
    """What is freed beside the declared model: every axis' mesh error over its stroke, and its bent contact. A `fine`
    contact is for a single axis' value, and slow."""
    axes = problem.model.axes
    places = [
        one(grid.time) for motion, grid in zip(problem.motion, problem.grids, strict=True) for one in motion
    ]
    low, high = min(float(p.min()) for p in places), max(float(p.max()) for p in places)
    return MeshError(axes, low, high - low), BentContact(axes, FINE if fine else COARSE)


@dataclass(frozen=True)
class MeshError(DrivenEffect):
    """Kinematic error of the mesh, locked to the position: Legendre polynomials over the stroke. Cosines would fit as
    many numbers and leave a tenth of a wave that begins and ends with a slope.

    Attributes
    ----------
    origin, length : the stroke of the recorded motors at the output [m]
    width : of its prior, over that of `own`
    """

    origin: float
    length: float
    width: float = 1.0

    name: ClassVar[str] = "mesh_error"
    means: ClassVar[str] = "the mesh of rack and pinion runs with a smooth error"
    own: ClassVar[tuple[Parameter, ...]] = tuple(
        Parameter(f"mesh_{k}", "m", 0.0, MESH * min(1.0, 2.0 / k), logarithmic=False)
        for k in range(1, BOWS + 1)
    )

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Under the prior's own width."""
        named = (p.of(axis) for axis in self.axes for p in self.own)
        return tuple(replace(p, spread=self.width * p.spread) for p in named)

    def drive(self, c: FloatArray, case: Case) -> FloatArray:
        """Position, speed and acceleration of the error at the grid points; a polynomial between them."""
        out = c.copy()
        for _, axis, x in self.each(case.model):
            sizes = np.stack([case.values[f"{axis}.mesh_{k}"] for k in range(1, BOWS + 1)], axis=1)
            add_error(out, x, sizes @ powers().T, self.origin, 2.0 / self.length, case.h)
        return out


@cache
def powers() -> FloatArray:
    """Coefficients (BOWS + 1, BOWS) of the powers of the place that the polynomials are made of."""
    legendre = np.eye(BOWS + 1)[1:]
    return np.stack([np.pad(leg2poly(one), (0, BOWS - k)) for k, one in enumerate(legendre, 1)], axis=1)


@dataclass(frozen=True)
class BentContact(DrivenBentContact):
    """The bend that sound flanks have."""

    name: ClassVar[str] = "bent_contact"
    own: ClassVar[tuple[Parameter, ...]] = (replace(DrivenBentContact.own[0], spread=BEND, dose=0.0),)

    @property
    def refined(self) -> BentContact:
        """In finer pieces, without a damper of its own."""
        return replace(self, bends=FINE)
