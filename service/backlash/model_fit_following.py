"""How a gantry's motors follow forces that differ from those of their reconstruction, linear around one point.

The arrays are the largest of a fit; they are held in single precision, of which a ten-millionth is nothing, and only
one step of them is made double at a time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from service.recording import FloatArray

SingleArray = NDArray[np.float32]


@dataclass(frozen=True)
class Following:
    """Beyond their recoil the motors move by curves with coefficients η = answer·δF; see model_fit_motion.

    Attributes
    ----------
    force : (T, X, K + 1) on the motors per moved mass [m/s²], with which their motion was reconstructed
    answer : (T, X·B, X·(K + 1))
    acceleration, forces, recoil : (T, X·K, X·B), (T, X·(K + 1), X·B), (T, X·(K + 1)·2, X·B) what a unit of η changes
    """

    force: FloatArray
    answer: SingleArray
    acceleration: SingleArray
    forces: SingleArray
    recoil: SingleArray

    def curves(self, force: FloatArray) -> FloatArray:
        """η (T, S, X·B) under forces (S, T, X, K + 1)."""
        difference = (force - self.force).reshape(*force.shape[:2], -1).swapaxes(0, 1)
        return of_each_step(difference, self.answer)

    def added(self, acceleration: FloatArray, force: FloatArray) -> FloatArray:
        """The accelerations (S, T, X, K) with what the motors' following does to them."""
        change = of_each_step(self.curves(force), self.acceleration).swapaxes(0, 1)
        return np.asarray(acceleration + change.reshape(acceleration.shape))

    def settled(self, force: FloatArray, e: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Forces (T, X, K + 1) and recoil (T, X, K + 1, 2) with what the following does to them."""
        eta = self.curves(force[None])
        pushed, given = (of_each_step(eta, slopes) for slopes in (self.forces, self.recoil))
        return force + pushed.reshape(force.shape), e + given.reshape(e.shape)

    def judged(self) -> Following:
        """Without what only the forces need with which the motion is reconstructed further; copies, since an empty
        part of an array would keep all of it."""
        return replace(self, forces=self.forces[:0].copy(), recoil=self.recoil[:0].copy())

    def first_steps(self, n: int) -> Following:
        """The same for the first n steps."""
        slopes = (self.answer, self.acceleration, self.forces, self.recoil)
        return Following(self.force[:n], *(part[:n] for part in slopes))


def of_each_step(values: FloatArray, slopes: SingleArray) -> FloatArray:
    """Slopes (T, m, n) times values (T, S, n): (T, S, m). Of the slopes only one step is made double at a time."""
    return np.stack([own @ slope.T for own, slope in zip(values, slopes, strict=True)])
