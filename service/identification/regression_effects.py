"""Candidate effects of the channels that are linear in most parameters: torque balance, motor minus load.

Each effect is a small class: its name, the columns that it adds to the regression, and at most one parameter
that enters nonlinearly, with the range in which it is looked for. Adding an effect to the library is adding a
class and naming it in ``TORQUE_EFFECTS`` or ``DEFLECTION_EFFECTS``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from service.identification.motion_signals import Drive
from service.recording import FloatArray


class RegressionEffect(Protocol):
    """What the regression asks of an effect.

    ``shape`` names the nonlinear parameter and its unit, None where there is none.
    """

    @property
    def name(self) -> str: ...
    @property
    def shape(self) -> tuple[str, str] | None: ...
    def applies(self, has_torque: bool) -> bool:
        """Whether the effect can be told from the declared model, given whether torque was recorded."""

    def grid(self, drive: Drive, residual: FloatArray) -> Sequence[float]:
        """Values of the nonlinear parameter to start from; a single 0.0 where there is none."""

    def columns(self, drive: Drive, shape: float) -> dict[str, FloatArray]:
        """Columns (n,) by the name of their coefficient, whose unit is the channel's over the column's."""


@dataclass(frozen=True)
class Latency:
    """Time skew: the channel reads what was true ``latency_s`` earlier. It shifts the whole prediction."""

    name: str = "sensor_latency"
    shape: tuple[str, str] | None = ("latency_s", "s")

    def applies(self, has_torque: bool) -> bool:
        return True

    def grid(self, drive: Drive, residual: FloatArray) -> Sequence[float]:
        """Up to 10 ms either way, beyond which two channels are not one recording; a quarter millisecond apart."""
        return tuple(np.linspace(-10e-3, 10e-3, 81))

    def columns(self, drive: Drive, shape: float) -> dict[str, FloatArray]:
        return {}


@dataclass(frozen=True)
class AsymmetricFriction:
    """Friction that differs between the directions of travel, in its Coulomb and its viscous part."""

    name: str = "asymmetric_friction"
    shape: tuple[str, str] | None = None

    def applies(self, has_torque: bool) -> bool:
        return True

    def grid(self, drive: Drive, residual: FloatArray) -> Sequence[float]:
        return (0.0,)

    def columns(self, drive: Drive, shape: float) -> dict[str, FloatArray]:
        return {"coulomb_asymmetry": np.abs(drive.direction), "viscous_asymmetry": np.abs(drive.speed)}


@dataclass(frozen=True)
class CurvedFriction:
    """Friction that grows with a power of the speed other than one (lubricant film, seals)."""

    name: str = "curved_friction"
    shape: tuple[str, str] | None = ("exponent", "1")

    def applies(self, has_torque: bool) -> bool:
        return True

    def grid(self, drive: Drive, residual: FloatArray) -> Sequence[float]:
        """Powers from a fifth to three, leaving out one, which is the viscous friction already declared."""
        return (0.2, 0.35, 0.5, 0.7, 1.4, 2.0, 3.0)

    def columns(self, drive: Drive, shape: float) -> dict[str, FloatArray]:
        largest = np.abs(drive.speed).max()
        return {"curvature": drive.direction * (np.abs(drive.speed) / largest) ** shape}


@dataclass(frozen=True)
class Stribeck:
    """Friction that falls from breakaway to sliding over a characteristic speed (Stribeck 1902)."""

    name: str = "stribeck_friction"
    shape: tuple[str, str] | None = ("stribeck_speed", "m/s")

    def applies(self, has_torque: bool) -> bool:
        return True

    def grid(self, drive: Drive, residual: FloatArray) -> Sequence[float]:
        return tuple(np.geomspace(2.0 * drive.speed_scale, 0.5 * np.abs(drive.speed).max(), 8))

    def columns(self, drive: Drive, shape: float) -> dict[str, FloatArray]:
        return {"breakaway_excess": drive.direction * np.exp(-np.abs(drive.speed) / shape)}


@dataclass(frozen=True)
class PositionForce:
    """A force that depends on where the axis is: cable chain, spring, cover."""

    name: str = "position_dependent_force"
    shape: tuple[str, str] | None = None

    def applies(self, has_torque: bool) -> bool:
        return True

    def grid(self, drive: Drive, residual: FloatArray) -> Sequence[float]:
        return (0.0,)

    def columns(self, drive: Drive, shape: float) -> dict[str, FloatArray]:
        return {"spring_rate": drive.position, "spring_curvature": drive.position**2}


@dataclass(frozen=True)
class PositionFriction:
    """Friction that depends on where the axis is: guide alignment, local wear, preload of the screw."""

    name: str = "position_dependent_friction"
    shape: tuple[str, str] | None = None

    def applies(self, has_torque: bool) -> bool:
        return True

    def grid(self, drive: Drive, residual: FloatArray) -> Sequence[float]:
        return (0.0,)

    def columns(self, drive: Drive, shape: float) -> dict[str, FloatArray]:
        sign = drive.direction
        return {"friction_slope": sign * drive.position, "friction_bow": sign * drive.position**2}


@dataclass(frozen=True)
class Ripple:
    """Ripple locked to position: one pair of sine and cosine of the travel, its period looked for."""

    name: str = "transmission_ripple"
    shape: tuple[str, str] | None = ("period", "m")

    def applies(self, has_torque: bool) -> bool:
        return True

    def grid(self, drive: Drive, residual: FloatArray) -> Sequence[float]:
        """The four strongest periods of the residual over position, between a third and a 300th of the travel."""
        travel = float(np.ptp(drive.position))
        cycles = np.arange(3.0, 300.0, 0.25)
        moving = np.abs(drive.speed) > drive.speed_scale
        phase = np.exp(2j * np.pi * np.outer(cycles / travel, drive.position[moving]))
        strength = np.abs(phase @ residual[moving])
        best = np.argsort(strength)[::-1][:4]
        return tuple(travel / cycles[best])

    def columns(self, drive: Drive, shape: float) -> dict[str, FloatArray]:
        angle = 2.0 * np.pi * drive.position / shape
        return {"ripple_sine": np.sin(angle), "ripple_cosine": np.cos(angle)}


@dataclass(frozen=True)
class LostMotion:
    """Deflection that follows the direction of travel and stays when the axis stops: play, presliding.

    A play operator: the state follows the travel until it saturates at ±1 after ``presliding`` of reversal.
    """

    name: str = "lost_motion"
    shape: tuple[str, str] | None = ("presliding", "m")

    def applies(self, has_torque: bool) -> bool:
        return True

    def grid(self, drive: Drive, residual: FloatArray) -> Sequence[float]:
        return tuple(float(np.ptp(drive.position)) * np.array([1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2]))

    def columns(self, drive: Drive, shape: float) -> dict[str, FloatArray]:
        return {"half_lost_motion": play(drive.position, shape)}


def play(position: FloatArray, width: float) -> FloatArray:
    """State (n,) of a play of half-width ``width`` driven by ``position`` (n,), scaled to ±1, starting at 0."""
    state, states = 0.0, np.empty(len(position))
    for k, change in enumerate(np.diff(position, prepend=position[0]) / width):
        state = min(1.0, max(-1.0, state + change))
        states[k] = state
    return states


@dataclass(frozen=True)
class GearboxClearance:
    """A gap in the gearbox: the deflection changes with the sign of the transmitted torque."""

    name: str = "gearbox_clearance"
    shape: tuple[str, str] | None = None

    def applies(self, has_torque: bool) -> bool:
        return True

    def grid(self, drive: Drive, residual: FloatArray) -> Sequence[float]:
        return (0.0,)

    def columns(self, drive: Drive, shape: float) -> dict[str, FloatArray]:
        if drive.torque is None:
            return {"half_clearance": np.tanh(drive.acceleration / (0.02 * np.abs(drive.acceleration).max()))}
        return {"half_clearance": np.tanh(drive.torque / (0.02 * np.abs(drive.torque).max()))}


@dataclass(frozen=True)
class ContactNonlinearity:
    """A spring that hardens with the load (teeth, bearings): a cubic term of the torque."""

    name: str = "contact_nonlinearity"
    shape: tuple[str, str] | None = None

    def applies(self, has_torque: bool) -> bool:
        return True

    def grid(self, drive: Drive, residual: FloatArray) -> Sequence[float]:
        return (0.0,)

    def columns(self, drive: Drive, shape: float) -> dict[str, FloatArray]:
        if drive.torque is None:
            return {"cubic_compliance": drive.acceleration**3}
        return {"cubic_compliance": (drive.torque / np.abs(drive.torque).max()) ** 3}


@dataclass(frozen=True)
class Compliance:
    """Wind-up by the load's inertia, which the motor torque does not show or which was not recorded."""

    name: str = "compliance"
    shape: tuple[str, str] | None = None

    def applies(self, has_torque: bool) -> bool:
        return True

    def grid(self, drive: Drive, residual: FloatArray) -> Sequence[float]:
        return (0.0,)

    def columns(self, drive: Drive, shape: float) -> dict[str, FloatArray]:
        return {"inertial_compliance": drive.acceleration}


@dataclass(frozen=True)
class SensorGain:
    """A wrong scale of one of the two position sensors: the difference grows with the travel."""

    name: str = "sensor_gain"
    shape: tuple[str, str] | None = None

    def applies(self, has_torque: bool) -> bool:
        return True

    def grid(self, drive: Drive, residual: FloatArray) -> Sequence[float]:
        return (0.0,)

    def columns(self, drive: Drive, shape: float) -> dict[str, FloatArray]:
        return {"gain_error": drive.position}


def torque_effects() -> tuple[RegressionEffect, ...]:
    """What a torque balance at the motor may lack."""
    return (
        Latency(),
        AsymmetricFriction(),
        CurvedFriction(),
        Stribeck(),
        PositionForce(),
        PositionFriction(),
        Ripple(),
    )


def deflection_effects() -> tuple[RegressionEffect, ...]:
    """What motor minus load may lack beyond offset and torque over stiffness."""
    return (
        Latency(),
        LostMotion(),
        GearboxClearance(),
        ContactNonlinearity(),
        Compliance(),
        SensorGain(),
        Ripple(),
    )
