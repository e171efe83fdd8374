"""The fit of a model to moves: its slopes, and the coordinates that every move has of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from service.backlash.moves import Moves
from service.backlash.moves_fit import Fitted, fit, jacobian, settle_locally
from service.backlash.moves_point import Point, every, limits
from service.backlash.moves_predicted import predict, residuals
from service.recording import FloatArray


def test_slopes_are_those_of_a_point_and_not_of_a_way(found: Fitted) -> None:
    """Where slopes of many numbers cancel along a valley, a hundredth of them is a wall."""
    k = [p.name for p in found.model.parameters].index("X1.backlash")
    J = jacobian(found.moves, found.model, found.at, every(found.model))[1].shared[:, k]
    sides = []
    for step in (1e-6, -1e-6):
        shared = found.at.shared.copy()
        shared[k] += step
        sides.append(fit(found.moves, found.model, Point(shared, found.at.local), 0).r)
    central = (sides[0] - sides[1]) / 2e-6
    assert np.linalg.norm(J - central) < 3e-5 * np.linalg.norm(central)


def test_a_number_at_its_limit_has_the_slope_that_leads_away_from_it(found: Fitted) -> None:
    k = [p.name for p in found.model.parameters].index("X1.smear")
    limit = limits(found.model)[k]
    shared = found.at.shared.copy()
    shared[k] = limit[1]
    inside = shared.copy()
    inside[k] -= 1e-3
    at, near = (Point(u, found.at.local) for u in (shared, inside))
    free = np.array([k])
    slope, close = (jacobian(found.moves, found.model, one, free)[1].shared[:, 0] for one in (at, near))
    assert np.linalg.norm(close) > 1.0
    np.testing.assert_allclose(slope, close, atol=0.02 * np.linalg.norm(close))


def test_each_move_is_settled_by_itself(found: Fitted) -> None:
    """One move begun badly is brought back without moving the others."""
    local = found.at.local[0].copy()
    local[3, 0] += 0.02
    at = replace(found.at, local=(local,))
    moves: Moves = found.moves[0]
    r = residuals(moves, predict(moves, found.model, at.shared[None], at.local[0][None]))[0]
    for _ in range(4):
        at, r = settle_locally(found.moves, found.model, at, 1.0, r)
    course = predict(moves, found.model, at.shared[None], at.local[0][None])
    assert np.allclose(r, residuals(moves, course)[0], atol=1e-6)
    said = course.acceleration()[0]
    errors = np.where(moves.used, (moves.measured - said) / moves.noise[:, None], 0.0)
    per_move = np.sqrt(np.mean(errors**2, axis=(1, 2)))
    assert per_move[3] < 1.5 * np.median(per_move)


def test_a_move_takes_a_step_by_slopes_that_are_at_hand_only_if_it_gains(found: Fitted) -> None:
    """By those of the fit, a little off, a move is brought back; by such as lead away it stays where it is."""
    local = found.at.local[0].copy()
    local[3, 0] += 0.02
    at = replace(found.at, local=(local,))
    moves: Moves = found.moves[0]
    r = residuals(moves, predict(moves, found.model, at.shared[None], at.local[0][None]))[0]
    slopes = found.slopes.own
    away, _ = settle_locally(found.moves, found.model, at, 1.0, r, -slopes)
    np.testing.assert_array_equal(away.local[0][3], local[3])
    squares = [float(r @ r)]
    for _ in range(4):
        at, r = settle_locally(found.moves, found.model, at, 1.0, r, slopes)
        squares.append(float(r @ r))
    assert abs(at.local[0][3, 0] - found.at.local[0][3, 0]) < 0.5 * 0.02
    assert squares == sorted(squares, reverse=True)


def test_without_shared_coordinates_every_move_is_fitted_by_itself(found: Fitted) -> None:
    """Moves begun wrong by different amounts, none by so much that it would be on another flank, each end where an
    optimizer of another kind finds no better place for its coordinates."""
    moves, held = found.moves[0], np.zeros(0, dtype=np.int64)
    local = found.at.local[0] + np.linspace(-0.3, 0.3, len(moves.grids))[:, None]
    out = fit(found.moves, found.model, replace(found.at, local=(local,)), 12, free=held, tolerance=1e-3)
    np.testing.assert_array_equal(out.at.shared, found.at.shared)
    scale = max(1.0, out.rms)

    def cost(own: FloatArray, t: int) -> float:
        tried = out.at.local[0].copy()
        tried[t] = own
        r = residuals(moves, predict(moves, found.model, out.at.shared[None], tried[None]))[0]
        return 0.5 * float(np.sum(r**2) / scale**2 + np.sum(own**2))

    for t in (2, 3):
        here = out.at.local[0][t]
        better = minimize(cost, here, args=(t,), method="Nelder-Mead", options={"maxfev": 80})
        assert cost(here, t) - float(better.fun) < 0.05
