"""Whole moves as a problem of output error: what is expected of residuals, and what a prediction may see."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.optimize import minimize

from service.backlash.expected_errors import WAYS, expected_errors, speed_errors, wander_of
from service.backlash.moves import Moves, moves_of, sensor_zero
from service.backlash.moves_begun import begun_anew, shared_at
from service.backlash.moves_fit import (
    Fitted,
    Point,
    as_alike_moves,
    best_of_each,
    every,
    fit,
    found_again,
    jacobian,
    limits,
    reconstructed,
    rests_found,
    rms_of_moves,
    settle_locally,
    stopped,
    within,
    zeros_alike,
)
from service.backlash.moves_predicted import REST_SPREAD, predict, residuals
from service.backlash.rest_noise import noise_at_rest, sample_noise
from service.backlash.signals import summed
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_guide import DrivenConstantForce, DrivenStribeckFriction
from service.dynamics.effects.driven_library import DRIVEN
from service.identification.held_out import told_by_train
from service.identification.moves_end import steady
from service.identification.scene import smeared
from service.recording import FloatArray, Recording, Trace
from tests.service.identification.with_a_clearance import with_a_clearance


def test_residuals_of_speed_fade_by_their_share_and_stay_white_ones_of_one() -> None:
    impulse = np.zeros((2, 5))
    impulse[1, 1] = 1.0
    faded = np.sqrt(1.0 - 0.8**2) * 0.8 ** np.arange(4)
    np.testing.assert_allclose(summed(impulse, 0.8)[1], [0.0, *faded], rtol=1e-12)
    np.testing.assert_array_equal(summed(impulse, 0.8)[0], 0.0)
    noise = np.random.default_rng(8).normal(0.0, 1.0, 200_000)
    assert np.std(summed(noise, 0.95)) == pytest.approx(1.0, abs=0.03)


def test_a_noisier_drive_makes_larger_errors_expected(
    captures: tuple[Recording, Recording], found: Fitted
) -> None:
    train, rng = captures[0], np.random.default_rng(5)
    speed = train.traces["X1", "motor_speed"]
    noisy = Trace(speed.time, speed.value + 0.05 * rng.standard_normal(len(speed)))
    loud = moves_of(replace(train, traces={**train.traces, ("X1", "motor_speed"): noisy}), ("X1",))
    quiet = found.moves[0]
    assert sample_noise(noisy, train) == pytest.approx(0.05, rel=0.1)
    spreads = [
        expected_errors(m, found.model, found.at.shared, found.at.local[0], fitted=True)[0]
        for m in (quiet, loud)
    ]
    assert np.all(spreads[0] >= 1.0)
    assert np.mean(spreads[1]) > 2.0 * np.mean(spreads[0])


def test_the_errors_of_single_samples_add_up_to_the_error_of_all(
    captures: tuple[Recording, Recording],
) -> None:
    """A spline is linear in its samples: one standard deviation on all of them is a speed that is off by as much."""
    moves, speed = moves_of(captures[0], ("X1",)), captures[0].traces["X1", "motor_speed"]
    moves = replace(moves, noise_left=(np.ones(len(speed)),))
    together = speed_errors(moves, 0, 0.0).sum(axis=0)[0]
    off = sample_noise(speed, captures[0]) * captures[0].axis("X1").transmission
    np.testing.assert_allclose(together[:, 1], off, rtol=1e-9)
    np.testing.assert_allclose(together[:, 0], off * moves.h * np.arange(moves.samples), atol=1e-15)


def test_a_wander_of_a_few_ways_is_whitened_to_the_identity() -> None:
    """(I − C·Cᵀ)·D^(−1/2) makes the covariance D + G·Gᵀ white, for any G of as few ways as are kept."""
    rng = np.random.default_rng(8)
    shape = (1, 1, 40)
    used = np.ones(shape, dtype=bool)
    used[..., 7] = False
    together = 3.0 * rng.standard_normal((WAYS, *shape)) * used
    beside = 1.0 + rng.random(shape)
    wander = wander_of(together, beside, used)
    columns = np.concatenate(
        (together, np.sqrt(beside)[0, 0, :, None, None, None] * np.eye(40)[:, None, None, :])
    )
    columns = np.where(used, columns, np.nan)
    white = wander.whitened(columns, used)[:, 0, 0]
    np.testing.assert_allclose(white.T @ white, np.diag(used[0, 0].astype(float)), atol=1e-9)
    columns[..., 8] = np.nan
    assert np.all(
        np.isnan(wander.whitened(columns, used)[..., used[0, 0]])
    )  # a simulation that ran away stays one


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


def test_no_fit_leaves_the_values_that_its_numbers_have(found: Fitted) -> None:
    k = [p.name for p in found.model.parameters].index("X1.smear")
    shared = found.at.shared.copy()
    shared[k] = -3.0
    begun = Point(shared, found.at.local)
    assert within(found.model, begun).shared[k] == limits(found.model)[k, 0] == 0.0
    fitted = fit(found.moves, found.model, begun, 4)
    assert fitted.at.shared[k] >= 0.0
    gradient = np.zeros(len(shared) + 1)
    gradient[k] = 1.0
    free = every(found.model)
    assert stopped(found.model, within(found.model, begun), free, gradient)[k]
    assert not stopped(found.model, within(found.model, begun), free, -gradient)[k]


def test_a_fit_that_was_ended_early_and_its_motion_go_on_until_they_agree(
    captures: tuple[Recording, Recording], found: Fitted
) -> None:
    """Coulomb and viscous friction traded for one another as far as the gap's crossing does not tell them apart."""
    names = [p.name for p in found.model.parameters]
    moves = tuple(
        replace(m, wander=expected_errors(m, found.model, found.at.shared, own, fitted=True)[1])
        for m, own in zip(found.moves, found.at.local, strict=True)
    )
    shared = found.at.shared.copy()
    shared[names.index("X1.coulomb")] += 0.2
    shared[names.index("X1.viscous")] -= 0.2
    off = fit(moves, found.model, Point(shared, found.at.local), 0)
    ends = [steady(one) for one in (off, Fitted(found.model, moves, found.at, found.r, found.free))]
    for name in ("X1.coulomb", "X1.viscous", "X1.backlash"):
        k = names.index(name)
        spread = np.sqrt(told_by_train(ends[0])[k, k])
        assert ends[0].at.shared[k] == pytest.approx(ends[1].at.shared[k], abs=0.3 * spread), name
    assert not any(m.white for one in ends for m in one.moves)


