"""Whole moves as a problem of output error: what is expected of residuals, and what a prediction may see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from service.backlash.expected_errors import WAYS, expected_errors, speed_errors, wander_of
from service.backlash.moves import (
    REST_SPREAD,
    Moves,
    early_part,
    moves_of,
    noise_at_rest,
    predict,
    residuals,
    sample_noise,
    sensor_zero,
)
from service.backlash.moves_begun import point_at
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
    settle_locally,
    stopped,
    values_at,
    within,
)
from service.backlash.signals import summed
from service.captures import read_capture
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_library import DRIVEN
from service.dynamics.effects.driven_sensors import DrivenBias
from service.dynamics.effects.driven_transmission import (
    DrivenBentContact,
    DrivenClearance,
    DrivenLocalBacklash,
)
from service.identification.axis_numbers import backlash_of, clearance_beside, unseen_depth
from service.identification.held_out import IN_THE_GAP, TURNS, held_out, rms, told_by_train
from service.identification.moves_end import SUMMED, over_the_ridge, steady
from service.identification.moves_starts import ROUNDS
from service.identification.scene import ChannelTolerance, as_effects, estimator_alone, smeared
from service.recording import FloatArray, Recording, Trace


@pytest.fixture(scope="module")
def captures(request: pytest.FixtureRequest) -> tuple[Recording, Recording]:
    shared: Path = request.getfixturevalue("shared_dir")
    train, validate = (read_capture(shared / "captures" / f"none-{p}.parquet") for p in ("train", "validate"))
    return train, validate


@pytest.fixture(scope="module")
def found(captures: tuple[Recording, Recording]) -> Fitted:
    """The declared model at the estimator's values, only briefly fitted."""
    train = captures[0]
    model = Model(("X1",), 2, (ChannelTolerance(("X1",)),), "whole_move", ("constant", "skew"), bridge=False)
    moves = [moves_of(train, ("X1",))]
    place = as_effects(estimator_alone(train, "X1"), ("X1",))
    return fit(moves, model, point_at(model, place, moves), 4)


def altered(recording: Recording, from_share: float) -> Recording:
    """The recording with nonsense in the acceleration of every move from a share of it on."""
    trace = recording.traces["X1", "acceleration"]
    value = trace.value.copy()
    for move in recording.moves:
        late = (trace.time > move.start + from_share * move.duration) & (trace.time <= move.end)
        value[late] = 3.0
    return replace(recording, traces={**recording.traces, ("X1", "acceleration"): Trace(trace.time, value)})


def test_residuals_of_speed_fade_by_their_share_and_stay_white_ones_of_one() -> None:
    impulse = np.zeros((2, 5))
    impulse[1, 1] = 1.0
    faded = np.sqrt(1.0 - 0.8**2) * 0.8 ** np.arange(4)
    np.testing.assert_allclose(summed(impulse, 0.8)[1], [0.0, *faded], rtol=1e-12)
    np.testing.assert_array_equal(summed(impulse, 0.8)[0], 0.0)
    noise = np.random.default_rng(8).normal(0.0, 1.0, 200_000)
    assert np.std(summed(noise, 0.95)) == pytest.approx(1.0, abs=0.03)


def test_a_contact_that_is_met_in_another_swing_is_found_by_the_speeds(found: Fitted) -> None:
    """Begun with a contact of two fifths of its stiffness, every impact comes late and swings too slowly."""
    names = [p.name for p in found.model.parameters]
    k = names.index("X1.contact_stiffness")
    shared = found.at.shared.copy()
    shared[k] = float(found.model.parameters[k].internal(0.4 * found.value("X1.contact_stiffness")))
    right = fit(found.moves, found.model, found.at, ROUNDS)
    other = fit(found.moves, found.model, Point(shared, found.at.local), ROUNDS)
    over = other
    for lasting in SUMMED:
        over = over_the_ridge(over, lasting)
    assert over.rms < 1.05 * right.rms
    assert over.rms < other.rms


