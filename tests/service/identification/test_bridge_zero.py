"""The bridge's zero is found again in a recording, and recordings are moved to one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from service.backlash.moves import Moves, moves_of
from service.backlash.moves_begun import point_at
from service.backlash.moves_fit import Fitted, fit, values_at
from service.backlash.moves_parts import some_of
from service.backlash.moves_point import Point, resting
from service.backlash.moves_refined import rests_found
from service.captures import read_capture
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_bodies import DrivenGantryCoupling
from service.identification.bridge_zero import bridge_zero, moved_to
from service.identification.held_out import held_out, rms


def fitted_gantry(shared_dir: Path) -> tuple[Moves, Fitted]:
    """All moves of a gantry, and the declared model fitted to four of them."""
    recording = read_capture(shared_dir / "captures" / "declared-gantry-00.parquet")
    axes = tuple(axis.name for axis in recording.axes)
    moves, model = moves_of(recording, axes), Model(axes, 1, (), "whole_move", ("constant", "skew"))
    few = [some_of(moves, 4)]
    at = rests_found(few, model, Point(np.zeros(len(model.parameters)), resting(few, model)))
    return moves, fit(few, model, at, 12)


def test_a_zero_is_found_again_wherever_the_motors_began(shared_dir: Path) -> None:
    """The second motor's positions begin 70 µm elsewhere: the bridge's zero is found 70 µm elsewhere, and undone."""
    moves, few = fitted_gantry(shared_dir)
    model, shared = few.model, few.at.shared
    first = bridge_zero(moves, model, shared)
    elsewhere = moved_to(moves, 70e-6, 0.0)
    second = bridge_zero(elsewhere, model, shared)
    assert second - first == pytest.approx(-70e-6, abs=1e-6)
    again = moved_to(elsewhere, second, first)
    assert bridge_zero(again, model, shared, np.zeros(1)) == pytest.approx(first, abs=1e-6)


def test_a_bridge_that_was_added_is_found_relaxed_wherever_the_motors_began(shared_dir: Path) -> None:
    """The zero of a held-out recording may lie far from that of the train recording: a fit from there ends anywhere."""
    _, declared = fitted_gantry(shared_dir)
    axes, few = declared.model.axes, declared.moves
    added = Model(axes, 1, (DrivenGantryCoupling(axes),), "whole_move", ("constant", "skew"), bridge=False)
    found = fit(few, added, point_at(added, values_at(declared), few), 0)
    near, far = (
        held_out(moved_to(few[0], apart, 0.0), found, thorough=False).weighed for apart in (0.0, 120e-6)
    )
    assert rms(far) < 1.1 * rms(near)
