"""How the parts of a mesh's error hang together: it comes in waves, each about as long as a tooth.

A wave that is longer than the stroke is a slope and hardly a bow, one that is shorter mostly bows. How far the bows,
which shake the load, speak for a slope, which is hardly to be told from the backlash, therefore hangs on the wave's
length; that is unknown, but for bands of it the coefficients' covariance follows from waves of any phase.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.polynomial.legendre import leggauss, legvander

from service.backlash.model_fit_impurities import BOWS, MESH, MeshError
from service.recording import FloatArray

LENGTHS = (3e-3, 4.5e-3, 7e-3, 11e-3, 20e-3, 0.1)
"""Edges [m] of the bands of the waves' length: the pitch π·m of racks of module m = 1 to 6, and what is longer, as the
runout of a pinion."""

OF_A_BAND = 20
"""Waves that stand for a band, evenly in the logarithm of their length."""

NODES = 40
"""Of the quadrature over the stroke: a wave of 3 mm turns twice in 6 mm."""

LOOSE = 1e-3
"""What is left free beside waves, over the prior's own width: 3 nm."""


def of_waves(length: float) -> tuple[FloatArray, ...]:
    """Covariances (BOWS, BOWS) of one axis' coordinates of the mesh error, in which the fit's prior is the identity: of
    no waves in particular, which is the fit's prior, and of each band of waves of RMS MESH, over a stroke of `length`
    [m]."""
    return (np.eye(BOWS), *(band(length, *edges) for edges in pairwise(LENGTHS)))


@lru_cache(maxsize=64)
def band(length: float, shortest: float, longest: float) -> FloatArray:
    """The covariance (BOWS, BOWS) of waves of some lengths [m], evenly in the logarithm."""
    place, weight = leggauss(NODES)
    k = np.arange(1, BOWS + 1)
    projection = legvander(place, BOWS)[:, 1:] * weight[:, None] * (k + 0.5)
    turns = 0.5 * length * place / np.geomspace(shortest, longest, OF_A_BAND)[:, None]
    phase = 2.0 * np.pi * turns
    alike = np.mean(np.cos(phase[:, :, None] - phase[:, None, :]), axis=0)
    own = np.array([parameter.spread for parameter in MeshError.own]) / MESH
    return np.asarray(projection.T @ alike @ projection / np.outer(own, own) + LOOSE**2 * np.eye(BOWS))
