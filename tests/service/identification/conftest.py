"""A clean axis' moves, and its declared model fitted to them, for all tests that need both."""

from __future__ import annotations

from pathlib import Path

import pytest

from service.backlash.moves import moves_of
from service.backlash.moves_begun import point_at
from service.backlash.moves_fit import Fitted, fit
from service.captures import read_capture
from service.dynamics.driven_model import Model
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
