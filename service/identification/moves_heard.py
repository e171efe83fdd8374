"""What is heard to swing between the moves, fitted to all moves from typical machines.

Every move begins with a swing of its own, so a few moves tell little of what swings, and many machines describe them.
By the loads' speeds, which have no valleys but those of the swing, all moves lead to the one; and once a machine
describes them about, how the moves go on from one to the next leads to it further than anything in them.
"""

from __future__ import annotations

import numpy as np

from service.backlash.moves_begun import point_at
from service.backlash.moves_fit import Fitted, fit
from service.backlash.moves_point import Free
from service.identification.moves_rests import begun_as_left
from service.identification.moves_starts import (
    ROUNDS,
    SUMMED,
    Candidate,
    heard_on_typical_machines,
    of_speed,
    unanswering,
)
from service.identification.scene import Scene

CONTINUED = 2
"""How many of the fits are continued, the best (chosen)."""


def heard(scene: Scene, found: Fitted, candidate: Candidate) -> list[Fitted]:
    """Fits of all moves of what is heard, the best first; none where nothing is, or of what does not swing."""
    moves, model, free = unanswering(found.moves), candidate.model, at_first(candidate)
    speeds = of_speed(moves, SUMMED[0])
    begun = [
        fit(speeds, model, point_at(model, one, moves), ROUNDS, free=free)
        for one in heard_on_typical_machines(scene, candidate)
    ]
    out = []
    for first in sorted(begun, key=lambda f: f.rms)[:CONTINUED]:
        nearer = fit(speeds, model, first.at, ROUNDS, free=free)
        nearer = fit(moves, model, nearer.at, ROUNDS, free=free)
        out.append(begun_as_left(nearer, ROUNDS))
    return sorted(out, key=lambda f: f.rms)


def at_first(candidate: Candidate) -> Free:
    """The coordinates that are fitted while a fit is far off: without what an effect may have or not beside its
    amounts, which takes their place there."""
    own = set(candidate.effect.parameters)
    return np.flatnonzero([p not in own or p.logarithmic or p.dose > 0.0 for p in candidate.model.parameters])
