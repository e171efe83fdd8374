"""A mechanism between two events is a linear system; one such system is a mode, and is propagated exactly.

The mode says for each contact whether the gap is open (0) or on which flank it lies (+1 upper, −1 lower),
and for each sliding whether it sticks (0) or in which direction it slides (±1). The state w holds::

    q, q̇ (n)   T, T_cmd (drives)   F (n)   up, down (slidings)   UL, LL (contacts)

T is the motors' torque, which follows the held command T_cmd with the current loop's lag; F are forces, up
and down the Coulomb levels for sliding in the positive and the negative direction. All but q, q̇ and T are
held over a sub-step. So dw/dt = A w, and w(t + τ) = exp(A τ) w(t).

The gauge is a second matrix: the mode holds as long as no entry of gauge·w is negative.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from scipy.linalg import expm

from service.dynamics.forces import Contact
from service.dynamics.mechanism import FloatArray, Mechanism

HALVINGS = 14
"""An event is located to dt/2¹⁴ (8 ns of 0.125 ms), chosen: at 20 mm/s that is 0.15 nm of travel."""

_FORCE_SCALE = 1e-5  # brings newtons beside metres and metres per second, so that one tolerance serves all


class Key(NamedTuple):
    """Names a mode: state of each contact and of each sliding, −1, 0 or +1."""

    contacts: tuple[int, ...]
    slidings: tuple[int, ...]


class Condition(NamedTuple):
    """What a negative gauge row means: contact or sliding ``part`` wants to go to ``state``; "stop" asks."""

    kind: Literal["contact", "slide", "stop"]
    part: int
    state: int


class Layout:
    """Where the parts of w stand."""

    def __init__(self, m: Mechanism) -> None:
        n, drives, slidings, contacts = len(m.bodies), len(m.drives), len(m.slidings), len(m.contacts)
        sizes = (n, n, drives, drives, n, slidings, slidings, contacts, contacts)
        ends = np.cumsum(sizes)
        parts = [slice(int(e - s), int(e)) for s, e in zip(sizes, ends, strict=True)]
        self.q, self.v, self.T, self.command, self.F, self.up, self.down, self.UL, self.LL = parts
        self.size = int(ends[-1])


@dataclass(frozen=True)
class Mode:
    """One linear system and its validity.

    Attributes
    ----------
    propagators : (HALVINGS + 1, N, N), of dt, dt/2, …, dt/2^HALVINGS
    gauge : (m, N), the mode holds while gauge·w >= 0, but see ``open_gaps``
    conditions : (m,), what it means when a row is negative
    open_gaps : for each open flank the rows of its two gauges; the gap closes only when both are negative
    acceleration : (n, N), q̈ = acceleration·w
    stick : (n, n), takes from q̇ what a sticking sliding does not allow
    """

    propagators: FloatArray
    gauge: FloatArray
    conditions: tuple[Condition, ...]
    open_gaps: tuple[tuple[int, int], ...]
    acceleration: FloatArray
    stick: FloatArray


def build_mode(m: Mechanism, layout: Layout, key: Key, dt: float) -> Mode:
    """Return the mode ``key`` of the mechanism for sub-steps of ``dt`` [s]."""
    force = _forces(m, layout, key)
    R = np.array([s.row for s, state in zip(m.slidings, key.slidings, strict=True) if state == 0])
    R = R.reshape(-1, len(m.bodies))
    mobility = np.linalg.inv(R / m.M @ R.T)
    friction = -mobility @ (R / m.M) @ force
    acceleration = (force + R.T @ friction) / m.M[:, None]
    gauge, conditions, open_gaps = _gauge(m, layout, key, friction)
    stick = np.eye(len(m.bodies)) - (R.T @ mobility @ R) / m.M[:, None]
    propagators = _propagators(_system(m, layout, acceleration), layout, dt, float(m.M.min()))
    return Mode(propagators, gauge, conditions, open_gaps, acceleration, stick)


def _forces(m: Mechanism, layout: Layout, key: Key) -> FloatArray:
    """(n, N): the force on each body by w, all but that of sticking friction."""
    force = np.zeros((len(m.bodies), layout.size))
    force[:, layout.q], force[:, layout.v] = -m.K, -m.D
    force[:, layout.F] = np.eye(len(m.bodies))
    for k, drive in enumerate(m.drives):
        force[m.index(drive.body), layout.T.start + k] = 1 / drive.transmission
    for k, (contact, state) in enumerate(zip(m.contacts, key.contacts, strict=True)):
        if state:
            force -= np.outer(contact.row, _flank_force(contact, layout, k, state))
    for k, (sliding, state) in enumerate(zip(m.slidings, key.slidings, strict=True)):
        force[:, layout.v] -= sliding.viscous * np.outer(sliding.row, sliding.row)
        if state:
            level = (layout.up if state > 0 else layout.down).start + k
            force[:, level] -= state * sliding.row
    return force


def _flank_force(contact: Contact, layout: Layout, k: int, flank: int) -> FloatArray:
    """(N,): F_p,compl of eq. (5) by w, on the upper (+1) or lower (−1) flank."""
    row = np.zeros(layout.size)
    row[layout.q], row[layout.v] = contact.k * contact.row, contact.d * contact.row
    row[(layout.UL if flank > 0 else layout.LL).start + k] = -contact.k
    return row


def _gauge(
    m: Mechanism, layout: Layout, key: Key, friction: FloatArray
) -> tuple[FloatArray, tuple[Condition, ...], tuple[tuple[int, int], ...]]:
    rows: list[FloatArray] = []
    conditions: list[Condition] = []
    open_gaps: list[tuple[int, int]] = []
    for k, (contact, state) in enumerate(zip(m.contacts, key.contacts, strict=True)):
        for flank in (state,) if state else (1, -1):
            push = flank * _flank_force(contact, layout, k, flank)
            if state:
                rows.append(push * _FORCE_SCALE)
                conditions.append(Condition("contact", k, 0))
                continue
            clearance = np.zeros(layout.size)
            clearance[layout.q] = -flank * contact.row
            clearance[(layout.UL if flank > 0 else layout.LL).start + k] = flank
            open_gaps.append((len(rows), len(rows) + 1))
            rows += [clearance, -push * _FORCE_SCALE]
            conditions += [Condition("contact", k, flank)] * 2
    for row, condition in _friction_gauge(m, layout, key, friction):
        rows.append(row)
        conditions.append(condition)
    return np.array(rows).reshape(-1, layout.size), tuple(conditions), tuple(open_gaps)


def _friction_gauge(
    m: Mechanism, layout: Layout, key: Key, friction: FloatArray
) -> list[tuple[FloatArray, Condition]]:
    """A sliding stops when its speed turns; a sticking one starts when its level no longer holds it."""
    found: list[tuple[FloatArray, Condition]] = []
    sticking = iter(friction)
    for k, (sliding, state) in enumerate(zip(m.slidings, key.slidings, strict=True)):
        if state:
            row = np.zeros(layout.size)
            row[layout.v] = state * sliding.row
            found.append((row, Condition("stop", k, 0)))
            continue
        needed = next(sticking)
        for direction, part in ((1, layout.up), (-1, layout.down)):
            row = direction * needed
            row[part.start + k] += 1.0
            found.append((row * _FORCE_SCALE, Condition("slide", k, direction)))
    return found


def _system(m: Mechanism, layout: Layout, acceleration: FloatArray) -> FloatArray:
    """A of dw/dt = A w."""
    A = np.zeros((layout.size, layout.size))
    A[layout.q, layout.v] = np.eye(len(m.bodies))
    A[layout.v] = acceleration
    for k, drive in enumerate(m.drives):
        A[layout.T.start + k, layout.T.start + k] = -1 / drive.current_loop_time
        A[layout.T.start + k, layout.command.start + k] = 1 / drive.current_loop_time
    return A


def _propagators(A: FloatArray, layout: Layout, dt: float, mass: float) -> FloatArray:
    """exp(A dt/2^k), k = 0 … HALVINGS; inside all is counted in metres per dt, which balances the matrix."""
    scale = np.ones(layout.size)
    scale[layout.v] = dt
    scale[layout.F] = scale[layout.up] = scale[layout.down] = dt**2 / mass
    balanced = A * dt * scale[:, None] / scale
    steps = balanced[None] * 0.5 ** np.arange(HALVINGS + 1)[:, None, None]
    propagators: FloatArray = expm(steps) / scale[:, None] * scale
    return propagators
