"""A piecewise linear system that is driven by measured motion: its matrices, and what the compiled pass is given.

Within one contact state the machine is linear, and the motor's measured motion is a polynomial in each grid
interval, so that a whole interval is one product with a matrix exponential. Only the intervals in which a flank
meets or parts are looked at more closely (``driven_kernel``). Nothing depends on a step size, so that the result
is smooth in every parameter.

A flank is a one-sided spring and damper: its force k·δ + d·δ̇, never a pull, acts where its approach δ, a linear
form of states and inputs, is positive.

Shapes
------
S : parameter sets, T : steps, K : grid intervals of length h, n : states, X : input motions, the motors' first,
G : gaps with two flanks each,
J = 5 : derivatives of x_mot in one interval, x_mot(t) = Σ c_j t^j / j!,
C : step constants (1, direction s, then what effects add), Q : forces given as curves,
U = X·J + C + 2·Q inputs: the motors' c_j, the constants, the curves' values, the curves' rates.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.dynamics.driven_exponential import ORDER, J, halvings
from service.dynamics.driven_kernel import HOPELESS, Arrays, propagate
from service.dynamics.work import count
from service.recording import FloatArray

CONSTANTS = 2
"""1 and the direction of the step."""


@dataclass(frozen=True)
class Curve:
    """A force that is no linear function of the state: it follows a curve of one linear form of it.

    Attributes
    ----------
    of : (S, n + U) the linear form, e.g. the load's speed
    onto : (S, n) what a unit of the force adds to the states' rates
    first, width : (S,) where the table begins and its spacing, in the form's unit; beyond its ends it is held
    table : (S, P) values
    """

    of: FloatArray
    onto: FloatArray
    first: FloatArray
    width: FloatArray
    table: FloatArray


@dataclass
class Guide:
    """Friction of one axis' guide per moved mass; effects add to it in place.

    Attributes
    ----------
    slip : (n + U,) the sliding speed as a linear form
    onto : (S, n) what a unit of force on the carriage adds to the states' rates
    forward, backward : (S,) Coulomb level in positive and in negative travel [m/s²]
    viscous : (S,) [1/s]
    turnover : speed around which the Coulomb force turns over [m/s], and how many times faster each of its corners is
        than the one before, (S,) each; None: the axis is always moving
    table : (S, P) further friction [m/s²], against positive travel, at driven_friction.speeds()
    """

    slip: FloatArray
    onto: FloatArray
    forward: FloatArray
    backward: FloatArray
    viscous: FloatArray
    turnover: tuple[FloatArray, FloatArray] | None
    table: FloatArray


@dataclass
class LinearSystem:
    """One machine per parameter set; effects add to the arrays in place.

    Attributes
    ----------
    motions : X
    A : (S, n, n) without contact
    B : (S, n, U) on the inputs
    approach : (S, G, 2, n + U) how far the lower and the upper flank of each gap are pressed together [m]; a form
        of positions only, or of anything if the flank has no damper
    push : (S, G, 2, n) what a unit of the flank's force adds to the states' rates
    k, d : (S, G) contact stiffness [1/s²] and damping [1/s]
    behind : (G,) of a deeper piece of a flank the gap of the piece before it, which it parts with; else -1
    curves : forces given as tables
    guides : friction of each axis, put into the matrices last
    """

    motions: int
    A: FloatArray
    B: FloatArray
    approach: FloatArray
    push: FloatArray
    k: FloatArray
    d: FloatArray
    behind: NDArray[np.int64]
    curves: list[Curve] = field(default_factory=list)
    guides: list[Guide] = field(default_factory=list)

    @classmethod
    def empty(cls, sets: int, n: int, motions: int, gaps: int, constants: int, curves: int) -> LinearSystem:
        """A system in which nothing acts."""
        U = motions * J + constants + 2 * curves
        return cls(
            motions,
            np.zeros((sets, n, n)),
            np.zeros((sets, n, U)),
            np.zeros((sets, gaps, 2, n + U)),
            np.zeros((sets, gaps, 2, n)),
            np.zeros((sets, gaps)),
            np.zeros((sets, gaps)),
            np.full(gaps, -1),
        )

    @property
    def n(self) -> int:
        """Number of states."""
        return int(self.A.shape[1])

    def motor(self, axis: int, derivative: int = 0) -> int:
        """Column of B (and, behind the states, of a linear form) of a motor's (or other input's) position, speed, …"""
        return axis * J + derivative

    def constant(self, which: int = 0) -> int:
        """Column of B of a step constant: 0 is 1, 1 is the direction s."""
        return self.motions * J + which


WEIGHED = 6
"""Rounds in which the bodies' weights in the bound of the fastest rate are found; more gain nothing."""


