"""What these tests share: a clean axis' moves with its declared model fitted to them, and what made-up fits are taken
for.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from service.backlash.moves import moves_of
from service.backlash.moves_begun import point_at
from service.backlash.moves_fit import Fitted, fit
from service.captures import read_capture
from service.dynamics.driven_model import Model
from service.identification import axis_verdict, moves_finals, moves_looks, moves_motors
from service.identification.scene import ChannelTolerance, as_effects, estimator_alone
from service.recording import Recording


@pytest.fixture(scope="session")
def captures(request: pytest.FixtureRequest) -> tuple[Recording, Recording]:
    shared: Path = request.getfixturevalue("shared_dir")
    train, validate = (read_capture(shared / "captures" / f"none-{p}.parquet") for p in ("train", "validate"))
    return train, validate


@pytest.fixture(scope="session")
def found(captures: tuple[Recording, Recording]) -> Fitted:
    """The declared model at the estimator's values, only briefly fitted."""
    train = captures[0]
    model = Model(("X1",), 2, (ChannelTolerance(("X1",)),), "whole_move", ("constant", "skew"), bridge=False)
    moves = [moves_of(train, ("X1",))]
    place = as_effects(estimator_alone(train, "X1"), ("X1",))
    return fit(moves, model, point_at(model, place, moves), 4)


@pytest.fixture
def sound(monkeypatch: pytest.MonkeyPatch) -> None:
    """No chain is damped as none is, unless a test says which."""
    monkeypatch.setattr(moves_looks, "overdamped", lambda found: getattr(found, "damped", ()))


@pytest.fixture
def no_torque(monkeypatch: pytest.MonkeyPatch) -> None:
    """No torque was recorded, so the motors speak against nothing, and no law is refined, unless a test says what."""
    monkeypatch.setattr(moves_finals, "plainly_against", lambda _present, _trial: False)
    monkeypatch.setattr(moves_finals, "in_full", lambda fitted: fitted)


@pytest.fixture
def silent_motors(monkeypatch: pytest.MonkeyPatch) -> None:
    """No torque was recorded, so the motors say nothing, unless a test says what."""
    for module in (axis_verdict, moves_motors):
        monkeypatch.setattr(module, "left_by_motors", lambda _fitted: np.zeros(1))
