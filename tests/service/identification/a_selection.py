"""What the tests of a verdict share: a trial that left so much of the moves, and the numbers of a machine."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from service.identification.selection import Trial


def trial(train: float, held_out: float) -> Trial[Any]:
    model = SimpleNamespace(axes=("X1",), parameters=(), of_axis=())
    fitted = SimpleNamespace(model=model, at=SimpleNamespace(shared=()))
    return Trial(SimpleNamespace(fitted=fitted), train, held_out, np.ones(5), np.zeros(0), 100.0)


def numbers(_fitted: object) -> dict[str, tuple[float, float]]:
    """Of a sound machine, but for a mesh error of more than a thousandth of the pitch, and for what swings."""
    swing = {"X1.hung_ratio": (0.1, 0.01), "body_ratio": (0.1, 0.01)}
    mesh = {"X1.ripple_amplitude": (5e-6, 1e-7), "X1.ripple_period": (4e-3, 1e-4)}
    return {"X1.bend": (0.1, 0.01), **mesh, **swing}
