"""Friction of a carriage in its guide: viscous, Coulomb, and curves of the sliding speed that effects add.

While a move is under way in one direction, Coulomb friction is a constant, −s·F_C. Over a whole move, from rest to
rest, it holds the carriage until it is pushed over its breakaway level, F_C·tanh(v/v_t): it turns over within the
turnover speed v_t. The curve's knee is made of a few corners, which are contact events like those of a flank, so that
sticking is as exact as sliding, whatever the grid. One sharp corner instead is seen: a load that starts shows the
shape of the knee, and a fit makes up for a wrong one by another Coulomb level (by 0.03 m/s², which it takes for
another viscous friction, and which is wrong by as much at another speed).
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

CORNERS = ((0.30, 0.62), (0.45, 1.30), (0.25, 2.40))
"""Shares of the Coulomb level, and where each is reached over the turnover speed: nearest to tanh by least squares,
within 3 %."""


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
        for place, (share, times) in enumerate(CORNERS):
            add_corner(system, guide, share, times * guide.turnover, gap + place)
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
