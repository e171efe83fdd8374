"""Effects between motor and rack on the driven model: gaps, flanks and errors of the transmission."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import ClassVar

import numpy as np

from service.dynamics.driven_effect import HELD_WIDER, Case, DrivenEffect, Room
from service.dynamics.driven_friction import add_corner
from service.dynamics.driven_model import join, spring_damper
from service.dynamics.driven_motion import along, grid_points
from service.dynamics.driven_parameters import LINKS, Parameter, Values
from service.dynamics.driven_propagation import Guide, LinearSystem
from service.recording import FloatArray

TYPICAL_PUSH = 4.0
"""Acceleration at which a bent contact is as stiff as its stiffness says [m/s²]: the middle of a diagnostic step's."""

DEEPEST, GRADED = 2.4, 1.6
"""Depth to which a bent flank is bent, in depths under TYPICAL_PUSH: it is hardly ever pressed deeper; and the power by
which the pieces that it is made of widen with the depth. Chosen: with less the first tenths of a micrometre of a flank
that is hardly bent are missed, with more the middle of one that is bent much."""


def graded(pieces: int) -> tuple[float, ...]:
    """Depths between which a bent flank is straight, in depths under TYPICAL_PUSH."""
    return tuple(DEEPEST * (i / pieces) ** GRADED for i in range(pieces + 1))


BENDS = graded(6)
"""While an effect is searched. A force to the power 2 is missed by 0.05 m/s² RMS, one to the power 1.1 by 0.005."""

FINE = graded(13)
"""For a value. Chosen: a force to the power 2 is missed by 0.011 m/s² RMS, less than a quiet sensor's noise; where more
is missed, the chain and the backlash of such a flank follow it."""


BOTH = 1e-4
"""The two gaps together for which the shapes of a clearance are given [m]."""
LEAST_SHARE = 0.03
"""Share of the two gaps that either has at least, where they are divided anew."""
CREEP = 5e-4
"""Speed below which a pinion creeps in its bearings [m/s], about."""


@dataclass(frozen=True)
class DrivenClearance(DrivenEffect):
    """A second gap in series, in the link before the pinion; the chain needs a lump between the two gaps.

    While both gaps are open, nothing but the friction of its bearings acts on the pinion: `pinion_friction` and
    `pinion_viscous`, per moved mass as all forces are, slow it by some m/s² then, which decides where in its two gaps
    it is met again.
    """

    name: ClassVar[str] = "gearbox_clearance"
    means: ClassVar[str] = "there is a second gap in series, in the gearbox or a coupling"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("clearance", "m", 0.0, 3e-5, logarithmic=False, low=0.0, high=3e-4),
        Parameter("pinion_friction", "m/s²", 0.03, 1.0),
        Parameter("pinion_viscous", "1/s", 0.03, 1.0),
    )
    own_nuisance: ClassVar[tuple[Parameter, ...]] = (
        Parameter("pinion_rest", "m", 0.0, 3e-5, logarithmic=False, found_again=True),
    )
    shapes: ClassVar[tuple[Mapping[str, float], ...]] = tuple(
        {"clearance": share * BOTH} for share in (0.1, 0.25, 0.4, 0.55, 0.7, 0.85)
    )
    many_valleys: ClassVar[bool] = True
    exact: ClassVar[bool] = True
    held: ClassVar[tuple[str, ...]] = ("pinion_friction", "pinion_viscous")
    met: ClassVar[tuple[str, ...]] = (
        "pinion_mass",
        "pinion_stiffness",
        "drive_mass",
        "drive_stiffness",
        *held,
    )
    """What decides, beside the gaps, where in them the pinion is met."""

    def traded(self, values: Mapping[str, float]) -> Mapping[str, float]:
        """A model without it takes both gaps for one, which is split as a shape's are."""
        out = dict(values)
        for axis in self.axes:
            both = values[f"{axis}.backlash"]
            out[f"{axis}.clearance"] = both * values[f"{axis}.clearance"] / BOTH
            out[f"{axis}.backlash"] = both - out[f"{axis}.clearance"]
        return out

    def divided(self, values: Mapping[str, float], share: float) -> Mapping[str, float]:
        """All play of an axis, of which the second gap has such a share."""
        out = dict(values)
        for axis in self.axes:
            both = values[f"{axis}.backlash"] + values.get(f"{axis}.clearance", 0.0)
            out[f"{axis}.clearance"] = share * both
            out[f"{axis}.backlash"] = both - out[f"{axis}.clearance"]
        return out

    def rests(self, values: Mapping[str, float]) -> tuple[Mapping[str, float], ...]:
        """The pinion lies at either side of its gap."""
        half = {f"{axis}.pinion_rest": 0.5 * values[f"{axis}.clearance"] for axis in self.axes}
        return half, {name: -value for name, value in half.items()}

    def varied(
        self, values: Mapping[str, float], wide: float, rng: np.random.Generator
    ) -> Mapping[str, float]:
        """The two gaps otherwise divided, and the pinion otherwise met."""
        out = dict(values)
        for axis in self.axes:
            both = values[f"{axis}.clearance"] + values[f"{axis}.backlash"]
            clearance = values[f"{axis}.clearance"] * np.exp(wide * rng.standard_normal())
            out[f"{axis}.clearance"] = float(
                np.clip(clearance, LEAST_SHARE * both, (1.0 - LEAST_SHARE) * both)
            )
            out[f"{axis}.backlash"] = both - out[f"{axis}.clearance"]
            for name in self.met:
                if f"{axis}.{name}" in out:
                    by = HELD_WIDER * wide if name in self.held else wide
                    out[f"{axis}.{name}"] *= float(np.exp(by * rng.standard_normal()))
        return out

    @property
    def gaps(self) -> int:
        return 2 * len(self.axes)

    def begin(self, x0: FloatArray, case: Case, room: Room) -> None:
        """The pinion rests anywhere between the two gaps, and the load where it is said to rest beside it."""
        for k, _, x in self.each(case.model):
            load = case.model.load(x)
            x0[..., load - 2] += case.nuisance[..., k]
            x0[..., load] += case.nuisance[..., k]

    def assemble(self, system: LinearSystem, case: Case, room: Room) -> None:
        """The link's spring and damper are taken out and put back as two flanks."""
        model, links = case.model, LINKS[case.model.lumps]
        for k, axis, x in self.each(model):
            body, first, gap = len(links) - 1, x * model.states_per_axis, room.gap + 2 * k
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
            system.A[:, at + 1, at + 1] -= case.values[f"{axis}.pinion_viscous"] / masses[body]
            rubs = bearing(system, at + 1, case.values[f"{axis}.pinion_friction"], masses[body])
            add_corner(system, rubs, 1.0, np.full(len(system.A), CREEP), gap + 1)


