"""What a machine may do beyond the paper's chain: one small class per cause, idle where its parameter is neutral.

A term acts at three moments of a step: `between` alters the distances and their rates before the springs see them,
`transmit` alters the three internal forces, `push` alters the net force on the bodies. SI, referred to the output.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from tests.undeclared.machine import Plant

Array = NDArray[np.floating[Any]]

MOTOR, GEAR, PINION, CARRIAGE, BASE, HUNG = range(6)

NEUTRAL = {"n_contact": 1.0, "depth_contact": 1e-5, "v_stribeck": 1.0, "wave_gap": 1.0, "wave_ripple": 1.0}
NEUTRAL |= {"tau_cold": 1.0, "wave_uneven": 1.0, "hz_bump": 1.0}
NEUTRAL |= {"wave_cogging": 1.0, "z_dahl": 1.0, "p_curved": 1.0}
"""Parameters whose neutral value is not zero."""


def rows(p: Mapping[str, Array], names: Sequence[str], bodies: int) -> Array:
    """Return parameters as rows (bodies, lanes), zero for bodies without a name."""
    zero = np.zeros_like(p["m_load"])
    return np.stack([p[name] for name in names] + [zero] * (bodies - len(names)))


def masses(p: Mapping[str, Array], bodies: int) -> Array:
    """Return the masses [kg] (bodies, lanes); an absent body gets 1 kg and never moves."""
    all_rows = rows(p, ("m_motor", "m_gear", "m_pinion", "m_load", "m_base", "m_hung"), 6)
    return np.where(all_rows > 0, all_rows, 1.0)[:bodies]


def flank_force(s: Array, r: Array, half: Array, k: Array, d: Array, h: float) -> Array:
    """Return the force of a dead zone of half width `half` [m], damped in contact only and never pulling."""
    depth = np.abs(s) - half
    touched = np.clip(0.5 + depth / (np.abs(r) * h + 1e-15), 0.0, 1.0)
    force = k * np.maximum(depth, 0.0) + d * touched * r * np.sign(s)
    return np.sign(s) * np.maximum(force, 0.0)


class Term:
    """A cause that does nothing at any moment; `needs` names the parameter that wakes it."""

    needs = ""
    bodies = 4

    def __init__(self, p: Mapping[str, Array]) -> None:
        self.p = p

    def between(self, plant: Plant, s: Array, r: Array) -> None:
        """Alter distances `s` and rates `r` (3, lanes) before the springs."""

    def transmit(self, plant: Plant, s: Array, r: Array, f: Array) -> None:
        """Alter the internal forces `f` (3, lanes)."""

    def push(self, plant: Plant, net: Array) -> None:
        """Alter the net forces (bodies, lanes)."""


class Base(Term):
    """The machine body on its feet: it carries the rack, takes the reaction, and friction rubs against it."""

    needs = "m_base"
    bodies = 5

    def __init__(self, p: Mapping[str, Array]) -> None:
        super().__init__(p)
        self.on = np.where(p["m_base"] > 0, 1.0, 0.0)

    def between(self, plant: Plant, s: Array, r: Array) -> None:
        s[2] += plant.x[BASE]
        r[2] += plant.vp[BASE]

    def push(self, plant: Plant, net: Array) -> None:
        rub = plant.rubbing
        net[BASE] += self.on * (rub - plant.load[2])
        net[BASE] -= self.p["k_base"] * plant.x[BASE] + self.p["d_base"] * plant.vp[BASE]


class Hung(Term):
    """A mass that hangs elastically on the carriage (cabinet, hose package, cutting head)."""

    needs = "m_hung"
    bodies = 6

    def push(self, plant: Plant, net: Array) -> None:
        x, v = plant.x, plant.vp
        pull = self.p["k_hung"] * (x[CARRIAGE] - x[HUNG]) + self.p["d_hung"] * (v[CARRIAGE] - v[HUNG])
        net[HUNG] += pull
        net[CARRIAGE] -= pull


class Stribeck(Term):
    """Extra friction near standstill, fading as 1/(1 + (v/v_s)²)."""

    needs = "f_stribeck"

    def push(self, plant: Plant, net: Array) -> None:
        v = plant.slip
        extra = self.p["f_stribeck"] / (1 + (v / self.p["v_stribeck"]) ** 2)
        net[CARRIAGE] -= extra * plant.direction


class Asymmetric(Term):
    """Friction that is (1 + a) as large forwards and (1 - a) backwards."""

    needs = "a_friction"

    def push(self, plant: Plant, net: Array) -> None:
        p, d = self.p, plant.direction
        net[CARRIAGE] -= p["a_friction"] * (p["fc"] + p["fv"] * np.abs(plant.slip)) * d * d


class Curved(Term):
    """Friction that grows with a power of the speed; `f_curved` [N] is its size at 0.1 m/s."""

    needs = "f_curved"

    def push(self, plant: Plant, net: Array) -> None:
        v = plant.slip
        net[CARRIAGE] -= self.p["f_curved"] * plant.direction * np.abs(v / 0.1) ** self.p["p_curved"]


class Constant(Term):
    """Gravity on a tilted axis."""

    needs = "grav"

    def push(self, plant: Plant, net: Array) -> None:
        net[CARRIAGE] += self.p["grav"]


class Chain(Term):
    """A cable chain or spring: force falls linearly with the position."""

    needs = "k_chain"

    def push(self, plant: Plant, net: Array) -> None:
        net[CARRIAGE] -= self.p["k_chain"] * (plant.x[CARRIAGE] - self.p["x_chain"])


class Clearance(Term):
    """A second gap, between gearbox and pinion."""

    needs = "clearance"

    def transmit(self, plant: Plant, s: Array, r: Array, f: Array) -> None:
        p = self.p
        gap = flank_force(s[1], r[1], p["clearance"] / 2, p["k_shaft"], p["d_shaft"], plant.h)
        f[1] = np.where(p["clearance"] > 0, gap, f[1])


class WornRack(Term):
    """A gap whose width waves along the rack; `gap_wave` [m] is the amplitude of the width."""

    needs = "gap_wave"

    def between(self, plant: Plant, s: Array, r: Array) -> None:
        p = self.p
        wave = np.sin(2 * np.pi * plant.x[CARRIAGE] / p["wave_gap"] + p["phase_gap"])
        plant.half = 0.5 * (p["backlash"] + p["gap_wave"] * wave)


class PowerLaw(Term):
    """Flanks whose force grows as depth to the power n; equal to the linear flank at `depth_contact`."""

    needs = "n_contact"

    def transmit(self, plant: Plant, s: Array, r: Array, f: Array) -> None:
        p = self.p
        depth = np.maximum(np.abs(s[2]) - plant.half, 0.0)
        factor = (depth / p["depth_contact"]) ** (p["n_contact"] - 1)
        bent = flank_force(
            s[2], r[2], plant.half, p["kp"] * factor, p["dp"] * np.minimum(factor, 1.0), plant.h
        )
        f[2] = np.where(p["n_contact"] == 1.0, f[2], bent)


class Ripple(Term):
    """Kinematic error of the mesh, locked to the pinion's position."""

    needs = "ripple"

    def between(self, plant: Plant, s: Array, r: Array) -> None:
        p = self.p
        kappa = 2 * np.pi / p["wave_ripple"]
        angle = kappa * plant.x[PINION] + p["phase_ripple"]
        s[2] += p["ripple"] * (np.sin(angle) - np.sin(p["phase_ripple"]))
        r[2] += p["ripple"] * kappa * np.cos(angle) * plant.vp[PINION]


