"""An error of the mesh that repeats along the travel, on the driven model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from service.dynamics.driven_effect import Case, DrivenEffect, Room
from service.dynamics.driven_motion import along, grid_points
from service.dynamics.driven_parameters import Parameter
from service.dynamics.driven_propagation import LinearSystem
from service.recording import FloatArray

MODULES = (1e-3, 1.25e-3, 1.5e-3, 2e-3, 2.5e-3, 3e-3, 4e-3)
"""Of the teeth of racks [m]: ISO 54, the usual ones for such axes."""
PITCH_ERROR = 3e-3
"""Standard deviation of a tooth's pitch, as a share: of the motor's position, in which it is told, before all."""
TURNS = 2
"""How often the pinion's place is found anew (chosen: each leaves as much of what is missing as the error is steep, a
tenth at most)."""
PHASES = (0.0, 0.5 * np.pi)
"""Of a ripple, at which a score is taken: its amplitude may be negative."""


@dataclass(frozen=True)
class DrivenRipple(DrivenEffect):
    """An error of pinion and rack that repeats along the travel; its phase is found again in every recording.

    Attributes
    ----------
    module : of the rack's teeth [m], where the error is said to repeat with them; 0 where it may repeat in anything
    at_pinion : it is that at the pinion's place, which the chain's wind-up makes another than the motor's
    """

    module: float = 0.0
    at_pinion: bool = False

    name: ClassVar[str] = "transmission_ripple"
    means: ClassVar[str] = "the transmission's error repeats along the travel: teeth, bearing, gearbox"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("ripple_amplitude", "m", 0.0, 2e-5, logarithmic=False, dose=1e-6),
        Parameter("ripple_phase", "rad", 0.0, 2.0, logarithmic=False, found_again=True),
        Parameter("ripple_period", "m", 2e-3, 1.0, low=2e-4, high=3e-2),
    )
    shapes: ClassVar[tuple[Mapping[str, float], ...]] = tuple(
        {"ripple_period": float(period), "ripple_phase": phase}
        for period in np.geomspace(4e-4, 8e-3, 14)
        for phase in PHASES
    )

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        every = super().parameters
        if not self.module:
            return every
        pitch = np.pi * self.module
        return tuple(
            replace(p, typical=pitch, spread=PITCH_ERROR) if p.name.endswith("ripple_period") else p
            for p in every
        )

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        if not self.module:
            return super().starts
        plain = {p.name: 0.0 if p.dose else p.typical for p in self.parameters}
        phases = [name for name in plain if name.endswith("ripple_phase")]
        return tuple(plain | dict.fromkeys(phases, phase) for phase in PHASES)

    @property
    def standards(self) -> tuple[DrivenRipple, ...]:
        return tuple(replace(self, module=module) for module in MODULES)

    @property
    def motions(self) -> int:
        return len(self.axes)

    @property
    def refined(self) -> DrivenRipple:
        return replace(self, at_pinion=True)

    @property
    def turns(self) -> int:
        return TURNS if self.at_pinion else 0

    def follow(self, c: FloatArray, case: Case, states: FloatArray | None = None) -> FloatArray:
        """The error at the motor's place, or the pinion's where that is known, beyond that where a step begins: where
        the load rests is said from where its flanks are then."""
        out = np.empty((*c.shape[:3], len(self.axes), c.shape[-1]))
        for k, axis, x in self.each(case.model):
            size, phase, period = (
                case.values[f"{axis}.ripple_{p}"][:, None, None] for p in ("amplitude", "phase", "period")
            )
            kappa, points = 2.0 * np.pi / period, grid_points(c[:, :, :, x], case.h)
            if states is not None and (pinion := case.model.pinion(x)) is not None:
                place, speed = states[..., pinion], states[..., pinion + 1]
                points = np.stack((place, speed, np.gradient(speed, case.h, axis=-1)), axis=-1)
            angle = kappa * points[..., 0] + phase
            error, slope = size * np.sin(angle), size * kappa * np.cos(angle)
            out[:, :, :, k] = along(error - error[..., :1], slope, -(kappa**2) * error, points, case.h)
        return out

    def carry(self, system: LinearSystem, case: Case, room: Room) -> None:
        """Before `assemble`: the pieces of a bent contact are as far off as the first."""
        for k, _, x in self.each(case.model):
            error = system.n + system.motor(room.motion + k)
            for side, sign in ((0, -1.0), (1, 1.0)):
                system.approach[:, x, side, error] += sign
