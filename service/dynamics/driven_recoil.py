"""The motor gives way to what the model pushes it with: its recorded motion, corrected for another force.

The motor's motion between its samples was reconstructed with the force of one parameter set. Another set
pushes the motor otherwise, and that the motor answers at once; only slower than the samples is its motion known
whatever pushes it. So each motor is held on its recorded motion as by a soft spring and damper of frequency Ω:

    ë = −φ·F − 2·Ω·ė − Ω²·e

What is simulated is driven by x_mot + e, x_mot being the reconstructed motion less the recoil of the set that it was
reconstructed with: for that set itself nothing changes, whatever Ω is, and Ω only says how fast fits and
reconstructions come to agree.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.linalg import expm

from service.dynamics.driven_effect import Case, DrivenEffect, Room
from service.dynamics.driven_parameters import LINKS
from service.dynamics.driven_propagation import LinearSystem
from service.recording import FloatArray


@dataclass(frozen=True)
class Recoil(DrivenEffect):
    """All motors give way. `force` : φ of each axis, moved mass over the motor's inertia; `rate` : Ω [1/s]."""

    force: tuple[float, ...] = ()
    rate: float = 0.0

    name: ClassVar[str] = "recoil"
    means: ClassVar[str] = "The motor gives way to the force on it between the samples of its speed."

    @property
    def states(self) -> int:
        return 2 * len(self.axes)

    def assemble(self, system: LinearSystem, case: Case, room: Room) -> None:
        """The recoil's own balance, and its share in the force of the first link (a chain without one is not driven
        by a force)."""
        link = LINKS[case.model.lumps][0]
        for at, axis, x in self.each(case.model):
            k = case.values[f"{axis}.{link}_stiffness"]
            d = 2.0 * case.values[f"{axis}.{link}_damping_ratio"] * np.sqrt(k)
            share = 1.0 / case.values[f"{axis}.{link}_mass"]
            body, own = x * case.model.states_per_axis, room.state + 2 * at
            system.A[:, own, own + 1] = 1.0
            for j, law in enumerate((k, d)):
                system.A[:, body + 1, own + j] += law * share
                system.A[:, own + 1, own + j] -= self.force[at] * law
                system.A[:, own + 1, body + j] += self.force[at] * law
                system.B[:, own + 1, system.motor(x, j)] -= self.force[at] * law
            system.A[:, own + 1, own] -= self.rate**2
            system.A[:, own + 1, own + 1] -= 2.0 * self.rate

    def of(self, states: FloatArray, room: Room) -> FloatArray:
        """Position [m] and speed [m/s] of every axis' recoil, (S, T, X, K + 1, 2), from the states (S, T, K + 1, n)."""
        own = states[..., room.state : room.state + self.states]
        return np.moveaxis(own.reshape(*own.shape[:-1], len(self.axes), 2), 3, 2)

    def under(self, force: FloatArray, axis: int, h: float) -> FloatArray:
        """The recoil (K + 1, …, 2) of one axis under forces (K + 1, …) that go straight between the grid's points."""
        law = np.zeros((4, 4))
        law[0, 1], law[1, :3], law[2, 3] = (
            1.0,
            (-(self.rate**2), -2.0 * self.rate, -self.force[axis]),
            1.0 / h,
        )
        whole = expm(h * law)[:2]
        out = np.zeros((*force.shape, 2))
        for k in range(len(force) - 1):
            rise = (force[k + 1] - force[k])[..., None]
            out[k + 1] = out[k] @ whole[:, :2].T + force[k][..., None] * whole[:, 2] + rise * whole[:, 3]
        return out

    def course(self, e: FloatArray, force: FloatArray) -> FloatArray:
        """Position, speed and acceleration (X, K + 1, 3) of the recoil e (X, K + 1, 2) under the force (X, K + 1)."""
        pushed = -np.array(self.force)[:, None] * force
        rate = pushed - 2.0 * self.rate * e[..., 1] - self.rate**2 * e[..., 0]
        return np.concatenate((e, rate[..., None]), axis=-1)
