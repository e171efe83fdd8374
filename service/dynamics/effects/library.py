"""The effects that the simulation can have switched on, by their identifiers."""

from __future__ import annotations

from collections.abc import Mapping

from service.dynamics.effects.bodies import HungMassMode, MachineBodyMode
from service.dynamics.effects.carriage import (
    AsymmetricFriction,
    ConstantForce,
    PositionDependentForce,
    StribeckFriction,
)
from service.dynamics.effects.effect import Effect
from service.dynamics.effects.sensors import SensorLatency

LIBRARY: Mapping[str, type[Effect]] = {
    effect.name: effect
    for effect in (
        AsymmetricFriction,
        ConstantForce,
        HungMassMode,
        MachineBodyMode,
        PositionDependentForce,
        SensorLatency,
        StribeckFriction,
    )
}
