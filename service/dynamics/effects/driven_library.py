"""The effects that the driven model can be given, by their identifiers; ``driven_effect`` says what one is."""

from __future__ import annotations

from collections.abc import Mapping

from service.dynamics.driven_effect import DrivenEffect
from service.dynamics.effects.driven_bodies import DrivenGantryCoupling, DrivenHungMass, DrivenMachineBody
from service.dynamics.effects.driven_guide import (
    DrivenAsymmetricFriction,
    DrivenConstantForce,
    DrivenCurvedFriction,
    DrivenPositionForce,
    DrivenStribeckFriction,
)
from service.dynamics.effects.driven_ripple import DrivenRipple
from service.dynamics.effects.driven_sensors import (
    DrivenBias,
    DrivenGain,
    DrivenLatency,
    DrivenSensorFilter,
    DrivenSpeedFilter,
)
from service.dynamics.effects.driven_transmission import (
    DrivenBentContact,
    DrivenClearance,
    DrivenLocalBacklash,
    DrivenPreload,
)

DRIVEN: Mapping[str, type[DrivenEffect]] = {
    effect.name: effect
    for effect in (
        DrivenLatency,
        DrivenGain,
        DrivenBias,
        DrivenSensorFilter,
        DrivenSpeedFilter,
        DrivenConstantForce,
        DrivenPositionForce,
        DrivenAsymmetricFriction,
        DrivenStribeckFriction,
        DrivenCurvedFriction,
        DrivenClearance,
        DrivenLocalBacklash,
        DrivenPreload,
        DrivenBentContact,
        DrivenRipple,
        DrivenHungMass,
        DrivenMachineBody,
        DrivenGantryCoupling,
    )
}
