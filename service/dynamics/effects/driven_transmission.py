"""Effects between motor and rack on the driven model: gaps, flanks and errors of the transmission."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from service.dynamics.driven_effect import Case, DrivenEffect, Room
from service.dynamics.driven_model import join, spring_damper
from service.dynamics.driven_motion import between
from service.dynamics.driven_parameters import LINKS, Parameter
from service.dynamics.driven_propagation import Curve, LinearSystem
from service.recording import FloatArray

TYPICAL_PUSH = 4.0
"""Acceleration at which a bent contact is as stiff as its stiffness says [m/s²]: the middle of a diagnostic step's."""

POINTS = 401
REACH = 5.0
"""How deep the flanks' curve is tabulated, in depths under TYPICAL_PUSH."""


@dataclass(frozen=True)
class DrivenClearance(DrivenEffect):
    """A second gap in series, in the link before the pinion; the chain needs a lump between the two gaps."""

    name: ClassVar[str] = "gearbox_clearance"
    means: ClassVar[str] = "there is a second gap in series, in the gearbox or a coupling"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("clearance", "m", 0.0, 3e-5, logarithmic=False, low=0.0, high=3e-4),
    )
    own_nuisance: ClassVar[tuple[Parameter, ...]] = (
        Parameter("pinion_rest", "m", 0.0, 3e-5, logarithmic=False, found_again=True),
    )
    shapes: ClassVar[tuple[Mapping[str, float], ...]] = ({"clearance": 1e-5}, {"clearance": 4e-5})

    def traded(self, values: Mapping[str, float]) -> Mapping[str, float]:
        """A model without it takes both gaps for one."""
        out = dict(values)
        for axis in self.axes:
            both = values[f"{axis}.backlash"]
            out[f"{axis}.clearance"] = min(values[f"{axis}.clearance"], 0.5 * both)
            out[f"{axis}.backlash"] = both - out[f"{axis}.clearance"]
        return out

    @property
    def gaps(self) -> int:
        return len(self.axes)

    def begin(self, x0: FloatArray, case: Case, room: Room) -> None:
        """The pinion rests anywhere between the two gaps."""
        for k, _, x in self.each(case.model):
            x0[..., case.model.load(x) - 2] += case.nuisance[..., k]

    def assemble(self, system: LinearSystem, case: Case, room: Room) -> None:
        """The link's spring and damper are taken out and put back as two flanks."""
        model, links = case.model, LINKS[case.model.lumps]
        for k, axis, x in self.each(model):
            body, first, gap = len(links) - 1, x * model.states_per_axis, room.gap + k
            masses = [case.values[f"{axis}.{link}_mass"] for link in links]
            stiffness, damping = spring_damper(case.values, axis, links[body])
            join(system, (body, x, first), masses, (-stiffness, -damping))
            system.k[:, gap], system.d[:, gap] = stiffness, damping
            at, before = first + 2 * body, first + 2 * (body - 1)
            for side, sign in ((0, -1.0), (1, 1.0)):
                approach, push = system.approach[:, gap, side], system.push[:, gap, side]
                approach[:, at] = -sign
                approach[:, before if body else system.n + system.motor(x)] = sign
                approach[:, system.n + system.constant()] = -0.5 * case.values[f"{axis}.clearance"]
                push[:, at + 1] = sign / masses[body]
                if body:
                    push[:, before + 1] = -sign / masses[body - 1]


@dataclass(frozen=True)
class DrivenLocalBacklash(DrivenEffect):
    """A gap whose width changes along the rack; `backlash` is then the width where the recording began."""

    name: ClassVar[str] = "position_dependent_backlash"
    means: ClassVar[str] = "the backlash changes along the travel: local wear, pinion runout"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("gap_slope", "1", 0.0, 0.01, logarithmic=False, low=-0.2, high=0.2, dose=1e-3),
    )

    def assemble(self, system: LinearSystem, case: Case, room: Room) -> None:
        for _, axis, x in self.each(case.model):
            slope = 0.5 * case.values[f"{axis}.gap_slope"]
            system.approach[:, x, :, case.model.load(x)] -= slope[:, None]


@dataclass(frozen=True)
class DrivenBentContact(DrivenEffect):
    """Flanks whose force grows with depth to the power n = 1 + bend (Hertz: 3/2 for a point, 10/9 for a line):
    k·δ·(δ/δ0)^bend, δ0 being the depth under TYPICAL_PUSH, where it is as large as the straight flank's."""

    name: ClassVar[str] = "contact_nonlinearity"
    means: ClassVar[str] = "the tooth contact stiffens with load"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("bend", "1", 0.0, 0.5, logarithmic=False, low=-0.5, high=1.5, dose=0.05),
    )

    @property
    def curves(self) -> int:
        return len(self.axes)

    def assemble(self, system: LinearSystem, case: Case, room: Room) -> None:
        """What the bent flank does more than the straight one, as a curve of the flanks' distance."""
        for _, axis, x in self.each(case.model):
            of = system.approach[:, x, 1].copy()
            of[:, system.n + system.constant()] = 0.0
            half, k = 0.5 * case.values[f"{axis}.backlash"], case.values[f"{axis}.contact_stiffness"]
            typical = TYPICAL_PUSH / k
            reach = half + REACH * typical
            place = np.linspace(-1.0, 1.0, POINTS) * reach[:, None]
            depth = np.maximum(np.abs(place) - half[:, None], 0.0)
            grown = np.maximum(depth / typical[:, None], 1e-12) ** case.values[f"{axis}.bend"][:, None]
            table = np.sign(place) * k[:, None] * depth * (grown - 1.0)
            width = 2.0 * reach / (POINTS - 1)
            system.curves.append(Curve(of, system.push[:, x, 1].copy(), -reach, width, table))


@dataclass(frozen=True)
class DrivenRipple(DrivenEffect):
    """An error of the transmission that repeats along the travel; its phase is found again in every recording."""

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
        for phase in (0.0, 0.5 * np.pi)
    )

    def drive(self, c: FloatArray, case: Case) -> FloatArray:
        """Position, speed and acceleration of the error at the grid points; a polynomial between them."""
        out = c.copy()
        for _, axis, x in self.each(case.model):
            size, phase, period = (
                case.values[f"{axis}.ripple_{p}"][:, None, None] for p in ("amplitude", "phase", "period")
            )
            kappa, points = 2.0 * np.pi / period, grid_points(c[:, :, :, x], case.h)
            angle = kappa * points[..., 0] + phase
            speed = size * kappa * np.cos(angle) * points[..., 1]
            curved = (
                size * kappa * (np.cos(angle) * points[..., 2] - kappa * np.sin(angle) * points[..., 1] ** 2)
            )
            position = size * (np.sin(angle) - np.sin(phase))
            out[:, :, :, x] += between(position, speed, curved, case.h)
        return out


def grid_points(c: FloatArray, h: float) -> FloatArray:
    """Position, speed, acceleration at the K + 1 grid points: c (S, T, K, J) -> (S, T, K + 1, 3)."""
    last, powers = c[:, :, -1:], h ** np.arange(c.shape[-1]) / np.array([1.0, 1.0, 2.0, 6.0, 24.0])
    ends = [last[..., j:] @ powers[: c.shape[-1] - j] for j in range(3)]
    return np.concatenate((c[..., :3], np.stack(ends, axis=-1)), axis=2)