class Cogging(Term):
    """Torque ripple of the motor, locked to its position."""

    needs = "cogging"

    def push(self, plant: Plant, net: Array) -> None:
        p = self.p
        net[MOTOR] += p["cogging"] * np.sin(
            2 * np.pi * plant.x[MOTOR] / p["wave_cogging"] + p["phase_cogging"]
        )


class Slip(Term):
    """A friction wheel in the gearbox: it creeps at a speed proportional to the force."""

    needs = "creep"

    def __init__(self, p: Mapping[str, Array]) -> None:
        super().__init__(p)
        self.crept = np.zeros_like(p["creep"])

    def between(self, plant: Plant, s: Array, r: Array) -> None:
        s[1] -= self.crept

    def transmit(self, plant: Plant, s: Array, r: Array, f: Array) -> None:
        self.crept += plant.h * self.p["creep"] * f[1]


class Preload(Term):
    """A sprung counter-flank: inside the gap it holds the carriage with a soft spring instead of letting go."""

    needs = "k_preload"

    def transmit(self, plant: Plant, s: Array, r: Array, f: Array) -> None:
        inside = np.clip(s[2], -plant.half, plant.half)
        f[2] += self.p["k_preload"] * inside + self.p["d_preload"] * r[2] * (np.abs(s[2]) < plant.half)


