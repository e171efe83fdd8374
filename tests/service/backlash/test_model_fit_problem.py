"""How long a fit goes on: to the end where it may become the best, a look where it will not."""

from __future__ import annotations

import numpy as np
import pytest

from service.backlash import model_fit_problem
from service.backlash.model_fit_data import measure, problem_of
from service.backlash.model_fit_problem import LOOK, Point, fit
from service.dynamics.driven_model import Model
from service.dynamics.parameters import AxisParameters
from tests.service.backlash.gantry_run import recorded, simulated


def test_a_fit_that_is_dearer_than_the_best_after_a_look_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    axis, rounds = AxisParameters(), list[int]()
    measured = measure(recorded(simulated(axis, axis, k=2e7), axis.transmission), ("X1", "X2"), range(2))
    model = Model(measured.axes, 1)
    problem = problem_of(measured, model)
    start = Point(np.zeros(len(model.parameters)), np.zeros(problem.local_shape))
    tried = model_fit_problem.best_trial

    def counted(*given: object) -> object:
        rounds.append(1)
        return tried(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(model_fit_problem, "best_trial", counted)
    to_the_end = fit(problem, start, LOOK + 2, 0.0)
    assert len(rounds) == LOOK + 2
    rounds.clear()
    given_up = fit(problem, start, LOOK + 2, 0.0, dearest=0.9 * to_the_end.cost)
    assert len(rounds) == LOOK
    assert given_up.cost > to_the_end.cost
    assert given_up.response.force == pytest.approx(fit(problem, start, LOOK, 0.0).response.force)
    assert fit(problem, start, LOOK + 2, 0.0, dearest=np.inf).cost == to_the_end.cost
