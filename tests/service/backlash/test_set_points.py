"""Motors that return to their set-points are known there, and others are left where their integrated speed says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PPoly

from service.backlash.moves import moves_of
from service.backlash.moves_predicted import predict
from service.backlash.set_points import motors_of, stood
from service.captures import read_capture
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_bodies import WANDERING, MotorWander
from service.recording import FloatArray, Move

LENGTH, DURATION, REST = 5e-3, 0.1, 0.35
MOVES = tuple(Move(REST + k * (REST + DURATION), 1 - 2 * (k % 2), LENGTH, 200.0, DURATION) for k in range(10))
NOISE = 3.5e-7
"""How far the integrated speed wanders in a second [m]: 1 kHz samples with 0.035 rpm of noise on 3 mm/rad."""
KNOWN = 0.2 * NOISE
"""Hardly more than what is left of it [m]: of the 0.45 s of a travel by their mean, and of a third of the time in which
a motor is seen to stand."""
TIME = np.arange(0.0, MOVES[-1].end + REST, 1e-3)


def course(rests: Sequence[float]) -> FloatArray:
    """Positions at TIME of a motor that stands at these places [m] before, between and after the moves."""
    out = np.full(len(TIME), rests[0])
    for move, begin, end in zip(MOVES, rests, rests[1:], strict=False):
        u = np.clip((TIME - move.start) / move.duration, 0.0, 1.0)
        out += (end - begin) * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    return out


SEEDS = range(20)


def integrated(position: FloatArray, seed: int = 4) -> PPoly:
    """The integral of its speed with noise."""
    noise = np.random.default_rng(seed).standard_normal(len(TIME)) * NOISE / np.sqrt(1e-3)
    return CubicSpline(TIME, CubicSpline(TIME, position)(TIME, 1) + noise).antiderivative()


def begins(position: PPoly) -> FloatArray:
    return np.array([float(position(move.start)) for move in MOVES])


def test_a_motor_that_returns_is_at_its_set_point_where_each_move_begins() -> None:
    true, wanted = course([0.0, LENGTH] * 5 + [0.0]), np.array([0.0, LENGTH] * 5)
    wandering = [integrated(true, seed) for seed in SEEDS]
    found = [stood(one, MOVES, NOISE) for one in wandering]
    before, after = (
        np.sqrt(np.mean([np.var(begins(one) - wanted) for one in places]))
        for places in (wandering, [one.position for one in found])
    )
    assert after < KNOWN < before
    assert [one.off for one in found] == pytest.approx([NOISE * np.sqrt(DURATION)] * len(SEEDS))


def test_its_speed_is_changed_by_next_to_nothing() -> None:
    wandering = integrated(course([0.0, LENGTH] * 5 + [0.0]))
    changed = stood(wandering, MOVES, NOISE).position(TIME, 1) - wandering(TIME, 1)
    assert 0.0 < np.max(np.abs(changed)) < 0.3 * NOISE / np.sqrt(1e-3)


def test_a_transmission_that_is_a_little_off_is_no_other_set_point() -> None:
    true = 1.003 * course([0.0, LENGTH] * 5 + [0.0])
    found, wanted = [stood(integrated(true, seed), MOVES, NOISE) for seed in SEEDS], [0.0, 1.003 * LENGTH] * 5
    assert np.sqrt(np.mean([np.var(begins(one.position) - wanted) for one in found])) < KNOWN
    assert all(one.off < WANDERING for one in found)


def test_a_motor_that_friction_holds_off_is_where_its_speed_says() -> None:
    off = 3e-6 * np.random.default_rng(5).standard_normal(11)
    wandering = integrated(course(np.array([0.0, LENGTH] * 5 + [0.0]) + off))
    found = stood(wandering, MOVES, NOISE)
    assert found.position is wandering
    assert found.off == WANDERING


def test_a_few_moves_or_short_rests_tell_nothing() -> None:
    wandering = integrated(course([0.0, LENGTH] * 5 + [0.0]))
    assert stood(wandering, MOVES[:3], NOISE).position is wandering
    hurried = [replace(move, start=move.start - 0.3 * (k > 4)) for k, move in enumerate(MOVES)]
    assert stood(wandering, hurried, NOISE).position is wandering


def test_so_are_both_motors_of_a_gantry_and_no_single_axis(shared_dir: Path) -> None:
    recording = read_capture(shared_dir / "captures" / "declared-gantry-00.parquet")
    axes = tuple(axis.name for axis in recording.axes)
    assert np.all(motors_of(recording, axes)[1] < 0.2 * WANDERING)
    assert motors_of(recording, axes[:1])[1] == pytest.approx([WANDERING])


def test_how_far_they_may_be_apart_is_the_width_of_a_moves_coordinate(shared_dir: Path) -> None:
    recording = read_capture(shared_dir / "captures" / "declared-gantry-00.parquet")
    axes = tuple(axis.name for axis in recording.axes)
    moves, model = moves_of(recording, axes), Model(axes, 1, (MotorWander(axes),), "whole_move", ("skew",))
    assert moves.apart < 0.3
    shared, local = np.zeros((1, len(model.parameters))), np.zeros((1, len(moves.grids), 5))
    local[..., 4] = 0.7
    narrow = predict(moves, model, shared, local).acceleration()
    wide = predict(replace(moves, apart=1.0), model, shared, moves.apart * local).acceleration()
    np.testing.assert_allclose(narrow, wide, rtol=0.0, atol=1e-9)
