"""Load acceleration from the measured motor motion, with any of the library's effects: the model that is fitted.

Chain of the paper's eqs. (2)-(7): motor motion (input) - spring - gearbox and pinion (one mass) - dead zone b -
carriage with Coulomb and viscous friction. Everything is per moved mass M of its axis. All moves and all
parameter sets of a Jacobian run as lanes of one pass: every move is a window that starts at rest with the pinion
at its own zero in the gap. Only what swings (body, hung mass) is carried from one window into the next.

Integration is leapfrog at an eighth of a millisecond or finer. A contact that begins or ends within a step counts
for its share of the step, so that the cost is smooth in every parameter although the steps are fixed.

Shapes: K steps of a window, L parameter sets, W windows, A axes; parameters are (L, 1, A), states (L, W, A).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from service.identification.axis_effects import AxisEffect
from service.recording import FloatArray


@dataclass(frozen=True)
class MotorMotion:
    """Motion of the motors at the output on the simulation's grid, window by window.

    Attributes
    ----------
    start : (W,) time of the first step of each window [s]
    position, speed : (K, W, A) [m], [m/s]; position starts at 0 in each window; speeds are half a step earlier,
        as leapfrog integration has them
    travel : (W, A) where each window starts, from the start of the recording [m]
    came_from : (W, A) direction of the move before, 0 before the first: the flank that braked it touches
    h : step [s]
    """

    start: FloatArray
    position: FloatArray
    speed: FloatArray
    travel: FloatArray
    came_from: FloatArray
    h: float


class State:
    """Positions and speeds of all bodies; the load starts ``r`` behind the pinion, both at rest."""

    def __init__(self, r: FloatArray) -> None:
        self.x, self.v = -r, np.zeros_like(r)
        self.xp, self.vp = np.zeros_like(r), np.zeros_like(r)
        self.xb, self.vb = np.zeros_like(r[..., :1]), np.zeros_like(r[..., :1])
        self.xh, self.vh = self.x.copy(), np.zeros_like(r)


def simulate(
    motion: MotorMotion,
    P: Mapping[str, FloatArray],
    effects: Sequence[AxisEffect],
    zeros: FloatArray,
    force: FloatArray | None = None,
) -> FloatArray:
    """Speed of the carriages (K, L, W, A) [m/s] against the ground.

    ``P`` holds (L, 1, A) arrays: backlash [m], contact_stiffness [1/s²], contact_damping [1/s],
    drive_stiffness, drive_damping, drive_mass [1], coulomb [m/s²], viscous [1/s], turnover_speed [m/s], and
    the effects' own. ``zeros`` (L, W, A) is where the pinion stands at the start of each window, in half
    backlashes from the flank that braked the move before. ``force`` (K, L, W, A) is filled with the force on the
    motors [m/s²].
    """
    run = _Run(motion, P, effects)
    r = 0.5 * P["backlash"] * (zeros - motion.came_from)
    if not (run.body or run.hung):
        return run.all_steps(State(r), force)
    first = State(r)
    run.all_steps(first, None)
    second = State(r)
    run.carry_swings(first, second)
    return run.all_steps(second, force)


class _Run:
    """The parameters made ready and the effects sorted by the stage in which they act."""

    def __init__(
        self, motion: MotorMotion, P: Mapping[str, FloatArray], effects: Sequence[AxisEffect]
    ) -> None:
        self.motion, self.P, self.h = motion, P, motion.h
        by_stage: dict[str, list[AxisEffect]] = {}
        for effect in effects:
            by_stage.setdefault(effect.stage, []).append(effect)
        self.motor, self.stretch = by_stage.get("motor", []), by_stage.get("stretch", [])
        self.gap, self.contact = by_stage.get("gap", []), by_stage.get("contact", [])
        self.friction, self.force = by_stage.get("friction", []), by_stage.get("force", [])
        self.body, self.hung = "body" in by_stage, "hung" in by_stage
        self.bridge = "bridge" in by_stage
        self.half = 0.5 * P["backlash"]
        self.drive = np.zeros_like(self.half)
        stable = self.h**2 * (P["drive_stiffness"] + P["contact_stiffness"])
        damper = self.h * (P["drive_damping"] + P["contact_damping"])
        self.mass = np.maximum(P["drive_mass"], stable) + damper
        self.w2, self.rate = {}, {}
        for prefix in [name for name, wanted in (("body", self.body), ("hung", self.hung)) if wanted]:
            w = 2.0 * np.pi * P[f"{prefix}_frequency"]
            self.w2[prefix], self.rate[prefix] = w**2, 2.0 * P[f"{prefix}_damping"] * w

    def all_steps(self, state: State, force: FloatArray | None) -> FloatArray:
        K = len(self.motion.position)
        out = np.empty((K, *state.x.shape))
        for k in range(K):
            out[k] = self.step(state, k)
            if force is not None:
                force[k] = self.drive
        return out

    def carry_swings(self, ended: State, start: State) -> None:
        """Set what swings at the start of each window: what the window before left, swung on freely."""
        length = len(self.motion.position) * self.h
        for window in range(1, len(self.motion.start)):
            gap = float(self.motion.start[window] - self.motion.start[window - 1])
            if self.body:
                frequency, damping = self.body_at_rest()
                x, v = free_swing(start.xb[:, window - 1], start.vb[:, window - 1], frequency, damping, gap)
                y, w = free_swing(
                    ended.xb[:, window - 1], ended.vb[:, window - 1], frequency, damping, gap - length
                )
                start.xb[:, window], start.vb[:, window] = x + y, v + w
            if self.hung:
                frequency, damping = self.P["hung_frequency"][:, 0], self.P["hung_damping"][:, 0]
                before = start.xh[:, window - 1] - start.x[:, window - 1]
                x, v = free_swing(before, start.vh[:, window - 1], frequency, damping, gap)
                away = ended.xh[:, window - 1] - ended.x[:, window - 1]
                y, w = free_swing(away, ended.vh[:, window - 1], frequency, damping, gap - length)
                start.xh[:, window], start.vh[:, window] = start.x[:, window] + x + y, v + w
        if self.body:
            start.x, start.v = start.x + start.xb, start.v + start.vb
        if self.body and self.hung:
            start.xh, start.vh = start.xh + start.xb, start.vh + start.vb

    def body_at_rest(self) -> tuple[FloatArray, FloatArray]:
        """Frequency [Hz] and damping (L, 1) of the body while the carriages stand on it and swing with it."""
        heavier = np.sqrt(1.0 + self.P["body_ratio"][:, 0].sum(axis=-1, keepdims=True))
        return self.P["body_frequency"][:, 0, :1] / heavier, self.P["body_damping"][:, 0, :1] / heavier

    def step(self, s: State, k: int) -> FloatArray:
        """One step; returns the carriages' speed before it."""
        speed = s.v
        xm, vm = self.motor_at(k)
        load, load_speed = (s.x - s.xb, s.v - s.vb) if self.body else (s.x, s.v)
        drive = self.drive = self.drive_force(xm - s.xp, vm - s.vp)
        contact = self.contact_force(s.xp - load, s.vp - load_speed, load)
        drag = self.friction_force(load_speed)
        a = contact - drag
        for effect in self.force:
            a = a + effect.law(self.P, load + self.motion.travel, load_speed)  # type: ignore[misc]
        if self.bridge:
            a = a + self.bridge_force(s)
        if self.hung:
            pull = self.w2["hung"] * (s.xh - s.x) + self.rate["hung"] * (s.vh - s.v)
            a = a + self.P["hung_ratio"] * pull
            s.vh = s.vh - self.h * pull
            s.xh = s.xh + self.h * s.vh
        if self.body:
            push = (self.P["body_ratio"] * (drag - contact)).sum(axis=-1, keepdims=True)
            own = self.w2["body"][..., :1] * s.xb + self.rate["body"][..., :1] * s.vb
            s.vb = s.vb + self.h * (push - own)
            s.xb = s.xb + self.h * s.vb
        s.v = s.v + self.h * a
        s.x = s.x + self.h * s.v
        s.vp = s.vp + self.h * (drive - contact) / self.mass
        s.xp = s.xp + self.h * s.vp
        return speed

    def motor_at(self, k: int) -> tuple[FloatArray, FloatArray]:
        xm, vm = self.motion.position[k], self.motion.speed[k]
        for effect in self.motor:
            xm = xm + effect.law(self.P, self.motion.position[k] + self.motion.travel, vm)  # type: ignore[misc]
        return xm, vm

    def drive_force(self, e: FloatArray, de: FloatArray) -> FloatArray:
        if self.stretch:
            e, share = flank(e, de, 0.5 * self.P["clearance"], self.h)
            de = de * share
        return self.P["drive_stiffness"] * e + self.P["drive_damping"] * de

    def contact_force(self, r: FloatArray, dr: FloatArray, x: FloatArray) -> FloatArray:
        half = self.half
        for effect in self.gap:
            half = half + 0.5 * effect.law(self.P, x + self.motion.travel, dr)  # type: ignore[misc]
        pen, touch = flank(r, dr, half, self.h)
        spring = self.P["contact_stiffness"] * pen
        for effect in self.contact:
            spring = spring * effect.law(self.P, pen, dr)  # type: ignore[misc]
        return spring + self.P["contact_damping"] * dr * touch

    def friction_force(self, v: FloatArray) -> FloatArray:
        sign = np.tanh(v / self.P["turnover_speed"])
        drag = self.P["coulomb"] * sign + self.P["viscous"] * v
        for effect in self.friction:
            drag = drag + effect.law(self.P, v, sign)  # type: ignore[misc]
        return drag

    def bridge_force(self, s: State) -> FloatArray:
        lead = self.motion.travel[:, ::-1] - self.motion.travel
        other, offset = s.x[..., ::-1] + lead, self.P["bridge_offset"] * np.array([1.0, -1.0])
        pull = self.P["bridge_stiffness"] * (other - s.x + offset)
        return np.asarray(pull + self.P["bridge_damping"] * (s.v[..., ::-1] - s.v))