def test_noise_at_rest_counts_neither_a_swing_nor_impacts(captures: tuple[Recording, Recording]) -> None:
    train, rng = captures[0], np.random.default_rng(3)
    time = train.traces["X1", "acceleration"].time
    swinging = 2.0 * np.sin(2 * np.pi * 15.0 * time) + 0.03 * rng.standard_normal(len(time))
    swinging[::200] += 5.0
    assert noise_at_rest(Trace(time, swinging), train) == pytest.approx(0.03, rel=0.08)


def test_a_sensors_zero_is_found_beside_a_machine_that_swings_in_the_rests(
    captures: tuple[Recording, Recording],
) -> None:
    """An axis that stands at the beginning and at the end has no mean acceleration, whatever it did between."""
    train, rng = captures[0], np.random.default_rng(8)
    time = train.traces["X1", "acceleration"].time
    along = (time - time[0]) / (time[-1] - time[0])
    speed = along**2 * (1.0 - along) ** 2 * np.sin(2 * np.pi * 11.0 * time)
    swinging = 0.07 + np.gradient(speed, time) + 0.03 * rng.standard_normal(len(time))
    resting = 0.07 + 0.03 * rng.standard_normal(len(time))
    assert sensor_zero(Trace(time, swinging), train, 0.03) == pytest.approx(0.07, abs=0.001)
    assert sensor_zero(Trace(time, resting), train, 0.03) == pytest.approx(0.07, abs=0.001)


def test_smearing_keeps_area_and_place_and_has_its_spread() -> None:
    pulse = np.zeros((1, 1, 101))
    pulse[..., 50] = 1.0
    passed = smeared(pulse, np.array([1.5]))[0, 0]
    k = np.arange(101)
    assert passed.sum() == pytest.approx(1.0)
    assert passed @ k == pytest.approx(50.0, abs=1e-6)
    assert np.sqrt(passed @ (k - 50.0) ** 2) == pytest.approx(1.5, rel=0.01)


def test_no_motor_follows_a_fit_that_ran_away(found: Fitted, monkeypatch: pytest.MonkeyPatch) -> None:
    """Taking an effect out of a model can leave a machine that cannot be simulated."""
    monkeypatch.setattr("service.dynamics.driven.Course.force", lambda _course: np.full((1, 1, 1, 1), np.nan))
    assert all(now is before for now, before in zip(reconstructed(found), found.moves, strict=True))


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


