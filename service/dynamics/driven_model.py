"""State space of axes that are driven by their measured motor motion, eqs. (2)-(7) and (9).

The motor is no state here: its motion is the input. Between it and the dead zone lie `lumps` masses (0, 1 or 2;
gearbox and pinion, eqs. (2)-(3)), behind it the carriage (4). A gantry is two such axes and a spring and damper
between the carriages, f of eq. (9).

Effects that the declared model lacks are appended as a tuple (``driven_effect``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from service.dynamics.driven_effect import Case, DrivenEffect, Room
from service.dynamics.driven_friction import SHARES, add_friction, speeds
from service.dynamics.driven_parameters import (
    AXIS_PARAMETERS,
    BRIDGE_PARAMETERS,
    LINK_PARAMETERS,
    LINKS,
    TURNOVER_PARAMETERS,
    Parameter,
    Scales,
    Structure,
    Values,
)
from service.dynamics.driven_propagation import CONSTANTS, Guide, LinearSystem
from service.recording import FloatArray

__all__ = ["LINKS", "DrivenEffect", "Model", "Parameter", "Values", "assemble", "spring_damper"]


Cases = tuple[tuple[DrivenEffect, Case, Room], ...]
"""Every effect with the case as it sees it and where its own part of the system begins."""


@dataclass(frozen=True)
class Model(Structure):
    """Which structure: `axes` names (1 or 2), `lumps` per axis, appended `effects`.

    Attributes
    ----------
    friction : "moving": the axis moves in its step's direction all the time; "whole_move": from rest to rest
    held : parameters of the axes that are no free numbers but stay at their typical value, e.g. ("constant", "skew")
    bridge : whether two axes are a gantry, coupled by f of eq. (9)
    """

    effects: tuple[DrivenEffect, ...] = ()
    friction: Literal["moving", "whole_move"] = "moving"
    held: tuple[str, ...] = ()
    bridge: bool = True

    @cached_property
    def of_axis(self) -> tuple[Parameter, ...]:
        """Parameters of each axis, the held ones too."""
        turnover = TURNOVER_PARAMETERS if self.friction == "whole_move" else ()
        return (
            AXIS_PARAMETERS + turnover + tuple(p for link in LINKS[self.lumps] for p in LINK_PARAMETERS[link])
        )

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All free shared parameters; an axis' carry its name in front, `X1.backlash`."""
        named = [p.of(a) for a in self.axes for p in self.of_axis if p.name not in self.held]
        bridge = BRIDGE_PARAMETERS if len(self.axes) == 2 and self.bridge else ()
        return (*named, *bridge, *(p for effect in self.effects for p in effect.parameters))

    @cached_property
    def scales(self) -> Scales:
        """Of the parameters."""
        return Scales.of(self.parameters)

    def values(self, shared: FloatArray) -> Values:
        """Coordinates (S, P) of the parameters -> values by name, (S,) each."""
        columns = np.ascontiguousarray(self.scales.values(shared).T)
        return {p.name: column for p, column in zip(self.parameters, columns, strict=True)}

    def numbers(self, shared: FloatArray) -> dict[str, float]:
        """The same of one point (P,)."""
        return {name: float(value[0]) for name, value in self.values(shared[None]).items()}

    @cached_property
    def nuisance(self) -> tuple[Parameter, ...]:
        """Coordinates of every step that the effects add to the load's own position and speed."""
        return tuple(p for effect in self.effects for p in effect.nuisance)

    @property
    def n(self) -> int:
        """States of the whole system."""
        return self.states_per_axis * len(self.axes) + sum(effect.states for effect in self.effects)

    def complete(self, values: Values) -> Values:
        """The values of the free parameters, the held ones, and what effects make of both."""
        S = len(next(iter(values.values())))
        held = {f"{a}.{p.name}": p.typical for a in self.axes for p in self.of_axis if p.name in self.held}
        whole: Mapping[str, FloatArray] = {name: np.full(S, x) for name, x in held.items()} | dict(values)
        for effect in self.effects:
            whole = effect.restate(whole)
        return whole

    def lags(self, values: Mapping[str, float]) -> tuple[float, ...]:
        """Time constants [s] by which the drives' speeds lag behind their motors', with values by full name; beside a
        latency a filter does not tell which of both."""
        if any(effect.name == "sensor_latency" for effect in self.effects):
            return (0.0,) * len(self.axes)
        return tuple(sum(effect.lag(values, axis) for effect in self.effects) for axis in self.axes)

    def cases(self, whole: Case) -> Iterator[tuple[DrivenEffect, Case, Room]]:
        """Every effect with the case as it sees it and where its own part of the system begins."""
        room, first = Room(self.states_per_axis * len(self.axes), self.first_free_gap, len(self.axes)), 0
        for effect in self.effects:
            end = first + len(effect.nuisance)
            yield effect, replace(whole, nuisance=whole.nuisance[..., first:end]), room
            room = Room(room.state + effect.states, room.gap + effect.gaps, room.motion + effect.motions)
            first = end

    @property
    def first_free_gap(self) -> int:
        """Gaps of the declared model: one per axis, and those for the corners of its friction."""
        return len(self.axes) * (1 + len(SHARES) if self.friction == "whole_move" else 1)


