"""What the tests of a search share: its names, its scene and present fit, and a fit of which only the RMS counts."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

FORCE, FRICTION = "position_dependent_force", "asymmetric_friction"
HUNG, BODY = "hung_mass_mode", "machine_body_mode"
SCENE = cast(Any, SimpleNamespace(smooth={"X1.gear_mass": 0.05}, smooth_left=np.inf))
PRESENT = cast(Any, SimpleNamespace(train_rms=9.0, validation_rms=9.0))


def stub(rms: float, name: str = "") -> Any:
    effects = (SimpleNamespace(many_valleys=False),)
    model, at = SimpleNamespace(parameters=(), effects=effects, lumps=2), SimpleNamespace(local=())
    return cast(Any, SimpleNamespace(rms=rms, moves=("every",), model=model, at=at, name=name))