def test_the_better_start_is_kept_for_every_move(found: Fitted) -> None:
    worse = found.at.local[0].copy()
    worse[::2, 0] += 0.05
    other = fit(found.moves, found.model, replace(found.at, local=(worse,)), 0)
    mixed = best_of_each((other, fit(found.moves, found.model, found.at, 0)))
    np.testing.assert_allclose(mixed.local[0][::2], found.at.local[0][::2])
    alike = as_alike_moves(found).local[0]
    for s in (1.0, -1.0):
        of = alike[found.moves[0].s == s]
        np.testing.assert_allclose(of, np.tile(of[0], (len(of), 1)))


def test_every_move_begins_like_the_best_described_one_of_its_direction(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        "service.backlash.moves_fit.costs_of_moves", lambda *_: np.array([9.0, 2.0, 1.0, 5.0])
    )
    few = SimpleNamespace(s=np.array([-1.0, 1.0, -1.0, 1.0]))
    local = np.array([[0.1], [0.2], [0.3], [0.4]])
    found = SimpleNamespace(moves=(few,), at=SimpleNamespace(local=(local,)))
    every = SimpleNamespace(s=np.array([1.0, -1.0, 1.0]))
    (own,) = zeros_alike(cast(Any, (every,)), cast(Any, found))
    assert own[:, 0].tolist() == [0.2, 0.3, 0.2]


def test_only_zeros_are_found_again() -> None:
    model = Model(
        ("X1",), 2, tuple(kind(("X1",)) for kind in DRIVEN.values() if kind.name != "gantry_coupling")
    )
    names = {model.parameters[k].name for k in found_again(model)}
    assert names == {"X1.ripple_phase"}
    assert len(every(model)) == len(model.parameters)


def test_a_pinion_that_rested_at_the_far_side_of_its_gap_is_found_there(found: Fitted) -> None:
    clearance = 0.6 * found.value("X1.backlash")
    model, at = with_a_clearance(found, clearance)
    (part,), own = found.moves, at.local[0].copy()
    own[:, 2] = -0.5 * clearance / model.nuisance[0].spread
    said = predict(part, model, at.shared[None], own[None]).acceleration()[0]
    made = replace(
        part,
        grids=tuple(replace(g, measured=said[t]) for t, g in enumerate(part.grids)),
        expected=part.expected,
    )
    again = rests_found([made], model, Point(at.shared, (np.zeros_like(own),))).local[0]
    assert np.mean(again[:, 2] == own[0, 2]) >= 0.8


def test_a_move_that_begins_at_the_wrong_flank_stands_out_and_is_begun_anew(found: Fitted) -> None:
    """It alone: all others, and all shared numbers, are where they were. Where none stands out, all are."""
    held = np.zeros(0, dtype=np.int64)
    own = fit(found.moves, found.model, found.at, 8, free=held)
    assert begun_anew(own) is own
    local = own.at.local[0].copy()
    local[3, 0] += found.value("X1.backlash") / REST_SPREAD[0]
    wrong = fit(found.moves, found.model, Point(own.at.shared, (local,)), 0)
    assert rms_of_moves(wrong)[3] > 3.0 * rms_of_moves(own)[3]
    again = begun_anew(wrong)
    np.testing.assert_allclose(rms_of_moves(again), rms_of_moves(own), rtol=0.05)
    np.testing.assert_array_equal(again.at.shared, own.at.shared)
    np.testing.assert_array_equal(again.free, wrong.free)


def test_an_amount_has_no_limit_that_a_machine_may_reach(found: Fitted) -> None:
    """Five metres per second squared of breakaway, or a vertical axis' weight; a chain stays within its prior."""
    for kind, name, value in (
        (DrivenStribeckFriction, "breakaway", 5.0),
        (DrivenConstantForce, "constant_force", 9.81),
    ):
        effect = kind(("X1",))
        model = replace(found.model, effects=(*found.model.effects, effect))
        shared = shared_at(model, {f"X1.{name}": value, "X1.gear_mass": 1e6})
        numbers = model.numbers(within(model, Point(shared, ())).shared)
        assert numbers[f"X1.{name}"] == pytest.approx(value)
        gear = next(p for p in model.parameters if p.name == "X1.gear_mass")
        assert numbers["X1.gear_mass"] == pytest.approx(float(gear.value(5.0)))
