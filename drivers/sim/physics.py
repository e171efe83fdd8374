"""What the simulated machine asks of the physics that moves it.

``drivers`` never imports ``service``: the physics is handed in from outside and fits by shape. All in SI,
positions, speeds and accelerations of set-points and motors at the motor shaft, positive is positive travel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Setpoint:
    """What one drive asks of its motor during one block, at the *ends* of the block's n sub-steps.

    Attributes
    ----------
    enabled : False = the power stage is off: no torque, the axis coasts unless the brake grips; the set-points
        are to be ignored
    position : (n,) [rad]
    speed : (n,) [rad/s]
    acceleration : (n,) [rad/s²]
    braked : the motor's holding brake grips
    """

    enabled: bool
    position: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    braked: bool = False


class PhysicsBlock(Protocol):
    """What one axis did during one block, at the ends of the block's n sub-steps."""

    @property
    def motor_position(self) -> FloatArray:
        """(n,) [rad]"""

    @property
    def motor_speed(self) -> FloatArray:
        """(n,) [rad/s]"""

    @property
    def motor_torque(self) -> FloatArray:
        """(n,) [N·m]"""

    @property
    def load_acceleration(self) -> FloatArray:
        """(n,) [m/s²] of the moved load, or [rad/s²] on a rotary axis"""


class Physics(Protocol):
    """The mechanics of all axes, which may pull at one another; starts at rest, all motors at position 0."""

    @property
    def axes(self) -> Sequence[str]:
        """Names of the axes, in the order of set-points and blocks."""

    @property
    def dt(self) -> float:
        """The sub-step [s]; a whole number of them makes one SYNC period."""

    def advance(self, duration: float, setpoints: Sequence[Setpoint]) -> Sequence[PhysicsBlock]:
        """Move on by ``duration`` [s] = n·dt under one set-point per axis; one block per axis comes back."""