def test_a_prediction_does_not_see_the_acceleration_that_it_predicts(
    captures: tuple[Recording, Recording], found: Fitted
) -> None:
    honest = held_out(moves_of(captures[1], ("X1",)), found)
    blind = held_out(moves_of(altered(captures[1], 0.46), ("X1",)), found)
    np.testing.assert_allclose(blind.predicted, honest.predicted, rtol=0.0, atol=1e-9)


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


def test_a_prediction_is_doubted_by_as_much_as_numbers_within_their_spread_change_it(
    captures: tuple[Recording, Recording], found: Fitted
) -> None:
    validate, rng = moves_of(captures[1], ("X1",)), np.random.default_rng(2)
    held = held_out(validate, found, thorough=False)
    known = np.linalg.cholesky(told_by_train(found) + 1e-12 * np.eye(len(found.at.shared)))
    others = []
    for _ in range(16):
        shared = found.at.shared + known @ rng.standard_normal(len(found.at.shared))
        other = replace(found, at=replace(found.at, shared=shared))
        others.append(held_out(validate, other, thorough=False).predicted - held.predicted)
    spread = np.sqrt(np.mean(np.square(others), axis=0)) / validate.noise[:, None] / validate.expected
    late = validate.used & ~early_part_mask(validate)
    expected = np.sqrt(np.mean(held.doubted[late] ** 2))
    assert np.sqrt(np.mean(spread[late] ** 2)) == pytest.approx(expected, rel=0.5)


def early_part_mask(moves: Moves) -> FloatArray:
    mask = np.zeros(moves.used.shape, dtype=bool)
    early = early_part(moves, 0.45).used
    mask[..., : early.shape[-1]] = early
    return mask


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


def test_only_zeros_are_found_again() -> None:
    model = Model(
        ("X1",), 2, tuple(kind(("X1",)) for kind in DRIVEN.values() if kind.name != "gantry_coupling")
    )
    names = {model.parameters[k].name for k in found_again(model)}
    assert names == {"X1.ripple_phase"}
    assert len(every(model)) == len(model.parameters)


def test_the_early_part_is_early(captures: tuple[Recording, Recording]) -> None:
    moves = moves_of(captures[0], ("X1",))
    part = early_part(moves, 0.45)
    for grid in part.grids:
        move = captures[0].moves[grid.index]
        assert grid.time[1:][grid.used[0]].max() <= move.start + 0.45 * move.duration


def with_a_clearance(found: Fitted, clearance: float) -> tuple[Model, Point]:
    """The model with a part of its backlash as a second gap in series."""
    model = replace(found.model, effects=(*found.model.effects, DrivenClearance(("X1",))))
    whole = found.value("X1.backlash")
    values = values_at(found) | {"X1.clearance": clearance, "X1.backlash": whole - clearance}
    return model, point_at(model, values, found.moves)


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


