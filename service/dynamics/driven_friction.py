"""Friction of a carriage in its guide: viscous, Coulomb, and curves of the sliding speed that effects add.

While a move is under way in one direction, Coulomb friction is a constant, −s·F_C. Over a whole move, from rest to
rest, it holds the carriage until it is pushed over its breakaway level: up to the turnover speed it grows in
proportion to the speed, beyond it stays at its level. The two corners are contact events like those of a flank, so
that sticking is as exact as sliding, whatever the grid.
"""

from __future__ import annotations

import numpy as np

from service.dynamics.driven_propagation import Curve, Guide, LinearSystem
from service.recording import FloatArray

FASTEST = 0.4
"""Greatest sliding speed of the tables [m/s]; beyond it friction stays what it is there. Diagnostic steps reach a
quarter of it."""

WIDTH = 5e-4
"""Spacing of the tables [m/s]; chosen: an eighth of the smallest Stribeck speed that guides have."""


def speeds() -> FloatArray:
    """Sliding speeds of the tables [m/s]."""
    half = round(FASTEST / WIDTH)
    return np.asarray(WIDTH * np.arange(-half, half + 1), dtype=np.float64)


def add_friction(system: LinearSystem, guide: Guide, gap: int, curved: bool) -> None:
    """Put a guide's friction into the matrices; `gap` is where its corners stand if the turnover speed is known."""
    slip, onto = guide.slip[: system.n], guide.onto
    system.A -= guide.viscous[:, None, None] * onto[:, :, None] * slip
    if guide.turnover is None:
        mean, half = 0.5 * (guide.forward + guide.backward), 0.5 * (guide.forward - guide.backward)
        system.B[:, :, system.constant(1)] -= mean[:, None] * onto
        system.B[:, :, system.constant(0)] -= half[:, None] * onto
    else:
        add_corners(system, guide, guide.turnover, gap)
    if curved:
        S = len(guide.table)
        system.curves.append(
            Curve(
                np.broadcast_to(guide.slip, (S, len(guide.slip))),
                -onto,
                np.full(S, -FASTEST),
                np.full(S, WIDTH),
                guide.table,
            )
        )


def add_corners(system: LinearSystem, guide: Guide, turnover: FloatArray, gap: int) -> None:
    """Coulomb friction from rest: a damper whose force is held at its levels.

    What the damper has above a level is given back by a flank that is pressed by the speed beyond the corner.
    """
    steep = 0.5 * (guide.forward + guide.backward) / turnover
    system.A -= steep[:, None, None] * guide.onto[:, :, None] * guide.slip[: system.n]
    system.k[:, gap] = steep
    for side, (sign, level) in enumerate(((-1.0, guide.backward), (1.0, guide.forward))):
        system.approach[:, gap, side] = sign * guide.slip
        system.approach[:, gap, side, system.n + system.constant()] = -level / steep
        system.push[:, gap, side] = sign * guide.onto
