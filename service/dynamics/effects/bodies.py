"""Effects that are further bodies: they are given by what a modal test finds, frequency and damping ratio."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi
from typing import ClassVar

from service.dynamics.axis import body
from service.dynamics.effects.effect import Effect, quantity
from service.dynamics.mechanism import Mechanism

BASE = "base"


@dataclass(frozen=True)
class HungMassMode(Effect):
    """A part hung elastically on the carriage (cutting head, cable box): ``mass`` comes on top of M.

    ``frequency`` and ``damping`` ratio are those of the part with the carriage held.
    """

    name: ClassVar[str] = "hung_mass_mode"
    mass: float = quantity("kg", 0.1, 1e3)
    frequency: float = quantity("Hz", 1.0, 500.0)
    damping: float = quantity("1", 0.0, 1.0)

    def structure(self, mechanism: Mechanism, axes: tuple[str, ...]) -> Mechanism:
        k, d = _spring_and_damper(self.mass, self.frequency, self.damping)
        for axis in axes:
            hung = body(axis, "hung")
            mechanism = mechanism.with_body(hung, self.mass)
            mechanism = mechanism.with_element(mechanism.row(hung, body(axis, "carriage")), k, d)
        return mechanism


@dataclass(frozen=True)
class MachineBodyMode(Effect):
    """The machine's body gives way on its feet: racks and guides, which it carries, move with it.

    ``frequency`` and ``damping`` ratio are those of the body of ``mass`` alone on the ground. The
    accelerometer feels the carriage's motion against the ground. Both axes of a gantry share one body.
    """

    name: ClassVar[str] = "machine_body_mode"
    mass: float = quantity("kg", 50.0, 1e5)
    frequency: float = quantity("Hz", 1.0, 200.0)
    damping: float = quantity("1", 0.0, 1.0)

    def structure(self, mechanism: Mechanism, axes: tuple[str, ...]) -> Mechanism:
        m = mechanism.with_body(BASE, self.mass)
        m = m.with_element(m.row(BASE), *_spring_and_damper(self.mass, self.frequency, self.damping))
        base = m.row(BASE)
        guides = {body(axis, "carriage") for axis in axes}
        # The pinion rolls on the rack: its way is the carriage's way relative to the body.
        contacts = tuple(replace(c, row=c.row + base) if c.name in axes else c for c in m.contacts)
        slidings = tuple(replace(s, row=s.row - base) if s.name in guides else s for s in m.slidings)
        return replace(m, contacts=contacts, slidings=slidings)


def _spring_and_damper(mass: float, frequency: float, damping: float) -> tuple[float, float]:
    """k [N/m] and d [N s/m] of an oscillator with ``frequency`` [Hz] and ``damping`` ratio."""
    omega = 2 * pi * frequency
    return mass * omega**2, 2 * damping * mass * omega