def bearing(system: LinearSystem, speed: int, level: FloatArray, mass: FloatArray) -> Guide:
    """Coulomb friction `level` (S,) on a mass of the chain, both per moved mass, whose speed is the state `speed`."""
    S, n, U = system.B.shape
    slip, onto = np.zeros(n + U), np.zeros((S, n))
    slip[speed], onto[:, speed] = 1.0, 1.0 / mass
    return Guide(slip, onto, level, level, np.zeros(S), None, np.zeros((S, 0)))


@dataclass(frozen=True)
class DrivenLocalBacklash(DrivenEffect):
    """A gap whose width waves along the rack. `backlash` is then its width where the recording began, `gap_slope` and
    `gap_bow` its first and second derivative there: of a long wave no more is seen than these.

    The width is that at the load's place: half a gap behind the motor on one flank and half a gap before it on the
    other, and as far from there as the chain winds up, by the mean steepness where this flank is pushed.

    Attributes
    ----------
    at_load : the load's place is that of the simulated load, from turn to turn
    """

    at_load: bool = False

    name: ClassVar[str] = "position_dependent_backlash"
    means: ClassVar[str] = "the backlash changes along the travel: local wear, pinion runout"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("gap_slope", "1", 0.0, 0.01, logarithmic=False, low=-0.2, high=0.2, dose=1e-3),
        Parameter("gap_bow", "1/m", 0.0, 5.0, logarithmic=False, dose=0.5),
        Parameter("gap_period", "m", 0.03, 1.0, low=4e-3, high=0.5),
    )
    shapes: ClassVar[tuple[Mapping[str, float], ...]] = tuple({"gap_period": p} for p in (8e-3, 15e-3, 6e-2))

    @property
    def motions(self) -> int:
        return 2 * len(self.axes)

    @property
    def refined(self) -> DrivenLocalBacklash:
        return replace(self, at_load=True)

    @property
    def turns(self) -> int:
        return 1 if self.at_load else 0

    def follow(self, c: FloatArray, case: Case, states: FloatArray | None = None) -> FloatArray:
        """How much wider the gap is than where the recording began, at the load's place on its lower and its upper
        flank."""
        out = np.empty((*c.shape[:3], self.motions, c.shape[-1]))
        for k, axis, x in self.each(case.model):
            points = grid_points(c[:, :, :, x], case.h)
            half = 0.5 * case.values[f"{axis}.backlash"][:, None, None]
            if states is not None:
                load, half = states[..., case.model.load(x) :], np.zeros_like(half)
                points = np.stack((load[..., 0], load[..., 1], points[..., 2]), axis=-1)
            for side, sign in enumerate((1.0, -1.0)):
                wider = self.widening(case.values, axis, points[..., 0] + sign * half)
                out[:, :, :, 2 * k + side] = along(*wider, points, case.h)
        return out

    def wider(self, place: FloatArray, case: Case) -> FloatArray:
        out = np.zeros_like(place)
        for _, axis, x in self.each(case.model):
            out[..., x] = self.widening(case.values, axis, place[..., x])[0]
        return out

    @staticmethod
    def widening(values: Values, axis: str, place: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """How much wider the gap is [m] at places (S, …) [m] than where the recording began, and its first and second
        derivative there."""
        slope, bow, period = (
            values[f"{axis}.gap_{name}"].reshape(-1, *(1,) * (place.ndim - 1))
            for name in ("slope", "bow", "period")
        )
        kappa = 2.0 * np.pi / period
        sine, cosine = np.sin(kappa * place), np.cos(kappa * place)
        return (
            np.asarray(slope / kappa * sine + bow / kappa**2 * (1.0 - cosine)),
            np.asarray(slope * cosine + bow / kappa * sine),
            np.asarray(bow * cosine - slope * kappa * sine),
        )

    def carry(self, system: LinearSystem, case: Case, room: Room) -> None:
        """Before `assemble`: the pieces of a bent contact are as far off as the first."""
        for k, axis, x in self.each(case.model):
            half = 0.5 * case.values[f"{axis}.backlash"]
            for side, sign in enumerate((-1.0, 1.0)):
                approach, steep = system.approach[:, x, side], 0.5 * self.steepness(case, axis, x, sign)
                approach[:, system.n + system.motor(room.motion + 2 * k + side)] -= 0.5
                approach[:, case.model.load(x)] -= steep
                approach[:, system.n + system.motor(x)] += steep
                approach[:, system.n + system.constant()] -= steep * sign * half

    def steepness(self, case: Case, axis: str, x: int, sign: float) -> FloatArray:
        """How much wider the gap gets along the rack (S,) where a flank pushes the load in the direction `sign`: the
        mean over all moves, by the motor's acceleration; 0 where the width is looked up at the load itself."""
        if case.c is None or self.at_load:
            return np.zeros(len(case.nuisance))
        place, push = case.c[:, :, :, x, 0], np.maximum(sign * case.c[:, :, :, x, 2], 0.0)
        half = 0.5 * case.values[f"{axis}.backlash"][:, None, None]
        steep = self.widening(case.values, axis, place - sign * half)[1]
        return np.asarray(np.sum(steep * push, axis=(1, 2)) / np.maximum(np.sum(push, axis=(1, 2)), 1e-300))


@dataclass(frozen=True)
class DrivenPreload(DrivenEffect):
    """A spring that holds the load in the middle of the gap: a split pinion, or one that is pressed into the rack. It
    acts between the flanks as well as in contact, where it is a small part of the contact's stiffness. What brakes the
    load between them and hardly pulls, a film of grease, is no spring: its damping ratio would be one and more."""

    name: ClassVar[str] = "preload_flank"
    means: ClassVar[str] = "a spring holds the flanks apart: a split or sprung pinion against backlash"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("preload_stiffness", "1/s²", 0.0, 2e4, logarithmic=False, low=0.0, dose=1e3),
        Parameter("preload_damping_ratio", "1", 0.02, 0.8, high=0.5),
    )
    inside: ClassVar[tuple[str, ...]] = ("preload_damping_ratio",)

    def assemble(self, system: LinearSystem, case: Case, room: Room) -> None:
        model = case.model
        for _, axis, x in self.each(model):
            k = case.values[f"{axis}.preload_stiffness"]
            d = 2.0 * case.values[f"{axis}.preload_damping_ratio"] * np.sqrt(k)
            load, pinion = model.load(x), model.pinion(x)
            for part, size in enumerate((k, d)):
                system.A[:, load + 1, load + part] -= size
                if pinion is None:
                    system.B[:, load + 1, system.motor(x, part)] += size
                else:
                    mass = case.values[f"{axis}.{LINKS[model.lumps][-1]}_mass"]
                    system.A[:, load + 1, pinion + part] += size
                    system.A[:, pinion + 1, load + part] += size / mass
                    system.A[:, pinion + 1, pinion + part] -= size / mass


