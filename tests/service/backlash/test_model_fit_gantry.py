"""The joint fit of a gantry: against the truth of a shared capture, with motors whose distance wanders, and where the
partner holds the load against one flank."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.backlash import model_fit, model_fit_gantry
from service.backlash.model_fit import model_fit_axes
from service.backlash.model_fit_data import Measured, measure, problem_of, with_reconstructed_motion
from service.backlash.model_fit_gantry import with_gear_and_pinion
from service.backlash.model_fit_problem import Point, Problem, answer, fit
from service.backlash.model_fit_stages import (
    HOPELESS,
    Outcome,
    backlashes,
    following_force,
    sound_drives,
    with_impurities,
)
from service.backlash.results import Reason
from service.captures import read_capture
from service.dynamics.driven_model import Model
from service.dynamics.parameters import AxisParameters
from service.dynamics.simulation import GapCrossing
from service.recording import Move, Recording
from tests.service.backlash.gantry_run import recorded, simulated

WANDERED = 1.5e-6


def wandering(recording: Recording, axis: str) -> Recording:
    """The recording with a speed in every second rest that moves the integrated position by WANDERED [m]."""
    speed = recording.traces[axis, "motor_speed"]
    value = speed.value.copy()
    for move in recording.moves[1::2]:
        rest = (speed.time > move.start - 0.2) & (speed.time < move.start - 0.1)
        value[rest] += WANDERED / 0.1 / recording.axis(axis).transmission
    return replace(recording, traces={**recording.traces, (axis, "motor_speed"): replace(speed, value=value)})


def test_wandering_distance_of_the_motors_is_no_backlash(shared_dir: Path) -> None:
    path = shared_dir / "captures" / "declared-gantry-02.parquet"
    truth = json.loads((shared_dir / "captures" / "declared-gantry-02-truth.json").read_text())["backlash_m"]
    results = model_fit_axes(wandering(read_capture(path), "X1"), "X1")
    for axis, result in results.items():
        assert result.backlash is not None, result.detail
        assert np.abs(result.backlash - truth[axis]) < max(1e-6, 0.02 * truth[axis])
        assert result.interval_95 is not None
        assert result.interval_95[1] - result.interval_95[0] < 5e-6


def test_a_gantry_that_one_search_does_not_solve_is_answered(shared_dir: Path) -> None:
    path = shared_dir / "captures" / "declared-gantry-01.parquet"
    truth = json.loads((shared_dir / "captures" / "declared-gantry-01-truth.json").read_text())["backlash_m"]
    for axis, result in model_fit_axes(read_capture(path), "X2").items():
        assert result.verdict == "ok", result.detail
        assert result.backlash is not None
        assert abs(result.backlash - truth[axis]) < max(0.5e-6, 0.01 * truth[axis])


def test_where_no_start_comes_near_no_motor_follows_and_the_run_is_refused(monkeypatch: Any) -> None:
    """Forces of a fit that ran away are no numbers: nothing is computed from them."""
    away = cast(Any, SimpleNamespace(problem=None, fit=SimpleNamespace(misfit=1e16, cost=np.inf, point=None)))
    monkeypatch.setattr(model_fit_gantry, "settled", lambda *_: (None, None))
    monkeypatch.setattr(model_fit_gantry, "passes", lambda *_: [away])
    found = model_fit_gantry.over_all_steps(*cast(Any, (None, None, None)), model_fit.GANTRY, cast(Any, None))
    assert found == [away]
    monkeypatch.setattr(model_fit, "unexplained", lambda *_: np.nan)
    refusal = model_fit.doubt(*cast(Any, (None, away, 0, None)))
    assert refusal is not None
    assert refusal.reason == Reason.MISFIT
    assert "No fit came near" in refusal.detail


@pytest.mark.parametrize("name", ["X1.mesh_2", "X2.mesh_1", "X2.bend"])
def test_neither_axis_is_answered_where_the_fit_bends_one_as_no_sound_machine_is(name: str) -> None:
    names = ("X1.backlash", "X1.mesh_2", "X1.bend", "X2.backlash", "X2.mesh_1", "X2.bend")

    model = cast(Any, SimpleNamespace(parameters=[SimpleNamespace(name=n) for n in names]))
    one = np.where(np.array(names) == name, model_fit.FAR_OUT, 0.0)
    far = model_fit.far_out(model, -1.1 * one)
    assert far is not None
    assert name[:2] in far
    assert model_fit.far_out(model, 0.9 * one) is None


def test_a_gap_that_the_partner_lets_be_crossed_in_one_direction_is_refused() -> None:
    """The axes' zeros lie so far apart that the bridge holds each load against one flank while it brakes one way."""
    first = AxisParameters(b=100e-6)
    run = simulated(first, AxisParameters(b=30e-6, M=330.0), k=3e7, offset=120e-6)
    for name, way in (("X1", 1), ("X2", -1)):
        crossed = {move.direction for move in run.moves if passed(run.axes[name].crossings, move)}
        assert crossed == {way}, "the simulated machine itself crosses one way only"
    for result in model_fit_axes(recorded(run, first.transmission), "X1").values():
        assert result.reason == Reason.GAP_NOT_CROSSED
        assert result.detail is not None and "in one direction only" in result.detail
        assert result.backlash is None


