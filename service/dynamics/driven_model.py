"""Parameters and state space of axes that are driven by their measured motor motion, eqs. (2)-(7) and (9).

The motor is no state here: its motion is the input. Between it and the dead zone lie `lumps` masses (0 or 1;
gearbox and pinion, eqs. (2)-(3)), behind it the carriage (4). Only the load's acceleration is compared with
the measurement, so all forces are given per moved mass M, the unit of a stiffness being 1/s²; the torque, where
recorded, says how heavy M is.

A gantry is two such axes and a spring and damper between the carriages, f of eq. (9).

Effects that the paper's model lacks are appended as a tuple: each declares its parameters and adds to the
matrices, with states of its own if it needs any, or changes what the sensor says (`DrivenEffect`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from service.dynamics.driven_propagation import CONSTANTS, LinearSystem
from service.recording import FloatArray

Values = Mapping[str, FloatArray]
"""Parameter name -> (S,) values, one per parameter set."""


@dataclass(frozen=True)
class Parameter:
    """One parameter: its name, unit, prior and bounds.

    Attributes
    ----------
    logarithmic : the prior is normal in the logarithm, with `spread` as its standard deviation there;
        else normal in the value, `spread` in the unit
    typical : centre of the prior
    """

    name: str
    unit: str
    typical: float
    spread: float
    logarithmic: bool = True

    def internal(self, value: FloatArray | float) -> FloatArray:
        """Value -> the fit's coordinate, whose prior is standard normal."""
        if self.logarithmic:
            return np.asarray(np.log(np.asarray(value) / self.typical) / self.spread)
        return np.asarray((np.asarray(value) - self.typical) / self.spread)

    def value(self, internal: FloatArray | float) -> FloatArray:
        """The fit's coordinate -> value."""
        moved = np.asarray(internal) * self.spread
        return np.asarray(self.typical * np.exp(moved) if self.logarithmic else self.typical + moved)


AXIS_PARAMETERS = (
    Parameter("backlash", "m", 5e-5, 1.5),
    Parameter("contact_stiffness", "1/s²", 4e5, 1.2),
    Parameter("contact_damping_ratio", "1", 0.06, 0.8),
    Parameter("coulomb", "m/s²", 0.3, 1.0),
    Parameter("viscous", "1/s", 1.0, 1.0),
    Parameter("constant", "m/s²", 0.0, 0.3, logarithmic=False),
    Parameter("skew", "s", 0.0, 1e-3, logarithmic=False),
)
"""Of each axis. Contact: k_p/M and d_p/(2·√(k_p·M)), in series with the drive where there are no lumps. Coulomb and
viscous friction of the guide and a constant force per M. Skew: by how much the speed's clock is ahead of the
sensor's. The priors are those of machine axes of 50 to 5,000 kg with contacts of 30 to 300 Hz and the few
percent of damping that steel joints have: they keep a fit sane, data decide."""

LINKS: Mapping[int, tuple[str, ...]] = {0: (), 1: ("drive",), 2: ("gear", "pinion")}
"""Between motor and dead zone, by number of lumps: each link is a spring and damper and the mass behind it."""

LINK_PARAMETERS: Mapping[str, tuple[Parameter, ...]] = {
    "drive": (
        Parameter("drive_stiffness", "1/s²", 8e5, 1.0),
        Parameter("drive_damping_ratio", "1", 0.03, 1.0),
        Parameter("drive_mass", "1", 0.08, 1.0),
    ),
    "gear": (
        Parameter("gear_stiffness", "1/s²", 1e6, 1.0),
        Parameter("gear_damping_ratio", "1", 0.03, 1.0),
        Parameter("gear_mass", "1", 0.06, 1.0),
    ),
    "pinion": (
        Parameter("pinion_stiffness", "1/s²", 1e6, 1.0),
        Parameter("pinion_damping_ratio", "1", 0.03, 1.0),
        Parameter("pinion_mass", "1", 0.03, 1.0),
    ),
}
"""Stiffness and mass per M; damping as a share of 2·√(stiffness·mass of the load), comparable with the contact's."""

BRIDGE_PARAMETERS = (
    Parameter("bridge_stiffness", "1/s²", 4e4, 1.2),
    Parameter("bridge_damping", "1/s", 20.0, 1.5),
    Parameter("bridge_offset", "m", 0.0, 1e-4, logarithmic=False),
    Parameter("mass_ratio", "1", 1.0, 0.3),
)
"""Of a gantry: per mass of the first axis; M2/M1; the distance of the two motors' positions at which the bridge
pulls on neither carriage, with both pinions in the middle of their gaps."""


@dataclass(frozen=True)
class Model:
    """Which structure: `axes` names (1 or 2, two are a gantry), `lumps` per axis, appended `effects`."""

    axes: tuple[str, ...]
    lumps: int = 0
    effects: tuple[DrivenEffect, ...] = ()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All shared parameters; an axis' carry its name in front, `X1.backlash`."""
        own = AXIS_PARAMETERS + tuple(p for link in LINKS[self.lumps] for p in LINK_PARAMETERS[link])
        named = [
            Parameter(f"{a}.{p.name}", p.unit, p.typical, p.spread, p.logarithmic)
            for a in self.axes
            for p in own
        ]
        bridge = BRIDGE_PARAMETERS if len(self.axes) == 2 else ()
        return (*named, *bridge, *(p for effect in self.effects for p in effect.parameters))

    @property
    def states_per_axis(self) -> int:
        """Position and speed of each lump and of the load."""
        return 2 * (self.lumps + 1)

    @property
    def n(self) -> int:
        """States of the whole system."""
        return self.states_per_axis * len(self.axes) + sum(effect.states for effect in self.effects)

    def load(self, axis: int) -> int:
        """Index of the load's position; its speed follows."""
        return axis * self.states_per_axis + 2 * self.lumps

    def pinion(self, axis: int) -> int | None:
        """Index of the position of what touches the rack; None: it is the motor itself."""
        return axis * self.states_per_axis + 2 * (self.lumps - 1) if self.lumps else None


