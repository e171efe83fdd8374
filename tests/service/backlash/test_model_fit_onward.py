"""The begin of a gantry's fit of all steps: the later ones follow from the first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from service.backlash.model_fit_data import Measured, measure, problem_of, with_reconstructed_motion
from service.backlash.model_fit_onward import onward, with_forces_repeated
from service.backlash.model_fit_problem import Point, Problem, course_at, fit
from service.backlash.model_fit_stages import Outcome
from service.dynamics.driven_model import Model
from service.dynamics.parameters import AxisParameters
from service.recording import FloatArray
from tests.service.backlash.gantry_run import STEPS, recorded, simulated

FIRST = 2


def middle() -> tuple[Measured, Problem, FloatArray]:
    """A gantry with one lump per drive, and the coordinates of the middle machine."""
    axis = AxisParameters()
    recording = recorded(simulated(axis, axis, k=2e7), axis.transmission)
    measured = measure(recording, ("X1", "X2"), range(STEPS))
    model = Model(measured.axes, 1)
    problem = problem_of(measured, model)
    return measured, problem, np.zeros(len(model.parameters))


def as_if_recorded(problem: Problem, at: Point) -> Problem:
    """The problem with what the machine itself would show, so that the point is its only answer."""
    said = course_at(problem, at.shared[None], at.local[None]).acceleration()[0]
    grids = tuple(replace(g, measured=own, used=g.used) for g, own in zip(problem.grids, said, strict=True))
    return replace(problem, grids=grids)


def crept(problem: Problem) -> FloatArray:
    """Initial states with the motors 12 µm further apart in every step, beyond what a fit finds from nothing."""
    local = np.zeros(problem.local_shape)
    local[:, 0, 2] = 6.0 * np.arange(STEPS)
    local[:, 1, 2] = -6.0 * np.arange(STEPS)
    return local


def test_motors_that_creep_apart_are_followed_from_step_to_step() -> None:
    measured, problem, shared = middle()
    local = crept(problem)
    problem = as_if_recorded(problem, Point(shared, local))
    few = problem.first_steps(FIRST)
    held = replace(few, free=(False,) * len(few.free))
    found = fit(held, Point(shared, local[:FIRST]), 3, 1.0)
    few = replace(few, force=found.response.force[0])
    _, at = onward(
        measured, problem, Outcome(few, found), lambda _m, whole, f: forced(whole, f.response.force[0])
    )
    apart = (at.local[..., 2] - local[..., 2]) @ [1.0, -1.0]
    assert np.max(np.abs(apart)) < 1.0, "micrometres"


def forced(problem: Problem, force: FloatArray) -> Problem:
    """The problem with the motors' motion as it is: here it is known."""
    return replace(problem, force=force)


def test_later_steps_need_the_force_of_those_that_went_the_same_way() -> None:
    _, problem, shared = middle()
    few = problem.first_steps(FIRST)
    found = Outcome(few, fit(few, Point(shared, np.zeros(few.local_shape)), 0))
    force = found.fit.response.force[0]
    assert problem.s.tolist() == [1.0, -1.0, 1.0, -1.0]
    assert np.array_equal(with_forces_repeated(problem, found).response.force[0], np.tile(force, (2, 1, 1)))
    one = Outcome(few, replace(found.fit, response=replace(found.fit.response, force=force[None, :1])))
    other_way = with_forces_repeated(problem, one).response.force[0, 1]
    assert np.array_equal(other_way, -force[0])


def test_motion_of_the_first_steps_stays_as_it_was_fitted() -> None:
    measured, problem, shared = middle()
    few = problem.first_steps(FIRST)
    found = fit(few, Point(shared, np.zeros(few.local_shape)), 1)
    few = with_reconstructed_motion(measured, few, found)
    whole, at = onward(measured, problem, Outcome(few, found), with_reconstructed_motion)
    assert whole.motion[:FIRST] == few.motion
    assert len(whole.motion) == len(whole.grids) == STEPS
    assert whole.force is not None and whole.force.shape[0] == STEPS
    assert at.local.shape == problem.local_shape
    assert np.array_equal(at.local[:FIRST], found.point.local)
