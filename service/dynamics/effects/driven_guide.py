"""Effects on the carriage of the driven model: forces, and its guide's friction beyond viscous and Coulomb."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from service.dynamics.driven_effect import Case, DrivenEffect, Room
from service.dynamics.driven_friction import speeds
from service.dynamics.driven_parameters import Parameter, Values
from service.dynamics.driven_propagation import LinearSystem

ONE_WAY = {"constant_force": 1.0, "spring_preload": 1.0, "coulomb_asymmetry": -1.0, "viscous_asymmetry": -0.1}
"""What a unit of each adds to the force that acts one way while an axis moves; viscous friction at 0.1 m/s, the top
speed of a diagnostic step."""


def one_way(values: Mapping[str, float], axes: Sequence[str]) -> dict[str, float]:
    """That force per moved mass [m/s²] by axis, of all effects in `values`; none of an axis without them."""
    out: dict[str, float] = {}
    for axis in axes:
        for name, share in ONE_WAY.items():
            if f"{axis}.{name}" in values:
                out[axis] = out.get(axis, 0.0) + share * values[f"{axis}.{name}"]
    return out


@dataclass(frozen=True)
class DrivenConstantForce(DrivenEffect):
    """Gravity on a tilted axis, a counterweight: the declared model's constant, which is held at zero, released."""

    name: ClassVar[str] = "constant_force"
    means: ClassVar[str] = "a force pulls one way: gravity on a tilted axis, a counterweight"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("constant_force", "m/s²", 0.0, 0.5, logarithmic=False, dose=0.05),
    )

    def instead(self, values: Mapping[str, float]) -> Mapping[str, float]:
        return {f"{axis}.constant_force": f for axis, f in one_way(values, self.axes).items()}

    def restate(self, values: Values) -> Values:
        return {**values, **{f"{a}.constant": values[f"{a}.constant_force"] for a in self.axes}}


@dataclass(frozen=True)
class DrivenPositionForce(DrivenEffect):
    """A cable chain or a spring: a force that falls along the travel from its value where the recording began.

    Attributes
    ----------
    zeroed : a recording's positions begin at zero wherever the load lies in its gap, so `spring_zero`, where the force
        has that value, is found again in every recording, within about a gap; a search makes do without
    """

    zeroed: bool = False

    name: ClassVar[str] = "position_dependent_force"
    means: ClassVar[str] = "a force grows along the travel: cable chain, cover, spring"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("spring_rate", "1/s²", 0.0, 200.0, logarithmic=False, dose=20.0),
        Parameter("spring_preload", "m/s²", 0.0, 0.5, logarithmic=False, dose=0.05),
    )
    zero: ClassVar[Parameter] = Parameter("spring_zero", "m", 0.0, 6e-5, logarithmic=False, found_again=True)
    contains: ClassVar[tuple[str, ...]] = ("constant_force",)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        zeros = (self.zero.of(axis) for axis in self.axes if self.zeroed)
        return (*super().parameters, *zeros)

    @property
    def refined(self) -> DrivenPositionForce:
        return replace(self, zeroed=True)

    def instead(self, values: Mapping[str, float]) -> Mapping[str, float]:
        return {f"{axis}.spring_preload": f for axis, f in one_way(values, self.axes).items()}

    def assemble(self, system: LinearSystem, case: Case, room: Room) -> None:
        for _, axis, x in self.each(case.model):
            load, rate = case.model.load(x), case.values[f"{axis}.spring_rate"]
            zero = case.values[f"{axis}.spring_zero"] if self.zeroed else 0.0
            system.A[:, load + 1, load] -= rate
            system.B[:, load + 1, system.constant()] += case.values[f"{axis}.spring_preload"] + rate * zero