def assemble(model: Model, case: Case, cases: Cases) -> LinearSystem:
    """Matrices of every parameter set, `cases` being those of the effects; shapes in driven_propagation."""
    values, X = case.values, len(model.axes)
    S = len(next(iter(values.values())))
    curved = any(effect.bends_friction for effect in model.effects)
    system = LinearSystem.empty(
        S,
        model.n,
        X + sum(effect.motions for effect in model.effects),
        model.first_free_gap + sum(effect.gaps for effect in model.effects),
        CONSTANTS,
        (X if curved else 0) + sum(effect.curves for effect in model.effects),
    )
    for axis in range(X):
        add_axis(system, model, values, axis)
        system.guides.append(guide_of(system, model, values, axis))
    if X == 2 and model.bridge:
        add_bridge(system, model, values)
    for effect, own, room in cases:
        effect.carry(system, own, room)
    for effect, own, room in cases:
        effect.assemble(system, own, room)
    for axis, guide in enumerate(system.guides):
        add_friction(system, guide, X + len(SHARES) * axis, curved)
    return system


def guide_of(system: LinearSystem, model: Model, values: Values, axis: int) -> Guide:
    """The declared friction of an axis' guide, which stands on the ground."""
    name, speed = model.axes[axis], model.load(axis) + 1
    S, n, U = system.B.shape
    slip, onto = np.zeros(n + U), np.zeros((S, n))
    slip[speed], onto[:, speed] = 1.0, 1.0
    level = values[f"{name}.coulomb"]
    whole = model.friction == "whole_move"
    turnover = (values[f"{name}.turnover_speed"], values[f"{name}.turnover_spread"]) if whole else None
    return Guide(
        slip,
        onto,
        level.copy(),
        level.copy(),
        values[f"{name}.viscous"].copy(),
        turnover,
        np.zeros((S, len(speeds()))),
    )


def spring_damper(values: Values, axis: str, link: str) -> tuple[FloatArray, FloatArray]:
    """Stiffness [1/s²] and damping [1/s] per moved mass of one link of an axis, (S,) each."""
    k = values[f"{axis}.{link}_stiffness"]
    return k, 2.0 * values[f"{axis}.{link}_damping_ratio"] * np.sqrt(k)


def add_axis(system: LinearSystem, model: Model, values: Values, axis: int) -> None:
    """Chain and contact of one axis, eqs. (2)-(7), and a constant force."""
    name, load, pinion = model.axes[axis], model.load(axis), model.pinion(axis)
    first = axis * model.states_per_axis
    for at in range(first, first + model.states_per_axis, 2):
        system.A[:, at, at + 1] = 1.0
    links = LINKS[model.lumps]
    masses = [values[f"{name}.{link}_mass"] for link in links]
    for body, link in enumerate(links):
        join(system, (body, axis, first), masses, spring_damper(values, name, link))
    system.B[:, load + 1, system.constant(0)] += values[f"{name}.constant"]
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


def add_bridge(system: LinearSystem, model: Structure, values: Values) -> None:
    """f of eq. (9): spring and damper between the two carriages, relaxed at `bridge_offset`."""
    k, d, offset = (values[f"bridge_{name}"] for name in ("stiffness", "damping", "offset"))
    for me, other, sign, share in ((0, 1, 1.0, 1.0), (1, 0, -1.0, 1.0 / values["mass_ratio"])):
        x, y = model.load(me), model.load(other)
        system.A[:, x + 1, x] -= k * share
        system.A[:, x + 1, y] += k * share
        system.A[:, x + 1, x + 1] -= d * share
        system.A[:, x + 1, y + 1] += d * share
        system.B[:, x + 1, system.constant()] += sign * k * offset * share
