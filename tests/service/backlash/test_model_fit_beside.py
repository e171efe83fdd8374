"""What a value beside a fit's costs: on a linear problem of which everything is known, and where that ends."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from service.backlash import model_fit_beside
from service.backlash.model_fit_beside import Beside
from service.backlash.model_fit_interval import Linearised, Step
from service.backlash.model_fit_problem import Point, Problem
from service.backlash.model_fit_stages import Outcome
from service.dynamics.driven_parameters import Parameter
from service.recording import FloatArray

NAMES = ("X1.backlash", "X1.mesh_1", "X1.coulomb")
T, N, L = 3, 30, 2
WIDTH, COARSER = 0.25, 0.2
"""Of the mesh errors' prior, and how far the backlash of the fit with the coarser contact lies beside."""

RNG = np.random.default_rng(5)
S, OWN, NOISE = (
    RNG.standard_normal((T, N, len(NAMES))),
    RNG.standard_normal((T, N, L)),
    RNG.standard_normal((T, N)),
)
WEIGHTS = np.array([1.0, WIDTH**-2.0, 1.0])


def whole() -> FloatArray:
    """Derivatives (T·N, P + T·L) by the shared coordinates and every step's own."""
    out = np.zeros((T, N, len(NAMES) + T * L))
    out[..., : len(NAMES)] = S
    for t in range(T):
        out[t, :, len(NAMES) + t * L : len(NAMES) + (t + 1) * L] = OWN[t]
    return out.reshape(T * N, -1)


def answer(problem: Problem, points: Sequence[Point]) -> FloatArray:
    """Residuals (n, T·N) at points."""
    of_step = [S @ p.shared + np.einsum("tnl,tl->tn", OWN, p.local[:, 0]) - NOISE for p in points]
    return np.stack(of_step).reshape(len(points), -1)


def lowest(weights: FloatArray, held: float | None = None) -> tuple[float, FloatArray]:
    """The least cost and where, the first coordinate free or held, by one solve of everything."""
    J, fixed = whole(), 0.0 if held is None else held
    r, free = J[:, 0] * fixed - NOISE.ravel(), slice(0 if held is None else 1, None)
    prior = np.concatenate((weights, np.ones(T * L)))
    x = np.zeros(J.shape[1])
    x[free] = -np.linalg.solve((J.T @ J + np.diag(prior))[free, free], J[:, free].T @ r)
    x[0] = x[0] if held is None else held
    left = J @ x - NOISE.ravel()
    return 0.5 * float(left @ left + prior @ x**2), x


def beside(misfit: float = 1.0) -> Beside:
    """At the end of a fit under priors of width 1."""
    x = lowest(np.ones(3))[1]
    at = Point(x[:3], x[3:].reshape(T, 1, L))
    parameters = [Parameter(name, "m", 0.0, 1.0, logarithmic=False) for name in NAMES]
    problem = cast(Problem, SimpleNamespace(model=SimpleNamespace(parameters=parameters)))
    left = answer(problem, [at])[0].reshape(T, N)
    cleared = [s - o @ np.linalg.solve(o.T @ o + np.eye(L), o.T @ s) for s, o in zip(S, OWN, strict=True)]
    index = np.arange(N)
    steps = [Step(index, index, *of) for of in zip(left, S, OWN, cleared, strict=True)]
    information = np.eye(3) + sum(s.T @ c for s, c in zip(S, cleared, strict=True))
    fit = Linearised(problem.model, (), at, tuple(steps), np.linalg.inv(information))
    best, coarse = (
        SimpleNamespace(
            problem=problem, fit=SimpleNamespace(misfit=misfit, value=lambda model, name, b=b: float(b))
        )
        for b in (x[0], x[0] + COARSER)
    )
    return Beside(cast(Outcome, best), fit, WIDTH, cast(Outcome, coarse))


@pytest.mark.parametrize("value", [-0.7, -0.1, 0.3, 1.5])
def test_a_linear_problem_costs_what_one_solve_of_everything_says(
    value: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Under the narrower prior of the mesh error, and without fitting again."""
    monkeypatch.setattr(model_fit_beside, "residuals_at", answer)
    wanted = lowest(WEIGHTS, value)[0] - lowest(WEIGHTS)[0]
    assert beside().rise(0, value) == pytest.approx(wanted, rel=1e-9, abs=1e-9)


def test_where_the_answer_changes_its_kind_everything_is_fitted_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Beyond 0.5 the backlash changes nothing any more."""

    def ending(problem: Problem, points: Sequence[Point]) -> FloatArray:
        near = [Point(np.minimum(p.shared, [0.5, np.inf, np.inf]), p.local) for p in points]
        return answer(problem, near)

    monkeypatch.setattr(model_fit_beside, "residuals_at", ending)
    monkeypatch.setattr(Beside, "fitted", lambda self, k, value: 100.0 + value)
    monkeypatch.setattr(Beside, "narrow", SimpleNamespace(fit=SimpleNamespace(cost=100.0)))
    assert beside().rise(0, 3.0) == pytest.approx(3.0 + COARSER), "as far from the coarser fit's own value"
    monkeypatch.undo()
    monkeypatch.setattr(model_fit_beside, "residuals_at", ending)
    assert beside(2.0).rise(0, 3.0) > 0.0, "where more than noise is left nothing is fitted again"
