"""A fitted axis with a second gap."""

from __future__ import annotations

from dataclasses import replace

from service.backlash.moves_begun import point_at
from service.backlash.moves_fit import Fitted, values_at
from service.backlash.moves_point import Point
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_transmission import DrivenClearance


def with_a_clearance(found: Fitted, clearance: float) -> tuple[Model, Point]:
    """The model with a part of its backlash as a second gap in series."""
    model = replace(found.model, effects=(*found.model.effects, DrivenClearance(("X1",))))
    whole = found.value("X1.backlash")
    values = values_at(found) | {"X1.clearance": clearance, "X1.backlash": whole - clearance}
    return model, point_at(model, values, found.moves)
