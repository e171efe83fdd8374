"""What every real axis does a little beyond the paper's model, as nuisance of the fit.

No mesh runs without error, and the force of no flank grows quite in proportion to its depth. Left out, both bend the
backlash by micrometres while the misfit stays near 1: a flank that starts softly seems to be touched later, and an
error of the mesh adds what it changes between release and impact. Freed under priors of what sound machines have,
they take what is theirs, and the fit's covariance says what not knowing them costs. A clean machine leaves them at
nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import ClassVar

import numpy as np
from numpy.polynomial.legendre import leg2poly

from service.backlash.model_fit_problem import Problem
from service.dynamics.driven_effect import Case, DrivenEffect, Room
from service.dynamics.driven_motion import between
from service.dynamics.driven_parameters import Parameter
from service.dynamics.driven_propagation import LinearSystem
from service.dynamics.effects.driven_transmission import TYPICAL_PUSH, grid_points
from service.recording import FloatArray

BEND = 0.1
"""Prior of n − 1: steel on steel in line contact, as tooth flanks bear, has n = 10/9."""

MESH = 3e-6
"""Prior of the mesh error's longest waves [m]: what racks and pinions of medium quality have within a tooth."""

BOWS = 5
"""Legendre polynomials over the stroke that are free. Chosen: a step of 4 to 6 mm is about one tooth, its mesh error
one wave or less, of which these leave a fiftieth; faster ones hardly change between release and impact on average."""

BENDS = (0.0, 0.06, 0.2, 0.5, 0.9, 1.5, 2.4)
"""Depths between which a bent flank is straight, in depths under TYPICAL_PUSH. Chosen: twice as many move the backlash
by 0.05 µm at most, and a flank is hardly ever pressed deeper."""


def impurities(problem: Problem) -> tuple[DrivenEffect, ...]:
    """What is freed beside the declared model: every axis' mesh error over its stroke, and its bent contact."""
    axes = problem.model.axes
    places = [motion[0](grid.time) for motion, grid in zip(problem.motion, problem.grids, strict=True)]
    low, high = min(float(p.min()) for p in places), max(float(p.max()) for p in places)
    return MeshError(axes, low, high - low), BentContact(axes)


@dataclass(frozen=True)
class MeshError(DrivenEffect):
    """Kinematic error of the mesh, locked to the position: Legendre polynomials over the stroke. Cosines would fit as
    many numbers and leave a tenth of a wave that begins and ends with a slope.

    Attributes
    ----------
    origin, length : the stroke of the recorded motors at the output [m]
    """

    origin: float
    length: float

    name: ClassVar[str] = "mesh_error"
    means: ClassVar[str] = "the mesh of rack and pinion runs with a smooth error"
    own: ClassVar[tuple[Parameter, ...]] = tuple(
        Parameter(f"mesh_{k}", "m", 0.0, MESH * min(1.0, 2.0 / k), logarithmic=False)
        for k in range(1, BOWS + 1)
    )

    def drive(self, c: FloatArray, case: Case) -> FloatArray:
        """Position, speed and acceleration of the error at the grid points; a polynomial between them."""
        out = c.copy()
        for _, axis, x in self.each(case.model):
            sizes = np.stack([case.values[f"{axis}.mesh_{k}"] for k in range(1, BOWS + 1)])
            lanes = np.flatnonzero(np.any(sizes != 0.0, axis=0))
            if len(lanes):
                out[lanes, :, :, x] += self.error(c[lanes, :, :, x], sizes[:, lanes], case.h)
        return out

    def error(self, c: FloatArray, sizes: FloatArray, h: float) -> FloatArray:
        """Its polynomials (S, T, K, J) along motions c (S, T, K, J); sizes (BOWS, S)."""
        points, scale = grid_points(c, h), 2.0 / self.length
        place = scale * (points[..., 0] - self.origin) - 1.0
        along = np.zeros_like(place)
        slope, bow = along, along
        for size in (powers() @ sizes)[::-1, :, None, None]:
            bow = bow * place + 2.0 * slope
            slope = slope * place + along
            along = along * place + size
        v, a = scale * slope * points[..., 1], scale * slope * points[..., 2]
        return between(along, v, a + scale**2 * bow * points[..., 1] ** 2, h)


@cache
def powers() -> FloatArray:
    """Coefficients (BOWS + 1, BOWS) of the powers of the place that the polynomials are made of."""
    legendre = np.eye(BOWS + 1)[1:]
    return np.stack([np.pad(leg2poly(one), (0, BOWS - k)) for k, one in enumerate(legendre, 1)], axis=1)


@dataclass(frozen=True)
class BentContact(DrivenEffect):
    """Flanks whose force grows with depth to the power n = 1 + bend: k·δ·(δ/δ0)^bend, δ0 being the depth under
    TYPICAL_PUSH, where it is as large as the straight flank's.

    The law is a chain of straight pieces, each a flank of its own that is met a little deeper than the one before,
    spring and damper in one proportion: so the propagation stays exact between events. A force that is looked up at the
    grid points only misses the first tenths of a micrometre, where the bend is greatest and the backlash is decided.
    """

    name: ClassVar[str] = "bent_contact"
    means: ClassVar[str] = "the flanks' force grows a little faster than their depth"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("bend", "1", 0.0, BEND, logarithmic=False, low=-0.5, high=1.5),
    )

    @property
    def gaps(self) -> int:
        return len(self.axes) * (len(BENDS) - 2)

    def assemble(self, system: LinearSystem, case: Case, room: Room) -> None:
        """The first piece takes the straight flank's place, the others are added."""
        end = system.n + system.constant()
        for at, axis, x in self.each(case.model):
            more = room.gap + at * (len(BENDS) - 2) + np.arange(len(BENDS) - 2)
            k, d = system.k[:, x].copy(), system.d[:, x].copy()
            stiffer = stiffening(case.values[f"{axis}.bend"])
            for gap, begin, share in zip((x, *more), BENDS, stiffer.T, strict=False):
                system.approach[:, gap], system.push[:, gap] = system.approach[:, x], system.push[:, x]
                system.approach[:, gap, :, end] -= (begin * TYPICAL_PUSH / k)[:, None]
                system.k[:, gap], system.d[:, gap] = share * k, share * d


def stiffening(bend: FloatArray) -> FloatArray:
    """What every piece adds to the stiffness (S, len(BENDS) − 1), by least squares on the curve x^(1 + bend)."""
    x = np.linspace(0.0, BENDS[-1], 200)
    deeper = np.maximum(x[:, None] - np.array(BENDS[:-1]), 0.0)
    return np.asarray(np.linalg.lstsq(deeper, x[:, None] ** (1.0 + bend), rcond=None)[0].T)
