"""Friction of a carriage in its guide: viscous, Coulomb, and curves of the sliding speed that effects add.

While a move is under way in one direction, Coulomb friction is a constant, −s·F_C. Over a whole move, from rest to
rest, it holds the carriage until it is pushed over its breakaway level: it grows with the speed, up to its level some
way beyond the turnover speed. The knee of that curve is made of three corners, which are contact events like those of
a flank, so that sticking is as exact as sliding, whatever the grid. How far they lie apart is a number of its own: a
load that starts shows the shape of the knee, and a fit makes up for a wrong one by another Coulomb level and another
viscous friction, which together are wrong at every other speed.
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

SHARES = (0.30, 0.45, 0.25)
"""Of the Coulomb level, what turns over before, at and after the turnover speed. Chosen: with the corners twice, 2.6
and 3.9 times apart they come within 4, 4 and 6 % of tanh x, x/√(1 + x²) and the arc tangent."""


def speeds() -> FloatArray:
    """Sliding speeds of the tables [m/s]."""
    half = round(FASTEST / WIDTH)
    return np.asarray(WIDTH * np.arange(-half, half + 1), dtype=np.float64)


def add_friction(system: LinearSystem, guide: Guide, gap: int, curved: bool) -> None:
    """Put a guide's friction into the matrices; its corners stand at `gap` and behind it if the turnover speed is
    known."""
    slip, onto = guide.slip[: system.n], guide.onto
    system.A -= guide.viscous[:, None, None] * onto[:, :, None] * slip
    if guide.turnover is None:
        mean, half = 0.5 * (guide.forward + guide.backward), 0.5 * (guide.forward - guide.backward)
        system.B[:, :, system.constant(1)] -= mean[:, None] * onto
        system.B[:, :, system.constant(0)] -= half[:, None] * onto
    else:
        speed, spread = guide.turnover
        for place, share in enumerate(SHARES):
            add_corner(system, guide, share, speed * spread ** (place - 1), gap + place)
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


def add_corner(system: LinearSystem, guide: Guide, share: float, speed: FloatArray, gap: int) -> None:
    """A share of the Coulomb friction from rest: a damper whose force is held at its levels from `speed` (S,) on.

    What the damper has above a level is given back by a flank that is pressed by the speed beyond the corner.
    """
    forward, backward = share * guide.forward, share * guide.backward
    steep = 0.5 * (forward + backward) / speed
    system.A -= steep[:, None, None] * guide.onto[:, :, None] * guide.slip[: system.n]
    system.k[:, gap] = steep
    for side, (sign, level) in enumerate(((-1.0, backward), (1.0, forward))):
        system.approach[:, gap, side] = sign * guide.slip
        system.approach[:, gap, side, system.n + system.constant()] = -level / steep
        system.push[:, gap, side] = sign * guide.onto
