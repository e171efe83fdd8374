"""What an effect is: a small class, appended to a tuple, that adds what the paper's model lacks.

An effect hooks in at one of three places, and leaves the others as they are:

- structure, before the run: further bodies, springs or gaps (``structure``);
- forces, once per sub-step: on the carriage, in the level of the guide's friction, in the flanks' place;
- measurement, after the physics: what the sensors make of the motion (``measure``).

``structure`` is propagated exactly like the rest of the mechanism. Forces are evaluated in the middle of the
sub-step and held over it (second order in dt).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from service.dynamics.mechanism import Mechanism

FloatArray = NDArray[np.float64]


class At(NamedTuple):
    """Where an axis is, referred to the output side: carriage x, v and pinion x_p, v_p, [m] and [m/s]."""

    x: float
    v: float
    x_p: float
    v_p: float


@dataclass(frozen=True)
class Measured:
    """What the sensors of an axis say at the ends of n sub-steps, each (n,); motor values at its shaft.

    ``load_acceleration`` is the carriage's at these instants; ``load_position`` and ``load_speed`` are there
    for axes with a measuring system at the load, and as the truth.
    """

    motor_position: FloatArray
    motor_speed: FloatArray
    motor_torque: FloatArray
    load_position: FloatArray
    load_speed: FloatArray
    load_acceleration: FloatArray


@dataclass(frozen=True)
class Quantity:
    """Unit of an effect's parameter, and the bounds of what a machine can have."""

    unit: str
    low: float
    high: float


def quantity(unit: str, low: float, high: float) -> Any:
    """Declare a dataclass field as a parameter with unit and bounds."""
    return field(metadata={"quantity": Quantity(unit, low, high)})


class Effect(Protocol):
    """One effect. The hooks do nothing unless an effect overrides them; its parameters are its fields.

    Attributes
    ----------
    name : identifier in the library
    """

    name: ClassVar[str]
    __dataclass_fields__: ClassVar[dict[str, Any]]

    def __post_init__(self) -> None:
        for parameter, bounds in quantities(type(self)).items():
            value = getattr(self, parameter)
            if not bounds.low <= value <= bounds.high:
                raise ValueError(
                    f"{self.name}: {parameter} must lie between {bounds.low:g} and {bounds.high:g} "
                    f"{bounds.unit}, got {value!r}"
                )

    @property
    def memory(self) -> float:
        """How far back [s] ``measure`` looks."""
        return 0.0

    def structure(self, mechanism: Mechanism, axes: tuple[str, ...]) -> Mechanism:
        """Return the mechanism with what the effect adds to ``axes``; called once, before the run.

        Equal effects on both axes of a gantry are one effect with both ``axes``.
        """
        return mechanism

    def force(self, at: At) -> float:
        """Return the force on the carriage [N], positive along travel; called once per sub-step."""
        return 0.0

    def friction(self, level: float, direction: int, at: At) -> float:
        """Return the Coulomb level [N] of the guide for sliding in ``direction`` ±1, from that without it."""
        return level

    def flanks(self, UL: float, LL: float, at: At) -> tuple[float, float]:
        """Return the flank distances [m] at this place, from those without it."""
        return UL, LL

    def measure(self, measured: Measured, dt: float) -> Measured:
        """Return what the sensors say instead; called with ``memory`` of the past before the new samples."""
        return measured


def quantities(effect: type[Effect]) -> Mapping[str, Quantity]:
    """The parameters of an effect with their units and bounds."""
    return {f.name: f.metadata["quantity"] for f in fields(effect) if "quantity" in f.metadata}
