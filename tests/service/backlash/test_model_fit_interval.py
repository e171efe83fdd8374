"""The interval's parts against what chance and structure really do to a weighted sum of residuals."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy.signal import lfilter

from service.backlash.model_fit_interval import (
    Linearised,
    coloured,
    difference,
    disagreement,
    gentler,
    noise_variance,
    repeating,
    structure_variance,
)
from service.recording import FloatArray

H, T, K = 5e-4, 10, 120


def influences() -> FloatArray:
    """A smooth influence with its weight at one event, as that of an impact, alike in every step (T, K)."""
    k = np.arange(K)
    return np.tile(np.exp(-(((k - 70) / 6.0) ** 2)) * np.cos(k / 9.0), (T, 1))


@pytest.mark.parametrize(("memory", "size"), [(0.0, 1.0), (0.8, 1.0), (0.8, 3.0)])
def test_variance_of_coloured_residuals_is_what_repeating_them_shows(memory: float, size: float) -> None:
    rng, psi = np.random.default_rng(3), influences()
    noise = size * np.sqrt(1.0 - memory**2) * rng.standard_normal((400, T, K + 100))
    residual = lfilter([1.0], [1.0, -memory], noise, axis=-1)[..., 100:]
    true = float(np.var(np.sum(psi * residual, axis=(1, 2))))
    told = [coloured(r, psi, H) for r in residual[:100]]
    assert np.mean(told) == pytest.approx(true, rel=0.25)


def test_lost_samples_leave_the_variance_alone() -> None:
    rng, psi = np.random.default_rng(5), influences()
    residual = rng.standard_normal((T, K))
    residual[rng.random((T, K)) < 0.1] = np.nan
    assert coloured(residual, psi, H) == pytest.approx(float(np.sum(psi**2)), rel=0.25)


def left(residual: FloatArray) -> Linearised:
    """As much of a linearised fit as its residuals (T, K) are judged by."""
    grids = [SimpleNamespace(h=H, s=(-1) ** t) for t in range(T)]
    fit = SimpleNamespace(residual=residual[:, None], grids=grids, influence=lambda k: influences()[:, None])
    return cast(Linearised, fit)


def test_noise_is_counted_once() -> None:
    """The mean of the steps holds a share of it, which is not also something that repeats."""
    rng, psi = np.random.default_rng(7), influences()
    told = [noise_variance(left(rng.standard_normal((T, K))), 0) for _ in range(100)]
    assert np.mean(told) == pytest.approx(float(np.sum(psi**2)), rel=0.25)


def test_what_repeats_in_every_step_does_not_average_out() -> None:
    rng, psi = np.random.default_rng(9), influences()
    told, true = [], []
    for _ in range(100):
        residual = rng.standard_normal((T, K)) + rng.standard_normal(K)
        told.append(noise_variance(left(residual), 0))
        true.append(float(np.sum(psi * residual)) ** 2)
    assert np.mean(told) == pytest.approx(float(np.sum(psi**2)) * (1 + T), rel=0.25)
    assert np.mean(true) == pytest.approx(float(np.sum(psi**2)) * (1 + T), rel=0.5)


def test_what_repeats_in_the_steps_of_a_direction_is_told_from_noise() -> None:
    rng = np.random.default_rng(11)
    noise = [repeating(left(rng.standard_normal((T, K)))) for _ in range(200)]
    assert np.mean(np.array(noise) > 0.0) < 0.01
    of_direction = 0.8 * rng.standard_normal((2, 4000))
    told = repeating(left(rng.standard_normal((T, 4000)) + np.tile(of_direction, (T // 2, 1))))
    assert told == pytest.approx(0.64 - 0.1, abs=0.05)


def test_lost_samples_repeat_nothing_and_a_direction_of_few_steps_does_not_count() -> None:
    rng = np.random.default_rng(13)
    residual = rng.standard_normal((T, K))
    residual[:, ::7] = np.nan
    assert repeating(left(residual)) == 0.0
    residual[::2], residual[5:] = 9.0 + residual[::2], np.nan
    assert repeating(left(residual)) == pytest.approx(81.0, rel=0.05)


def linear(influence: FloatArray, residual: FloatArray) -> Linearised:
    """As much of a linearised fit as the structure asks for; one axis, steps (T, K) to and fro."""
    grids = [SimpleNamespace(h=H, s=s) for s in np.resize((1.0, -1.0), len(residual))]
    fit = SimpleNamespace(grids=grids, residual=residual[:, None], influence=lambda k: influence[:, None])
    return cast(Linearised, fit)


def differing(power: float) -> FloatArray:
    """Residuals (T, K) beside the noise, of a mean square above it, another in every step."""
    return np.sqrt(1.0 + power) * np.random.default_rng(17).standard_normal((T, K))


def test_structure_is_none_at_the_noise_and_grows_with_the_excess() -> None:
    fit = linear(influences(), np.zeros((T, K)))
    assert structure_variance(fit, 0, 0.95) == structure_variance(fit, 0, 1.0) == 0.0
    small, large = (structure_variance(fit, 0, misfit) for misfit in (1.1, 2.0))
    assert large == pytest.approx(10.0 * small)


def test_what_the_model_lacks_does_not_average_out_as_far_as_it_repeats() -> None:
    """A lack that is alike in all steps moves the sum of T influences T times as much as one, what differs √T times."""
    rng = np.random.default_rng(18)
    noise, shape = rng.standard_normal((T, K)), 3.0 * np.sin(np.arange(K) / 5.0)
    repeats = structure_variance(linear(influences(), noise + shape), 0, 1.0 + np.mean(shape**2))
    differs = structure_variance(
        linear(influences(), differing(np.mean(shape**2))), 0, 1.0 + np.mean(shape**2)
    )
    assert repeats == pytest.approx(T * differs, rel=0.3)


def test_two_steps_of_a_direction_cannot_show_what_repeats() -> None:
    """Then all of the excess is taken to repeat."""
    few = linear(influences()[:4], differing(1.0)[:4])
    one = linear(influences()[:1], differing(1.0)[:1])
    assert structure_variance(few, 0, 2.0) == pytest.approx(16.0 * structure_variance(one, 0, 2.0))


def test_directions_that_differ_more_than_their_scatter_widen_the_interval() -> None:
    direction = np.array([1.0, -1.0] * 5)
    noise = 1e-7 * np.array([1, -1, -1, 1, 0, 0, 2, -2, -2, 2])
    alike, apart = 5e-5 + noise, 5e-5 + noise + 1e-6 * direction
    assert disagreement(alike, direction) < (0.1e-6) ** 2
    assert np.sqrt(disagreement(apart, direction)) == pytest.approx(1e-6, rel=0.05)
    found = difference(apart, direction)
    assert found.mean == pytest.approx(2e-6, rel=0.1)
    assert found.mean > 10.0 * found.error


def test_one_direction_only_says_nothing_of_a_difference() -> None:
    assert disagreement(np.array([1e-5, 2e-5, 3e-5]), np.ones(3)) == 0.0
    assert difference(np.array([1e-5, 2e-5, np.nan]), np.array([1.0, 1.0, -1.0])).error == np.inf


def test_a_jump_on_one_side_is_no_derivative() -> None:
    smooth = np.array([[5.0, -300.0], [0.2, 1500.0]])
    other = np.array([[5.2, -310.0], [0.1, 10_600.0]])
    assert gentler(smooth, other) == pytest.approx(np.array([[5.1, -305.0], [0.15, 1500.0]]))
    assert gentler(other, smooth) == pytest.approx(gentler(smooth, other))
