"""What the tests of a search share: its names, its scene and present fit, and a fit of which only the RMS counts."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.identification import axis_explain, moves_motors
from service.identification.moves_repeated import PureError
from service.identification.selection import Selection, Trial
from service.recording import FloatArray

FORCE, FRICTION = "position_dependent_force", "asymmetric_friction"
HUNG, BODY = "hung_mass_mode", "machine_body_mode"
SCENE = cast(Any, SimpleNamespace(smooth={"X1.gear_mass": 0.05}, smooth_left=np.inf))
PRESENT = cast(Any, SimpleNamespace(train_rms=9.0, validation_rms=9.0))


def stub(rms: float, name: str = "") -> Any:
    effects = (SimpleNamespace(many_valleys=False),)
    model, at = SimpleNamespace(parameters=(), effects=effects, lumps=2), SimpleNamespace(local=())
    return cast(Any, SimpleNamespace(rms=rms, moves=("every",), model=model, at=at, name=name))


def trial(train: float, held_out: float) -> Trial[Any]:
    return Trial(SimpleNamespace(fitted="fitted"), train, held_out, np.ones(5), np.zeros(0), 100.0)


def heard(monkeypatch: pytest.MonkeyPatch, left: float = 5.0) -> None:
    """What the motors leave in the held-out moves; 0 where these have no torque. Nothing swings, and what every sound
    machine has explains nothing."""
    monkeypatch.setattr(
        axis_explain, "with_impurities", lambda _scene, before, _tell: Selection(before, before, (), (), ())
    )
    monkeypatch.setattr(axis_explain, "pure_error", lambda _fitted: PureError(3.0, 1.0))
    monkeypatch.setattr(axis_explain, "swinging", lambda *_: {})
    monkeypatch.setattr(axis_explain, "as_heard_by_motors", lambda _before: trial(1.0, left))
    monkeypatch.setattr(axis_explain, "nothing_left", lambda _found: False)
    monkeypatch.setattr(axis_explain, "leads", lambda *_: True)
    monkeypatch.setattr(axis_explain, "challenged", lambda _scene, present, _best: present)


def motors_leave(monkeypatch: pytest.MonkeyPatch, left: Callable[[Any], FloatArray]) -> None:
    """What the motors leave of a fit, wherever it is asked."""
    for module in (axis_explain, moves_motors):
        monkeypatch.setattr(module, "left_by_motors", left)