class DrivenEffect:
    """One effect that the paper's model lacks; what it does not override leaves the model as it is.

    Attributes
    ----------
    parameters : its own, with unit and prior
    states : how many states it adds, positions each followed by its speed; they start at zero
    gaps, curves : how many gaps and tabulated forces it adds
    """

    parameters: tuple[Parameter, ...] = ()
    states: int = 0
    gaps: int = 0
    curves: int = 0

    def drive(self, c: FloatArray, model: Model, values: Values) -> FloatArray:
        """Called first: what moves the chain, from the motors' measured motion, both (S, T, K, X, J)."""
        return c

    def assemble(self, system: LinearSystem, model: Model, values: Values, room: Room) -> None:
        """Called once per simulation, after the declared model is in: add to the matrices in place."""

    def measure(self, predicted: FloatArray, model: Model, values: Values) -> FloatArray:
        """Called last: what the sensors make of the accelerations (S, T, X, K)."""
        return predicted


@dataclass(frozen=True)
class Room:
    """Where an effect's own states and gaps begin."""

    state: int
    gap: int


def assemble(model: Model, values: Values) -> LinearSystem:
    """Matrices of every parameter set; shapes in driven_propagation."""
    S, X = len(next(iter(values.values()))), len(model.axes)
    gaps = X + sum(effect.gaps for effect in model.effects)
    curves = sum(effect.curves for effect in model.effects)
    system = LinearSystem.empty(S, model.n, X, gaps, CONSTANTS, curves)
    for axis in range(X):
        add_axis(system, model, values, axis)
    if X == 2:
        add_bridge(system, model, values)
    room = Room(model.states_per_axis * X, X)
    for effect in model.effects:
        effect.assemble(system, model, values, room)
        room = Room(room.state + effect.states, room.gap + effect.gaps)
    return system


def spring_damper(values: Values, axis: str, link: str) -> tuple[FloatArray, FloatArray]:
    """Stiffness [1/s²] and damping [1/s] per moved mass of one link of an axis, (S,) each."""
    k = values[f"{axis}.{link}_stiffness"]
    return k, 2.0 * values[f"{axis}.{link}_damping_ratio"] * np.sqrt(k)


def add_axis(system: LinearSystem, model: Model, values: Values, axis: int) -> None:
    """Chain, contact and friction of one axis, eqs. (2)-(7)."""
    name, load, pinion = model.axes[axis], model.load(axis), model.pinion(axis)
    first = axis * model.states_per_axis
    for at in range(first, first + model.states_per_axis, 2):
        system.A[:, at, at + 1] = 1.0
    links = LINKS[model.lumps]
    masses = [values[f"{name}.{link}_mass"] for link in links]
    for body, link in enumerate(links):
        join(system, (body, axis, first), masses, spring_damper(values, name, link))
    system.A[:, load + 1, load + 1] -= values[f"{name}.viscous"]
    system.B[:, load + 1, system.constant(0)] += values[f"{name}.constant"]
    system.B[:, load + 1, system.constant(1)] -= values[f"{name}.coulomb"]
    system.k[:, axis], system.d[:, axis] = spring_damper(values, name, "contact")
    for side, sign in ((0, -1.0), (1, 1.0)):
        approach, push = system.approach[:, axis, side], system.push[:, axis, side]
        approach[:, load] = -sign
        approach[:, system.n + system.motor(axis) if pinion is None else pinion] = sign
        approach[:, system.n + system.constant()] = -0.5 * values[f"{name}.backlash"]
        push[:, load + 1] = sign
        if pinion is not None:
            push[:, pinion + 1] = -sign / masses[-1]


def join(
    system: LinearSystem,
    where: tuple[int, int, int],
    masses: list[FloatArray],
    law: tuple[FloatArray, FloatArray],
) -> None:
    """Spring and damper between body `where[0]` of a chain and the one before it (or the motor), in place.

    Parameters
    ----------
    where : body, axis (motor), index of the chain's first state
    masses : (S,) of each body, per moved mass
    law : stiffness and damping (S,); F = k·Δ + d·Δ̇, Δ being the body before minus the body
    """
    (body, axis, first), (k, d) = where, law
    at, before = first + 2 * body, first + 2 * (body - 1)
    for row, share in ((at, 1.0 / masses[body]), *(((before, -1.0 / masses[body - 1]),) if body else ())):
        system.A[:, row + 1, at] -= k * share
        system.A[:, row + 1, at + 1] -= d * share
        if body:
            system.A[:, row + 1, before] += k * share
            system.A[:, row + 1, before + 1] += d * share
        else:
            system.B[:, row + 1, system.motor(axis)] += k * share
            system.B[:, row + 1, system.motor(axis, 1)] += d * share


def add_bridge(system: LinearSystem, model: Model, values: Values) -> None:
    """f of eq. (9): spring and damper between the two carriages, relaxed at `bridge_offset`."""
    k, d, offset = (values[f"bridge_{name}"] for name in ("stiffness", "damping", "offset"))
    for me, other, sign, share in ((0, 1, 1.0, 1.0), (1, 0, -1.0, 1.0 / values["mass_ratio"])):
        x, y = model.load(me), model.load(other)
        system.A[:, x + 1, x] -= k * share
        system.A[:, x + 1, y] += k * share
        system.A[:, x + 1, x + 1] -= d * share
        system.A[:, x + 1, y + 1] += d * share
        system.B[:, x + 1, system.constant()] += sign * k * offset * share