def flank(r: FloatArray, dr: FloatArray, half: FloatArray, h: float) -> tuple[FloatArray, FloatArray]:
    """Dead zone of eqs. (6)-(7) as the mean over a step: penetration [m] and the share of the step in contact.

    Within the step, centred on the present place, the flanks meet or part somewhere on a straight path; so
    neither value jumps when a contact moves from one step into the next.
    """
    beyond = np.abs(r) - half
    path = np.abs(dr) * h + 1e-12
    share = np.minimum(np.maximum(0.5 + beyond / path, 0.0), 1.0)
    depth = np.where(share < 1.0, 0.5 * share**2 * path, beyond)
    return np.sign(r) * depth, share


def free_swing(
    x: FloatArray, v: FloatArray, frequency: FloatArray, damping: FloatArray, duration: float
) -> tuple[FloatArray, FloatArray]:
    """Free swing of a damped oscillator over a time [s]."""
    w0 = 2.0 * np.pi * frequency
    w, decay = w0 * np.sqrt(1.0 - damping**2), damping * w0
    c, s, e = np.cos(w * duration), np.sin(w * duration), np.exp(-decay * duration)
    b = (v + decay * x) / w
    return e * (x * c + b * s), e * ((b * w - decay * x) * c - (x * w + decay * b) * s)
