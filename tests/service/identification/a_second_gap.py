"""Stand-ins for fits with a second gap, and without."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from service.dynamics.effects.driven_library import DRIVEN


def two_gaps(backlash: float, clearance: float, rms: float = 2.0, contact: float = 1e6) -> Any:
    """A fit of two gaps in one axis."""
    values = {
        "X1.backlash": backlash,
        "X1.clearance": clearance,
        "X1.gear_stiffness": 1e6,
        "X1.pinion_stiffness": 2e6,
        "X1.contact_stiffness": contact,
        "X1.contact_damping_ratio": 3.1,
        "X1.gear_damping_ratio": 0.03,
        "X1.pinion_friction": 0.02,
        "X1.pinion_viscous": 0.04,
    }
    model = SimpleNamespace(axes=("X1",), lumps=2, effects=(DRIVEN["gearbox_clearance"](("X1",)),))
    at = SimpleNamespace(shared=np.zeros(len(values)))
    return SimpleNamespace(values=values, model=model, at=at, rms_with_motors=rms, motors=np.ones(3))


def loud(rms: float = 6.0) -> Any:
    """The model without them, whose motors leave as much."""
    found = two_gaps(0.0, 0.0, rms)
    found.motors = np.full(3, rms)
    return found