def passed(crossings: Sequence[GapCrossing], move: Move) -> bool:
    """Whether the load passed from the driving flank to the other one in the move."""
    return any(c.before == move.direction and move.start < c.t2 <= move.end for c in crossings)


def light(every: int) -> tuple[Measured, Problem]:
    """A gantry with one lump per drive, its motors sampled at 8 kHz / `every`, on its middle machine."""
    axis = AxisParameters()
    recording = recorded(simulated(axis, axis, k=2e7), axis.transmission, every)
    measured = measure(recording, ("X1", "X2"), range(2))
    model = Model(measured.axes, 1)
    return measured, problem_of(measured, model)


@pytest.mark.parametrize(("every", "echoes"), [(16, [2, 2]), (2, [])])
def test_both_motors_answer_the_forces_where_the_speed_is_sampled_slowly(
    every: int, echoes: list[int]
) -> None:
    measured, problem = light(every)
    begun = fit(problem, Point(np.zeros(len(problem.free)), np.zeros(problem.local_shape)), 0)
    assert [len(step) for step in following_force(measured, problem, begun).echoes] == echoes
    assert not with_reconstructed_motion(measured, problem, begun).echoes, "unless it is asked for"


def test_a_drive_that_lost_its_mass_is_shared_out_to_lumps_that_can_be_simulated() -> None:
    measured, problem = light(8)
    u = np.array([-4.0 if p.name.endswith("drive_mass") else 0.0 for p in problem.model.parameters])
    start = Outcome(problem, fit(problem, Point(u, np.zeros(problem.local_shape)), 0))
    model = Model(measured.axes, 2)
    heavy = problem_of(measured, model)
    assert with_gear_and_pinion(measured, heavy, start, (1,), following_force).fit.misfit < HOPELESS


def test_only_masses_and_damping_of_a_drive_are_taken_back_to_what_is_sound() -> None:
    model = Model(("X1",), 2)
    far = np.full(len(model.parameters), -3.0)
    taken = dict(zip((p.name for p in model.parameters), sound_drives(model, far), strict=True))
    assert taken["X1.pinion_mass"] == taken["X1.gear_damping_ratio"] == -1.0
    assert taken["X1.backlash"] == taken["X1.pinion_stiffness"] == taken["X1.coulomb"] == -3.0


def test_a_bent_contact_is_fitted_in_finer_pieces_at_the_end() -> None:
    """Accelerations of bent flanks in fine pieces: coarse ones take something else for it, the last fit does not."""
    _, pure = light(8)
    coarse, at = with_impurities(pure, Point(np.zeros(len(pure.free)), np.zeros(pure.local_shape)))
    u = np.array([2.0 if p.name.endswith(".bend") else 0.0 for p in coarse.model.parameters])
    effects = tuple(e.refined for e in coarse.model.effects)
    made = answer(replace(coarse, model=replace(coarse.model, effects=effects)), replace(at, shared=u))[0]
    grids = zip(coarse.grids, made.acceleration[0], strict=True)
    recorded_so = replace(coarse, grids=tuple(replace(g, measured=a) for g, a in grids))
    found = Outcome(recorded_so, fit(recorded_so, Point(u, at.local), 4))
    last = model_fit_gantry.with_finer_contact(found)
    true = backlashes(recorded_so, replace(found.fit, point=replace(at, shared=u)))
    before, after = (np.abs(backlashes(o.problem, o.fit) - true) for o in (found, last))
    assert last.fit.misfit < 0.2 * found.fit.misfit
    assert np.max(after) < 0.2 * np.max(before)
