"""Further bodies on the driven model, given by what a modal test finds: mass ratio, frequency, damping ratio."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from service.dynamics.driven_effect import Case, DrivenEffect, Room
from service.dynamics.driven_model import add_bridge
from service.dynamics.driven_parameters import BRIDGE_PARAMETERS, Parameter, Values
from service.dynamics.driven_propagation import LinearSystem
from service.recording import FloatArray

SWING = ("displacement", "speed")
AUDIBLE = 0.1
"""Mass ratio at which a fit of what is heard between the moves begins (chosen)."""
WANDERING = 1e-6
"""What integrated speeds are off from move to move [m], about: some seconds of 1 kHz samples with a noise and a
resolution of 0.05 rpm each wander by half of it, and the impacts between the samples add as much."""
WANDER = "wander"
"""Its coordinate of a move."""


def swing(prefix: str, largest: float) -> tuple[Parameter, ...]:
    """Parameters of a mode; the damping is that of welded and bolted steel, on rubber at most."""
    return (
        Parameter(f"{prefix}_ratio", "1", 0.0, 0.3, logarithmic=False, low=0.0, high=largest, dose=0.02),
        Parameter(f"{prefix}_frequency", "Hz", 25.0, 1.0, low=2.0, high=250.0),
        Parameter(f"{prefix}_damping", "1", 0.02, 0.8, high=0.3),
    )


def at_rest(prefix: str) -> tuple[Parameter, ...]:
    """What still swings at the first grid point of a step: found again in each."""
    units = (("m", 1e-4), ("m/s", 1e-2))
    return tuple(
        Parameter(f"{prefix}_{name}", unit, 0.0, spread, logarithmic=False, found_again=True)
        for name, (unit, spread) in zip(SWING, units, strict=True)
    )


def free_swing(
    prefix: str, law: tuple[FloatArray, FloatArray], begun: Mapping[str, FloatArray], duration: FloatArray
) -> dict[str, FloatArray]:
    """Displacement and speed (S, T) of an oscillator a time (T,) [s] after it was let go (T,) each, or before; none of
    one that is not known.

    law : frequency without damping [Hz] and damping ratio, (S,) each
    """
    if f"{prefix}_{SWING[0]}" not in begun:
        return {}
    omega, zeta = 2.0 * np.pi * law[0][:, None], np.minimum(law[1], 0.99)[:, None]
    x, v = (begun[f"{prefix}_{name}"] for name in SWING)
    damped = omega * np.sqrt(1.0 - zeta**2)
    decay, c, s = np.exp(-zeta * omega * duration), np.cos(damped * duration), np.sin(damped * duration)
    pushed = (v + zeta * omega * x) / damped
    after = (
        decay * (x * c + pushed * s),
        decay * (v * c - (omega**2 * x + zeta * omega * v) / damped * s),
    )
    return {f"{prefix}_{name}": value for name, value in zip(SWING, after, strict=True)}


@dataclass(frozen=True)
class DrivenHungMass(DrivenEffect):
    """A part hung elastically on the carriage; `hung_ratio` is its mass over M, the frequency with M held."""

    name: ClassVar[str] = "hung_mass_mode"
    means: ClassVar[str] = "an elastically hung mass on the carriage swings"
    own: ClassVar[tuple[Parameter, ...]] = swing("hung", 1.0)
    own_nuisance: ClassVar[tuple[Parameter, ...]] = at_rest("hung")
    shapes: ClassVar[tuple[Mapping[str, float], ...]] = tuple(
        {"hung_frequency": float(f)} for f in np.geomspace(6.0, 120.0, 9)
    )
    free_swing = ("hung_frequency", {"hung_ratio": AUDIBLE}, 1.0)

    @property
    def states(self) -> int:
        return 2 * len(self.axes)

    def assemble(self, system: LinearSystem, case: Case, room: Room) -> None:
        for k, axis, x in self.each(case.model):
            ratio, omega = (case.values[f"{axis}.hung_{p}"] for p in ("ratio", "frequency"))
            omega = 2.0 * np.pi * omega
            law = (omega**2, 2.0 * case.values[f"{axis}.hung_damping"] * omega)
            hung, load = room.state + 2 * k, case.model.load(x)
            system.A[:, hung, hung + 1] = 1.0
            for part, size in enumerate(law):
                system.A[:, hung + 1, hung + part] -= size
                system.A[:, hung + 1, load + part] += size
                system.A[:, load + 1, hung + part] += ratio * size
                system.A[:, load + 1, load + part] -= ratio * size

    def begin(self, x0: FloatArray, case: Case, room: Room) -> None:
        for k, _, x in self.each(case.model):
            hung, load = room.state + 2 * k, case.model.load(x)
            x0[..., hung : hung + 2] = x0[..., load : load + 2] + case.nuisance[..., 2 * k : 2 * k + 2]

    def swinging(self, states: FloatArray, case: Case, room: Room) -> Mapping[str, FloatArray]:
        out = {}
        for k, axis, x in self.each(case.model):
            hung, load = room.state + 2 * k, case.model.load(x)
            for part, name in enumerate(SWING):
                out[f"{axis}.hung_{name}"] = states[..., hung + part] - states[..., load + part]
        return out

    def swung(
        self, values: Values, begun: Mapping[str, FloatArray], duration: FloatArray
    ) -> Mapping[str, FloatArray]:
        out: dict[str, FloatArray] = {}
        for axis in self.axes:
            law = (values[f"{axis}.hung_frequency"], values[f"{axis}.hung_damping"])
            out |= free_swing(f"{axis}.hung", law, begun, duration)
        return out


@dataclass(frozen=True)
class DrivenMachineBody(DrivenEffect):
    """The machine's body gives way on its feet; racks and guides, which it carries, move with it.

    `body_ratio` is M of the first axis over the body's mass, frequency and damping those of the body alone. The
    accelerometer feels the carriage's motion against the ground. Both axes of a gantry stand on one body.
    `body_drive_ratio` is what of the drive's inertia the body feels beside the rack's force, over its own: the torque's
    reaction on a body that rocks. While the flanks are in contact it cannot be told from the rack's force; while they
    are apart, it moves the rack by micrometres.
    """

    name: ClassVar[str] = "machine_body_mode"
    means: ClassVar[str] = "the machine's body swings on its feet and the axis excites it"
    shared: ClassVar[tuple[Parameter, ...]] = (
        *swing("body", 3.0),
        Parameter("body_drive_ratio", "1", 0.0, 0.03, logarithmic=False),
    )
    shared_nuisance: ClassVar[tuple[Parameter, ...]] = at_rest("body")
    shapes: ClassVar[tuple[Mapping[str, float], ...]] = tuple(
        {"body_frequency": float(f)} for f in np.geomspace(6.0, 60.0, 9)
    )
    free_swing = ("body_frequency", {"body_ratio": AUDIBLE}, float(np.sqrt(1.0 + AUDIBLE)))

    @property
    def states(self) -> int:
        return 2

    def carry(self, system: LinearSystem, case: Case, room: Room) -> None:
        body, omega = room.state, 2.0 * np.pi * case.values["body_frequency"]
        system.A[:, body, body + 1] = 1.0
        system.A[:, body + 1, body] -= omega**2
        system.A[:, body + 1, body + 1] -= 2.0 * case.values["body_damping"] * omega
        for _, _, x in self.each(case.model):
            ratio = case.values["body_ratio"] * (case.values.get("mass_ratio", 1.0) if x else 1.0)
            system.B[:, body + 1, system.motor(x, 2)] -= case.values["body_drive_ratio"]
            system.guides[x].slip[body + 1] -= 1.0
            system.guides[x].onto[:, body + 1] -= ratio
            for side, sign in ((0, -1.0), (1, 1.0)):
                system.approach[:, x, side, body] = sign
                system.push[:, x, side, body + 1] = -sign * ratio

    def begin(self, x0: FloatArray, case: Case, room: Room) -> None:
        x0[..., room.state : room.state + 2] = case.nuisance
        for _, _, x in self.each(case.model):
            load = case.model.load(x)
            x0[..., load : load + 2] += case.nuisance

    def swinging(self, states: FloatArray, case: Case, room: Room) -> Mapping[str, FloatArray]:
        return {f"body_{name}": states[..., room.state + k] for k, name in enumerate(SWING)}

    def carried(self, states: FloatArray, case: Case, room: Room) -> FloatArray:
        out = states.copy()
        for _, _, x in self.each(case.model):
            load = case.model.load(x)
            out[..., load : load + 2] -= states[..., room.state : room.state + 2]
        return out

    def swung(
        self, values: Values, begun: Mapping[str, FloatArray], duration: FloatArray
    ) -> Mapping[str, FloatArray]:
        """Friction holds the carriages on the body."""
        others = (
            (1.0 + values["mass_ratio"]) if len(self.axes) == 2 and "mass_ratio" in values else len(self.axes)
        )
        slower = 1.0 / np.sqrt(1.0 + others * values["body_ratio"])
        law = (slower * values["body_frequency"], slower * values["body_damping"])
        return free_swing("body", law, begun, duration)


@dataclass(frozen=True)
class MotorWander(DrivenEffect):
    """How much farther apart the two motors of a gantry are in a move than their integrated speeds say: their errors
    add up from move to move, and the bridge makes a force of them. Part of the declared model of a gantry."""

    name: ClassVar[str] = "motor_wander"
    means: ClassVar[str] = "integrated speeds wander from move to move"
    shared_nuisance: ClassVar[tuple[Parameter, ...]] = (
        Parameter(WANDER, "m", 0.0, WANDERING, logarithmic=False, found_again=True),
    )

    def drive(self, c: FloatArray, case: Case) -> FloatArray:
        out = c.copy()
        out[:, :, :, 1, 0] += case.nuisance
        return out


@dataclass(frozen=True)
class DrivenGantryCoupling(MotorWander):
    """Two axes that are declared to be single pull on each other: f of eq. (9), on a model without a bridge."""

    name: ClassVar[str] = "gantry_coupling"
    own_errors: ClassVar[bool] = True
    means: ClassVar[str] = "the two sides of the gantry pull on each other through the bridge"
    shared: ClassVar[tuple[Parameter, ...]] = (
        Parameter("bridge_stiffness", "1/s²", 0.0, 1e5, logarithmic=False, low=0.0, dose=1e3),
        *(replace(p, found_again=p.name == "bridge_offset") for p in BRIDGE_PARAMETERS[1:]),
    )

    def assemble(self, system: LinearSystem, case: Case, room: Room) -> None:
        add_bridge(system, case.model, case.values)