@dataclass(frozen=True)
class DrivenAsymmetricFriction(DrivenEffect):
    """A guide that rubs harder in positive travel than in negative, by twice the asymmetry."""

    name: ClassVar[str] = "asymmetric_friction"
    means: ClassVar[str] = "friction differs between the two directions: guide or seal damaged on one side"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("coulomb_asymmetry", "m/s²", 0.0, 0.3, logarithmic=False, dose=0.05),
        Parameter("viscous_asymmetry", "1/s", 0.0, 2.0, logarithmic=False, dose=0.5),
    )
    bends_friction: ClassVar[bool] = True

    def instead(self, values: Mapping[str, float]) -> Mapping[str, float]:
        """All of it at the Coulomb level: what a speed does is found from there."""
        force = one_way(values, self.axes)
        return {f"{axis}.coulomb_asymmetry": -f for axis, f in force.items()} | {
            f"{axis}.viscous_asymmetry": 0.0 for axis in force
        }

    def assemble(self, system: LinearSystem, case: Case, room: Room) -> None:
        for _, axis, x in self.each(case.model):
            guide, excess = system.guides[x], case.values[f"{axis}.coulomb_asymmetry"]
            guide.forward = np.maximum(guide.forward + excess, 0.0)
            guide.backward = np.maximum(guide.backward - excess, 0.0)
            guide.table += case.values[f"{axis}.viscous_asymmetry"][:, None] * np.abs(speeds())


@dataclass(frozen=True)
class DrivenStribeckFriction(DrivenEffect):
    """A guide that holds harder at low speed. The excess falls off as (1 + τ·x)^(−1/τ), x being (v/v_s)^δ: for τ = 0
    that is exp(−x) with δ from 0.5 to 2 (Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30, 1994), for τ = 1
    and δ = 2 it is 1/(1 + (v/v_s)²), whose tail reaches farther (Hess and Soom, J. Tribology 112, 1990)."""

    name: ClassVar[str] = "stribeck_friction"
    means: ClassVar[str] = "friction is higher at low speed: lubrication is poor"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("breakaway", "m/s²", 0.0, 0.5, logarithmic=False, low=0.0, dose=0.05),
        Parameter("stribeck_speed", "m/s", 0.012, 0.7, low=2e-3, high=0.2),
        Parameter("stribeck_exponent", "1", 2.0, 0.35, low=0.5, high=4.0),
        Parameter("stribeck_tail", "1", 0.5, 0.5, logarithmic=False, low=0.0, high=1.0),
    )
    shapes: ClassVar[tuple[Mapping[str, float], ...]] = (
        {"stribeck_speed": 0.006},
        {"stribeck_speed": 0.015},
        {"stribeck_speed": 0.04},
    )
    bends_friction: ClassVar[bool] = True

    def assemble(self, system: LinearSystem, case: Case, room: Room) -> None:
        v = speeds()
        for _, axis, x in self.each(case.model):
            guide, excess = system.guides[x], case.values[f"{axis}.breakaway"]
            speed, exponent, tail = (
                case.values[f"{axis}.stribeck_{p}"][:, None] for p in ("speed", "exponent", "tail")
            )
            # A floor near a fit's differences would hide the slope from it.
            tail = np.maximum(tail, 1e-12)
            left = np.exp(-np.log1p(tail * np.abs(v / speed) ** exponent) / tail)
            guide.forward = guide.forward + excess
            guide.backward = guide.backward + excess
            guide.table += excess[:, None] * (left - 1.0) * np.sign(v)


@dataclass(frozen=True)
class DrivenCurvedFriction(DrivenEffect):
    """Friction that grows with a power of the speed: less than in proportion (grease) or more (churning, wipers)."""

    name: ClassVar[str] = "curved_friction"
    means: ClassVar[str] = "friction does not grow in proportion to the speed"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("curved_level", "m/s²", 0.0, 0.5, logarithmic=False, dose=0.05),
        Parameter("curved_power", "1", 1.0, 0.7, low=0.2, high=4.0),
    )
    shapes: ClassVar[tuple[Mapping[str, float], ...]] = ({"curved_power": 2.0}, {"curved_power": 0.5})
    bends_friction: ClassVar[bool] = True

    def assemble(self, system: LinearSystem, case: Case, room: Room) -> None:
        """`curved_level` is its size at 0.1 m/s, the top speed of a diagnostic step."""
        v = speeds()
        for _, axis, x in self.each(case.model):
            grown = np.abs(v / 0.1) ** case.values[f"{axis}.curved_power"][:, None]
            system.guides[x].table += case.values[f"{axis}.curved_level"][:, None] * np.sign(v) * grown
