"""Effects on the carriage of the driven model: forces, and its guide's friction beyond viscous and Coulomb."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy.optimize import least_squares, lsq_linear

from service.dynamics.driven_effect import Case, DrivenEffect, Room
from service.dynamics.driven_friction import speeds
from service.dynamics.driven_parameters import Parameter, Values
from service.dynamics.driven_propagation import LinearSystem
from service.recording import FloatArray

SLOWEST, TOP = 2e-3, 0.1
"""Speeds of a diagnostic step [m/s] from which on friction has turned over, and at the top."""
USUAL = 0.02
"""What a standard deviation of a number's prior counts [m/s²] where a curve hardly tells it (chosen)."""
ONE_WAY = {"constant_force": 1.0, "spring_preload": 1.0, "coulomb_asymmetry": -1.0, "viscous_asymmetry": -TOP}
"""What a unit of each adds to the force that acts one way while an axis moves; viscous friction at the top speed."""


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
class FrictionLaw(DrivenEffect):
    """A guide's friction as another function of the speed than the declared model's, alike in both directions."""

    def force(self, v: FloatArray, values: Values, axis: str) -> FloatArray:
        """(S, n) what it adds to an axis' friction per moved mass [m/s²] while that slides at the speeds v > 0 (n,)."""
        raise NotImplementedError

    def imitating(self, values: Mapping[str, float]) -> Iterator[Mapping[str, float]]:
        """With the declared friction, as near as it comes to the curve that another law makes in the speeds of a step:
        what the two differ by may be the least of what tells them from each other, and the rest of a machine that was
        found with the one is that of the other."""
        laws = [law(self.axes) for law in (DrivenStribeckFriction, DrivenCurvedFriction)]
        there = [law for law in laws if all(p.name in values for p in law.parameters)]
        if len(there) != 1 or there[0].name == self.name:
            return
        v = np.linspace(SLOWEST, TOP, 60)
        for shape in self.starts:
            out: dict[str, float] = {}
            for axis in self.axes:
                curve = there[0].force(v, {k: np.array([x]) for k, x in values.items()}, axis)[0]
                curve = curve + values[f"{axis}.coulomb"] + values[f"{axis}.viscous"] * v
                out |= self.nearest_to(curve, v, axis, shape)
            yield out

    def nearest_to(
        self, curve: FloatArray, v: FloatArray, axis: str, shape: Mapping[str, float]
    ) -> dict[str, float]:
        """Its numbers, and the Coulomb level and the viscous friction, that are nearest to a whole curve (n,), begun
        with a shape."""
        own = [p.of(axis) for p in self.own]
        names = (*(p.name for p in own), f"{axis}.coulomb", f"{axis}.viscous")

        def beside(numbers: FloatArray) -> FloatArray:
            values = {k: np.array([x]) for k, x in zip(names, numbers, strict=True)}
            apart = self.force(v, values, axis)[0] + numbers[-2] + numbers[-1] * v - curve
            unusual = [p.internal(x) for p, x in zip(own, numbers[:-2], strict=True)]
            return np.concatenate((apart, USUAL * np.array(unusual)))

        amount = np.array([p.dose > 0.0 for p in own] + [True, True])
        low = np.array([p.low if p.dose else max(p.low, 0.0) for p in own] + [0.0, 0.0])
        high = np.array([p.high for p in own] + [np.inf, np.inf])
        first = np.where(amount, 0.0, [*(shape[p.name] for p in own), 0.0, 0.0])
        of_one = [beside(first + unit) - beside(first) for unit in np.eye(len(first))[amount]]
        limits = (low[amount], high[amount])
        first[amount] = lsq_linear(np.stack(of_one, axis=1), -beside(first), limits).x
        best = least_squares(beside, np.clip(first, low + 1e-9, high - 1e-9), bounds=(low, high))
        return dict(zip(names, map(float, best.x), strict=True))


@dataclass(frozen=True)
class DrivenStribeckFriction(FrictionLaw):
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

    def force(self, v: FloatArray, values: Values, axis: str) -> FloatArray:
        excess, speed, exponent, tail = (values[f"{axis}.{p.name}"][:, None] for p in self.own)
        # A floor near a fit's differences would hide the slope from it.
        tail = np.maximum(tail, 1e-12)
        return np.asarray(excess * np.exp(-np.log1p(tail * np.abs(v / speed) ** exponent) / tail))

    def assemble(self, system: LinearSystem, case: Case, room: Room) -> None:
        """The excess belongs to the Coulomb level, and what it loses with the speed to the curve."""
        v = speeds()
        for _, axis, x in self.each(case.model):
            guide, excess = system.guides[x], case.values[f"{axis}.breakaway"]
            guide.forward = guide.forward + excess
            guide.backward = guide.backward + excess
            guide.table += (self.force(v, case.values, axis) - excess[:, None]) * np.sign(v)


@dataclass(frozen=True)
class DrivenCurvedFriction(FrictionLaw):
    """Friction that grows with a power of the speed: less than in proportion (grease) or more (churning, wipers)."""

    name: ClassVar[str] = "curved_friction"
    means: ClassVar[str] = "friction does not grow in proportion to the speed"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("curved_level", "m/s²", 0.0, 0.5, logarithmic=False, dose=0.05),
        Parameter("curved_power", "1", 1.0, 0.7, low=0.2, high=4.0),
    )
    shapes: ClassVar[tuple[Mapping[str, float], ...]] = ({"curved_power": 2.0}, {"curved_power": 0.5})
    bends_friction: ClassVar[bool] = True

    def force(self, v: FloatArray, values: Values, axis: str) -> FloatArray:
        """`curved_level` is its size at the top speed of a diagnostic step."""
        level, power = (values[f"{axis}.{p.name}"][:, None] for p in self.own)
        return np.asarray(level * np.abs(v / TOP) ** power)

    def assemble(self, system: LinearSystem, case: Case, room: Room) -> None:
        v = speeds()
        for _, axis, x in self.each(case.model):
            system.guides[x].table += np.sign(v) * self.force(v, case.values, axis)
