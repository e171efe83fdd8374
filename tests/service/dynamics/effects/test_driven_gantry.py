"""Both axes of a gantry with bent contacts, which have many contact states together, against a general integrator."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from service.dynamics import driven_propagation
from service.dynamics.driven import simulate
from service.dynamics.driven_model import Model
from service.dynamics.driven_motion import coefficients, plain_motion
from service.dynamics.effects.driven_transmission import (
    BENDS,
    TYPICAL_PUSH,
    DrivenBentContact,
    damping,
    stiffening,
)
from service.recording import FloatArray, Trace

H, K = 2.5e-4, 340
AXES = ("X1", "X2")
TIME = np.arange(-0.02, 0.12, 1e-3)
SPEEDS = [0.1 * np.sin(np.pi * np.clip(TIME - late, 0.0, 0.085) / 0.085) ** 2 for late in (0.0, 0.0004)]
COURSES = [plain_motion(Trace(TIME, speed), 1.0) for speed in SPEEDS]
MODEL = Model(AXES, 1, (DrivenBentContact(AXES),))
GIVEN = {p.name: p.typical for p in MODEL.parameters} | {
    "X1.backlash": 60e-6,
    "X2.backlash": 35e-6,
    "X1.bend": 0.15,
    "X2.bend": 0.08,
    "X2.contact_stiffness": 2.5e5,
    "bridge_offset": 2e-5,
    "mass_ratio": 1.2,
}
STARTS = (-20e-6, -10e-6)


def driven() -> FloatArray:
    """(2, K) the loads' mean accelerations by the model, the axes being pushed in positive travel."""
    c = np.stack([coefficients(course, 0.0, H, K) for course in COURSES], axis=1)[None, None]
    load = np.array([[c[0, 0, 0, x, 0] + at, 0.0] for x, at in enumerate(STARTS)])[None, None]
    v = {name: np.array([value]) for name, value in GIVEN.items()}
    return simulate(MODEL, v, c, np.ones(1), load, H).acceleration[0, 0]


def law(axis: str, link: str) -> tuple[float, float]:
    k = GIVEN[f"{axis}.{link}_stiffness"]
    return k, 2.0 * GIVEN[f"{axis}.{link}_damping_ratio"] * float(np.sqrt(k))


def contact(axis: str, s: float, r: float) -> float:
    """The force of the pieces of a bent flank that are reached, as long as they push together."""
    (k, d), bend, total = law(axis, "contact"), np.array([GIVEN[f"{axis}.bend"]]), 0.0
    for begin, stiff, damped in zip(BENDS, stiffening(bend)[0], damping(bend)[0], strict=False):
        deep = abs(s) - 0.5 * GIVEN[f"{axis}.backlash"] - begin * TYPICAL_PUSH / k
        if deep > 0.0:
            total += stiff * k * deep + damped * d * r * float(np.sign(s))
    return max(total, 0.0) * float(np.sign(s))


def rates(t: float, z: FloatArray) -> list[float]:
    """The machine, one force after the other: pinion and load of the first axis, then of the second."""
    out: list[float] = []
    bridge = GIVEN["bridge_stiffness"] * (z[6] - z[2] + GIVEN["bridge_offset"])
    bridge += GIVEN["bridge_damping"] * (z[7] - z[3])
    for x, (axis, pull) in enumerate(zip(AXES, (bridge, -bridge / GIVEN["mass_ratio"]), strict=True)):
        xp, vp, xl, vl = z[4 * x : 4 * x + 4]
        k, d = law(axis, "drive")
        push = k * (float(COURSES[x](t)) - xp) + d * (float(COURSES[x](t, 1)) - vp)
        pressed = contact(axis, xp - xl, vp - vl)
        a = pressed - GIVEN[f"{axis}.coulomb"] - GIVEN[f"{axis}.viscous"] * vl + pull
        out += [vp, (push - pressed) / GIVEN[f"{axis}.drive_mass"], vl, a]
    return out


def integrated() -> FloatArray:
    """(2, K) the same by a general integrator."""
    z = np.concatenate(
        [[float(c(0.0)), 0.0, float(c(0.0)) + at, 0.0] for c, at in zip(COURSES, STARTS, strict=True)]
    )
    grid = H * np.arange(K + 1)
    found = solve_ivp(rates, (0.0, grid[-1]), z, t_eval=grid, max_step=4e-5, rtol=1e-8, atol=1e-12).y
    return np.diff(found[[3, 7]], axis=1) / H


def test_agrees_with_a_general_integrator() -> None:
    ours, theirs = driven(), integrated()
    assert np.abs(theirs).max() > 3.0
    assert np.sqrt(np.mean((ours - theirs) ** 2)) < 1e-3


def test_what_is_forgotten_is_found_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """With room for three contact states only, the same comes out."""
    whole = driven()
    monkeypatch.setattr(driven_propagation, "KNOWN", 3)
    assert driven() == pytest.approx(whole, rel=0.0, abs=1e-12)
