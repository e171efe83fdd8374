"""Where the bridge of a gantry is relaxed in a recording, and recordings moved to one zero.

The motors' positions are integrated speeds that begin at zero wherever the pinions stand, so the distance of the two
motors at which the bridge pulls on neither side is another one in every recording. It is the one number of a recording
that is found again in it; then the second motor is moved by the difference, and all recordings share one zero.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import PPoly

from service.backlash.moves import Moves
from service.backlash.moves_fit import fit
from service.backlash.moves_parts import some_of
from service.backlash.moves_point import Point, resting
from service.backlash.moves_predicted import misfits
from service.backlash.moves_refined import rests_found
from service.dynamics.driven_model import Model
from service.recording import FloatArray

MOVES = 4
"""Moves in which the zero is looked for."""
ROUNDS, FOLLOWED = 12, 3
"""Rounds of a fit of that zero, and from how many of those that are tried it is begun: where the model leaves much, it
ends in a valley for each way in which the pinions may rest."""
APART = np.linspace(-1.5e-4, 1.5e-4, 25)
"""Zeros that are tried [m]: a pinion rests anywhere in a gap of up to 0.2 mm, and a bridge is built a little askew."""


def bridge_zero(moves: Moves, model: Model, shared: FloatArray, about: FloatArray = APART) -> float:
    """The distance [m] at which the bridge is relaxed in a recording, the machine being known: shared (P,); looked for
    beside the machine's own by `about`."""
    few, k = some_of(moves, MOVES), [p.name for p in model.parameters].index("bridge_offset")
    parameter, begun = model.parameters[k], list[tuple[float, Point]]()
    for apart in about:
        tried = shared.copy()
        tried[k] = parameter.internal(parameter.value(shared[k]) + apart)
        at = rests_found([few], model, Point(tried, resting([few], model)))
        error = float(
            np.sum(np.nan_to_num(misfits(few, model, at.shared[None], at.local[0][None]), nan=1e6) ** 2)
        )
        begun.append((error, at))
    nearest = sorted(begun, key=lambda one: one[0])[:FOLLOWED]
    fits = [fit([few], model, at, ROUNDS, free=np.array([k])) for _, at in nearest]
    return min(fits, key=lambda f: f.rms).value("bridge_offset")


def moved_to(moves: Moves, zero: float, wanted: float) -> Moves:
    """The moves of a recording whose bridge is relaxed at `zero`, the second motor moved so that it is at `wanted`."""

    def shifted(position: PPoly) -> PPoly:
        c = position.c.copy()
        c[-1] += zero - wanted
        return PPoly(c, position.x)

    plain = (moves.plain[0], shifted(moves.plain[1]))
    same = all(motion[1] is moves.plain[1] for motion in moves.motion)
    motion = tuple((first, plain[1] if same else shifted(second)) for first, second in moves.motion)
    return replace(moves, plain=plain, motion=motion)