@dataclass(frozen=True)
class DrivenBentContact(DrivenEffect):
    """Flanks whose force grows with depth to the power n = 1 + bend (Hertz: 3/2 for a point, 10/9 for a line):
    k·δ·(δ/δ0)^bend, δ0 being the depth under TYPICAL_PUSH, where it is as large as the straight flank's.

    The law is a chain of straight pieces, each a flank of its own that is met a little deeper than the one before: so
    the propagation stays exact between events. A force that is looked up at the grid points only misses the first
    tenths of a micrometre, where the bend is greatest and the backlash is decided. The pieces part together, where the
    flank as a whole would pull: a piece that let go by itself would damp a strongly damped flank less on its way out.

    Attributes
    ----------
    bends : depths between which the flank is straight
    own_damper : the damper grows with the depth to a power of its own, `damping_bend`: not at all (Kelvin, Voigt), with
        the stiffness, or with the force (Hunt, Crossley 1975); a search takes it to be as large, at every depth, as the
        force over the depth
    """

    bends: tuple[float, ...] = BENDS
    own_damper: bool = False

    name: ClassVar[str] = "contact_nonlinearity"
    means: ClassVar[str] = "the tooth contact stiffens with load"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("bend", "1", 0.0, 0.5, logarithmic=False, low=-0.5, high=1.5, dose=0.05),
    )
    damper: ClassVar[Parameter] = Parameter(
        "damping_bend", "1", 0.5, 0.5, logarithmic=False, low=0.0, high=2.5
    )

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        more = self.axes if self.own_damper else ()
        return (*super().parameters, *(self.damper.of(axis) for axis in more))

    @property
    def refined(self) -> DrivenBentContact:
        return replace(self, bends=FINE, own_damper=True)

    @property
    def gaps(self) -> int:
        return len(self.axes) * (len(self.bends) - 2)

    def assemble(self, system: LinearSystem, case: Case, room: Room) -> None:
        """The first piece takes the straight flank's place, the others are added."""
        end = system.n + system.constant()
        for at, axis, x in self.each(case.model):
            more = room.gap + (at * (len(self.bends) - 2) + np.arange(len(self.bends) - 2))
            k, d = system.k[:, x].copy(), system.d[:, x].copy()
            bend = case.values[f"{axis}.bend"]
            damped_bend = case.values.get(f"{axis}.damping_bend", bend)
            added = stiffening(bend, self.bends).T, damping(damped_bend, self.bends).T
            laws = zip((x, *more), (-1, x, *more), self.bends, *added, strict=False)
            for gap, before, begin, stiffer, damped in laws:
                system.approach[:, gap], system.push[:, gap] = system.approach[:, x], system.push[:, x]
                system.approach[:, gap, :, end] -= (begin * TYPICAL_PUSH / k)[:, None]
                system.k[:, gap], system.d[:, gap], system.behind[gap] = stiffer * k, damped * d, before


def stiffening(bend: FloatArray, bends: Sequence[float] = BENDS) -> FloatArray:
    """What every piece adds to the stiffness (S, len(bends) − 1), by least squares on the curve x^(1 + bend)."""
    x, solved = least_squares(tuple(bends))
    return np.asarray(x ** (1.0 + bend[:, None]) @ solved.T)


@cache
def least_squares(bends: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Depths (200,), and what makes the pieces' stiffnesses of a curve at them (len(bends) − 1, 200)."""
    x = np.linspace(0.0, bends[-1], 200)
    return x, np.linalg.pinv(np.maximum(x[:, None] - np.array(bends[:-1]), 0.0))


def damping(bend: FloatArray, bends: Sequence[float] = BENDS) -> FloatArray:
    """What every piece adds to the damping (S, len(bends) − 1): each depth is damped in proportion to x^bend."""
    power, edges = 1.0 + bend[:, None], np.array(bends)
    mean = np.diff(edges**power, axis=1) / (power * np.diff(edges))
    return np.diff(mean, axis=1, prepend=0.0)
