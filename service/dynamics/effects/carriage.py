"""Effects that act on the carriage as a force, or in its guide's friction."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp
from typing import ClassVar

from service.dynamics.effects.effect import At, Effect, quantity


@dataclass(frozen=True)
class ConstantForce(Effect):
    """Gravity on a tilted axis, a counterweight: ``value``, positive along travel."""

    name: ClassVar[str] = "constant_force"
    value: float = quantity("N", -5e3, 5e3)

    def force(self, at: At) -> float:
        return self.value


@dataclass(frozen=True)
class PositionDependentForce(Effect):
    """A cable chain or a hose that pulls like a spring of ``stiffness`` towards the position ``centre``."""

    name: ClassVar[str] = "position_dependent_force"
    stiffness: float = quantity("N/m", 0.0, 1e6)
    centre: float = quantity("m", -100.0, 100.0)

    def force(self, at: At) -> float:
        return -self.stiffness * (at.x - self.centre)


@dataclass(frozen=True)
class StribeckFriction(Effect):
    """A guide that holds harder at low speed.

    The Coulomb level is raised to ``static`` at rest, the excess falling off as exp(−(v/v_s)²) with the
    Stribeck speed ``v_s`` (Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30, 1994; exponent 2).
    """

    name: ClassVar[str] = "stribeck_friction"
    static: float = quantity("N", 0.0, 5e3)
    v_s: float = quantity("m/s", 1e-4, 1.0)

    def friction(self, level: float, direction: int, at: At) -> float:
        # Extrapolated to the middle of the sub-step the speed may have turned: the sliding stops before.
        v = max(0.0, direction * at.v)
        return level + (self.static - level) * exp(-((v / self.v_s) ** 2))


@dataclass(frozen=True)
class AsymmetricFriction(Effect):
    """A guide that rubs harder in one direction: the level is raised by ``excess`` in positive travel and
    lowered by it in negative travel."""

    name: ClassVar[str] = "asymmetric_friction"
    excess: float = quantity("N", -2e3, 2e3)

    def friction(self, level: float, direction: int, at: At) -> float:
        return max(0.0, level + direction * self.excess)