def fastest(system: LinearSystem) -> FloatArray:
    """(S,) bound of the fastest rate of the system with every flank in contact [1/s]; states are positions, each
    followed by its speed.

    The bound is a norm in which every body counts as much as it moves in the fastest mode: of a light body between
    heavy ones, counted alike, it would be twice the rate, and every event would be looked for in twice as many pieces.
    """
    n = system.n
    full = np.abs(system.A)
    pressed = np.abs(system.push[..., 1::2, None] * system.approach[..., None, :n:2]).max(axis=2)
    stiff = full[:, 1::2, 0::2] + np.einsum("sg,sgij->sij", np.abs(system.k), pressed)
    loss = full[:, 1::2, 1::2] + np.einsum("sg,sgij->sij", np.abs(system.d), pressed)
    both = sum(law / np.maximum(law.max(axis=(1, 2), keepdims=True), 1e-300) for law in (stiff, loss))
    moves = np.ones((len(full), n // 2, 1))
    bound = rate_in(stiff, loss, moves)
    for _ in range(WEIGHED):
        moves = moves + both @ moves
        moves /= moves.max(axis=1, keepdims=True)
    return np.minimum(bound, rate_in(stiff, loss, moves))


def rate_in(stiff: FloatArray, loss: FloatArray, moves: FloatArray) -> FloatArray:
    """The bound (S,) by laws (S, n/2, n/2) in the norm that weighs every body by how much it moves (S, n/2, 1)."""
    squared, rate = ((law @ moves / moves).max(axis=(1, 2)) for law in (stiff, loss))
    return np.asarray(np.sqrt(squared) + rate)


PER_RUN = 4e5
"""What a run takes however little is simulated, in squared states at grid points (chosen)."""
KNOWN = 128
"""Contact states whose exponentials are kept; when there are more, they are found again."""


def run(system: LinearSystem, x0: FloatArray, c: FloatArray, constants: FloatArray, h: float) -> FloatArray:
    """States at the K + 1 grid points, (S, T, K + 1, n).

    Parameters
    ----------
    x0 : (S, T, n), at the first grid point
    c : (S, T, K, X, J) motor motion, see driven_motion.coefficients
    constants : (T, C) of each step
    h : grid interval [s]
    """
    S, n, U = system.B.shape
    G = system.k.shape[1]
    count(S * c.shape[1] * c.shape[2] * n**2 + PER_RUN)
    B, of, extent, table = tabulated(system)
    law, forced = np.stack((system.k, system.d), axis=2), forced_forms(system)
    of_pieces = pieces(system)
    first = system.k[:, of_pieces[0]]
    over_first = np.divide(system.k, first, out=np.ones_like(first), where=first != 0.0)[..., None, None]
    listed = entries(*(form.reshape(S, 2 * G, n + U) for form in (system.approach, forced * over_first)))
    flanks = (*listed, *of_pieces)
    bent = entries(of)
    rates = fastest(system)
    levels = halvings(float(np.max(rates * h, initial=0.0, where=rates * h < HOPELESS)))
    out = np.empty((*c.shape[:2], c.shape[2] + 1, n))
    propagate(
        (system.A, B, system.push, law, forced),
        flanks,
        (*bent, extent, table),
        (
            np.ascontiguousarray(x0, dtype=np.float64),
            np.ascontiguousarray(c.reshape(*c.shape[:3], -1), dtype=np.float64),
            np.ascontiguousarray(constants, dtype=np.float64),
        ),
        h,
        rates,
        (room_for_exponentials(G, n, U, levels), room_for_exponentials(G, n, U, levels)),
        (*room_for_steps(G, n, U), any(changing(system, *forms[:2]) for forms in (flanks, bent))),
        out,
    )
    return out


def pieces(system: LinearSystem) -> Arrays:
    """Of which gap's flank each gap is a piece (G,), itself where it is none; the next deeper piece (G,), -1 where
    there is none; and how deep the flank is pressed where the piece is met (S, G) [m]."""
    G = len(system.behind)
    first, deeper = np.arange(G), np.full(G, -1)
    for g in np.flatnonzero(system.behind >= 0):
        first[g], deeper[system.behind[g]] = first[system.behind[g]], g
    met = system.approach[:, :, 0, system.n + system.constant()]
    return first, deeper, np.ascontiguousarray(met[:, first] - met)


def tabulated(system: LinearSystem) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """B with what the curves add; their forms (S, Q, n + U), first points and spacings (S, Q, 2), tables (S, Q, P)."""
    S, n, U = system.B.shape
    Q, P = len(system.curves), max((curve.table.shape[1] for curve in system.curves), default=1)
    B, of = system.B.copy(), np.zeros((S, Q, n + U))
    extent, table = np.zeros((S, Q, 2)), np.zeros((S, Q, P))
    for q, curve in enumerate(system.curves):
        of[:, q] = curve.of
        B[:, :, U - 2 * Q + q] += curve.onto
        extent[:, q, 0], extent[:, q, 1] = curve.first, curve.width
        table[:, q] = np.pad(curve.table, ((0, 0), (0, P - curve.table.shape[1])), mode="edge")
    return B, of, extent, table


def forced_forms(system: LinearSystem) -> FloatArray:
    """Every flank's force over k as a linear form (S, G, 2, n + U): δ + d/k·δ̇; without a damper δ may be a form of
    speeds too."""
    n, Q = system.n, len(system.curves)
    rate = np.zeros_like(system.approach)
    rate[..., :n] = system.approach[..., :n] @ system.A[:, None]
    for x in range(system.motions):
        first = n + x * J
        rate[..., first + 1 : first + J] = system.approach[..., first : first + J - 1]
    if Q:
        rate[..., -Q:] += system.approach[..., -2 * Q : -Q]
    share = np.divide(system.d, system.k, out=np.zeros_like(system.d), where=system.d != 0.0)
    return np.asarray(system.approach + share[..., None, None] * rate)


def entries(*forms: FloatArray) -> Arrays:
    """Where linear forms (S, R, W) have entries in any set (R, M), how many (R,), and each form's there (S, R, M)."""
    there = np.any(forms[0], axis=0)
    for form in forms[1:]:
        there |= np.any(form, axis=0)
    place = np.argsort(~there, axis=1, kind="stable")
    many = there.sum(axis=1)
    rows = np.arange(len(place))[:, None]
    return place, many, *(np.ascontiguousarray(form[:, rows, place]) for form in forms)


def changing(system: LinearSystem, place: NDArray[Any], many: NDArray[Any]) -> bool:
    """Whether any of the forms has an entry of an input that changes."""
    first, last = system.n + system.constant(), system.n + system.B.shape[2] - 2 * len(system.curves)
    listed = place[np.arange(place.shape[1]) < many[:, None]]
    return bool(np.any((listed >= system.n) & ((listed < first) | (listed >= last))))


def room_for_exponentials(gaps: int, n: int, U: int, doublings: int) -> Arrays:
    """An empty store: contact states listed by number and their slots, how many, and by slot the highest level that is
    made, the rate matrix and the exponentials over a piece and its doublings. Of all contact states only those that are
    met have a slot."""
    many = min(3**gaps, KNOWN)
    listed = (np.full(2 * many, -1), np.zeros(2 * many, dtype=np.int64), np.zeros(1, dtype=np.int64))
    rates, powers = np.empty((many, n, n + U)), np.empty((many, doublings + 1, n, n + U))
    return *listed, np.zeros(many, dtype=np.int64), rates, powers


def room_for_steps(gaps: int, n: int, U: int) -> tuple[Arrays, Arrays, Arrays]:
    """What a step is computed in: z twice and contact states twice; what exponentials are; what events are."""
    modes = [np.zeros(gaps, dtype=np.int64) for _ in range(2)]
    vectors = (np.zeros(n + U), np.zeros(n + U), *modes)
    exponentials = (np.zeros((n, n + U)), np.zeros((n, n + U)), np.zeros((n, U)), np.zeros(J))
    events = (np.zeros((ORDER + 1, n + U)), np.zeros((ORDER + 1, 2)))
    return vectors, exponentials, events