def test_a_held_out_move_that_is_begun_behind_the_wrong_flank_finds_where_its_load_lay(
    captures: tuple[Recording, Recording], found: Fitted, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So it does beside a sensor's zero that is found again, which else makes up for the wrong place."""
    beyond = -0.2 * found.value("X1.backlash") / REST_SPREAD[0]

    def misplaced(moves: Sequence[Moves], model: Model, at: Point, among: Sequence[float] = ()) -> Point:
        if among == (IN_THE_GAP,):
            return rests_found(moves, model, at, among)
        local = [own.copy() for own in at.local]
        for part, own in zip(moves, local, strict=True):
            own[:, 0] = part.s * beyond
        return Point(at.shared, tuple(local))

    model = replace(found.model, effects=(*found.model.effects, DrivenBias(("X1",))))
    at = Point(
        np.append(found.at.shared, 0.0), tuple(np.pad(own, ((0, 0), (0, 1))) for own in found.at.local)
    )
    wandering = fit(found.moves, model, at, 2)
    validate = moves_of(captures[1], ("X1",))
    right = rms(held_out(validate, wandering, thorough=False).weighed)
    monkeypatch.setattr("service.identification.held_out.rests_found", misplaced)
    assert rms(held_out(validate, wandering, thorough=False).weighed) == pytest.approx(right, rel=0.01)


def test_how_two_gaps_divide_their_sum_is_in_the_interval_of_the_backlash(found: Fitted) -> None:
    whole = found.value("X1.backlash")
    model, at = with_a_clearance(found, 0.4 * whole)
    both = fit(found.moves, model, at, 0)
    b, std = backlash_of(both, 0)
    assert b == pytest.approx(0.6 * whole)
    assert clearance_beside(both, 0) == pytest.approx(whole)
    assert clearance_beside(found, 0) == 0.0
    assert std > 0.25 * whole > 10.0 * backlash_of(found, 0)[1]


def test_where_a_bent_flank_begins_to_push_is_in_the_interval_of_the_backlash(found: Fitted) -> None:
    """What lies below the noise no sample shows; a straight flank begins where its line does."""
    model = replace(found.model, effects=(*found.model.effects, DrivenBentContact(("X1",))))
    k, bend, push = 6e4, 0.6, 4.0
    values = values_at(found) | {"X1.bend": bend, "X1.contact_stiffness": k}
    bent = fit(found.moves, model, point_at(model, values, found.moves), 0)
    depth = unseen_depth(bent, 0) / bend
    assert k * depth * (depth / (push / k)) ** bend == pytest.approx(found.moves[0].noise[0])
    assert backlash_of(bent, 0)[1] > 0.5 * bend * depth
    assert unseen_depth(found, 0) == 0.0


def test_a_gap_that_changes_along_the_rack_is_said_where_the_moves_cross_it(found: Fitted) -> None:
    """Its width where the recording began, and what a wave of 9 mm adds up to at 0.6 of every move."""
    model = replace(found.model, effects=(*found.model.effects, DrivenLocalBacklash(("X1",))))
    planted = {"X1.gap_slope": 0.01, "X1.gap_bow": -4.0, "X1.gap_period": 9e-3}
    at = point_at(model, values_at(found) | planted, found.moves)
    (part,), kappa = found.moves, 2 * np.pi / 9e-3
    steps = [part.recording.moves[grid.index] for grid in part.grids]
    places = np.array([float(part.plain[0](step.start + 0.6 * step.duration)) for step in steps])
    size, phase = np.hypot(0.01 / kappa, 4.0 / kappa**2), np.arctan2(4.0, 0.01 * kappa)
    wider = float(np.mean(size * (np.sin(kappa * places + phase) - np.sin(phase))))
    assert abs(wider) > 1e-6
    b, std = backlash_of(fit(found.moves, model, at, 0), 0)
    assert b == pytest.approx(found.value("X1.backlash") + wider, abs=1e-10)
    assert std > backlash_of(found, 0)[1], "the wave is not known exactly, either"


@pytest.mark.parametrize(("friction", "agreed"), [(1.0, True), (9.0, False)])
def test_the_motion_in_held_out_moves_follows_the_force_until_both_agree(
    captures: tuple[Recording, Recording],
    found: Fitted,
    monkeypatch: pytest.MonkeyPatch,
    friction: float,
    agreed: bool,
) -> None:
    """Not for a model that is far from their first part: it is not the right one."""
    shared = found.at.shared.copy()
    k = [p.name for p in found.model.parameters].index("X1.coulomb")
    shared[k] = found.model.parameters[k].internal(friction * found.value("X1.coulomb"))
    follows: list[bool] = []

    def noted(one: Fitted, follow: bool = True) -> tuple[Moves, ...]:
        follows.append(follow)
        return reconstructed(one, follow)

    monkeypatch.setattr("service.identification.held_out.reconstructed", noted)
    said = held_out(moves_of(captures[1], ("X1",)), replace(found, at=Point(shared, found.at.local)))
    assert follows[:2] == [False, False]
    assert follows[2:] == [True] * len(follows[2:])
    assert bool(follows[2:]) == agreed
    assert len(follows) < TURNS
    assert (rms(said.weighed) < 1.5) == agreed
