"""Two axes and the bridge between them, eq. (9): the partner's pull reaches a carriage through the bridge."""

from __future__ import annotations

from service.dynamics.axis import axis_mechanism, body
from service.dynamics.mechanism import Mechanism, join
from service.dynamics.parameters import AxisParameters, GantryParameters


def gantry_mechanism(pair: GantryParameters, first: AxisParameters, second: AxisParameters) -> Mechanism:
    """Return both axes' chains, their carriages joined by the bridge's stiffness and damping.

    In eq. (9) f is then k·(x₁ − x₂ − offset) + d·(ẋ₁ − ẋ₂) on the first carriage, its opposite on the other.
    """
    both = join(axis_mechanism(pair.first, first), axis_mechanism(pair.second, second))
    skew = both.row(body(pair.first, "carriage"), body(pair.second, "carriage"))
    return both.with_element(skew, pair.k, pair.d, pair.offset)