class LoadChange(Term):
    """A workpiece is put on or taken off during a rest: the mass changes by `mass_change` [kg] at `t_change` [s]."""

    needs = "mass_change"

    def push(self, plant: Plant, net: Array) -> None:
        p = self.p
        plant.mass[CARRIAGE] = p["m_load"] + np.where(plant.time > p["t_change"], p["mass_change"], 0.0)


class Neighbour(Term):
    """A neighbouring machine shakes the carriage at one frequency, tied to nothing here."""

    needs = "f_shake"

    def push(self, plant: Plant, net: Array) -> None:
        p = self.p
        net[CARRIAGE] += p["f_shake"] * np.sin(2 * np.pi * p["hz_shake"] * plant.time + p["phase_shake"])


class Dahl(Term):
    """Friction of bristles that bend over the presliding stroke `z_dahl` [m] first (Dahl, with LuGre's damping)."""

    needs = "f_dahl"

    def __init__(self, p: Mapping[str, Array]) -> None:
        super().__init__(p)
        self.bent = np.zeros_like(p["f_dahl"])
        self.damp = 0.6 * np.sqrt(p["f_dahl"] / p["z_dahl"] * p["m_load"])

    def push(self, plant: Plant, net: Array) -> None:
        p, v = self.p, plant.slip
        rate = v - np.abs(v) * self.bent / p["z_dahl"]
        net[CARRIAGE] -= p["f_dahl"] * self.bent / p["z_dahl"] + self.damp * rate
        self.bent = self.bent + plant.h * rate


class Cold(Term):
    """Coulomb friction on top that fades with time."""

    needs = "fc_cold"

    def push(self, plant: Plant, net: Array) -> None:
        net[CARRIAGE] -= self.p["fc_cold"] * np.exp(-plant.time / self.p["tau_cold"]) * plant.direction


class Film(Term):
    """A viscous film between the flanks."""

    needs = "d_film"

    def transmit(self, plant: Plant, s: Array, r: Array, f: Array) -> None:
        f[2] += self.p["d_film"] * r[2] * (np.abs(s[2]) < plant.half)


class SlipElement(Term):
    """Jenkin's element beside the shaft: a spring that slips at `f_slip`."""

    needs = "k_slip"

    def __init__(self, p: Mapping[str, Array]) -> None:
        super().__init__(p)
        self.rest = np.zeros_like(p["k_slip"])

    def transmit(self, plant: Plant, s: Array, r: Array, f: Array) -> None:
        p = self.p
        reach = p["f_slip"] / np.maximum(p["k_slip"], 1.0)
        self.rest = np.clip(self.rest, s[1] - reach, s[1] + reach)
        f[1] += p["k_slip"] * (s[1] - self.rest)


class Bumps(Term):
    """Half-sine blows of 3 ms, at moments that never repeat alike."""

    needs = "f_bump"

    def push(self, plant: Plant, net: Array) -> None:
        p = self.p
        since = np.mod(plant.time + 0.03 * np.sin(5.1 * plant.time + p["phase_bump"]), 1.0 / p["hz_bump"])
        net[CARRIAGE] += p["f_bump"] * np.where(since < 3e-3, np.sin(np.pi * since / 3e-3), 0.0)


class Uneven(Term):
    """Coulomb friction that waves along the guide."""

    needs = "f_uneven"

    def push(self, plant: Plant, net: Array) -> None:
        p = self.p
        wave = np.sin(2 * np.pi * plant.x[CARRIAGE] / p["wave_uneven"] + p["phase_uneven"])
        net[CARRIAGE] -= p["f_uneven"] * wave * plant.direction


TERMS: tuple[type[Term], ...] = (
    *(
        Base,
        Hung,
        Stribeck,
        Asymmetric,
        Curved,
        Constant,
        Chain,
        Clearance,
        WornRack,
        Ripple,
        PowerLaw,
        Cogging,
    ),
    *(Slip, Preload, LoadChange, Neighbour, Dahl, Cold, Film, SlipElement, Bumps, Uneven),
)


def active(p: Mapping[str, Array]) -> list[Term]:
    """Return the terms that some lane wakes."""
    return [t(p) for t in TERMS if np.any(p[t.needs] != NEUTRAL.get(t.needs, 0.0))]


def body_count(terms: Sequence[Term]) -> int:
    """Return how many bodies the chain needs with these terms."""
    return max([4, *(t.bodies for t in terms)])
