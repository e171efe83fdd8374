"""Intervals from held values: of a fit that is a parabola, and of one that says nothing on one side."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from service.backlash.model_fit_profile import widened


def at_50(rise: Callable[[float], float]) -> Callable[[float], float]:
    """A rise over the distance [µm] from 50 µm as one over the value [m]."""
    return lambda value: rise((value - 50e-6) * 1e6)


def test_a_parabola_keeps_its_interval() -> None:
    parabola = at_50(lambda d: 0.5 * (d / 0.4) ** 2)
    half = 1.96 * 0.4e-6
    assert widened(parabola, 50e-6, half, 1.0) == pytest.approx((50e-6, half), rel=0.02)


def test_an_interval_that_is_wider_than_the_likelihoods_is_kept() -> None:
    steep = at_50(lambda d: 0.5 * (d / 0.1) ** 2)
    assert widened(steep, 50e-6, 2e-6, 1.0) == pytest.approx((50e-6, 2e-6))


def test_one_that_is_too_narrow_becomes_the_likelihoods() -> None:
    value, half = widened(at_50(lambda d: 0.5 * (d / 2.0) ** 2), 50e-6, 0.5e-6, 1.0)
    assert value == pytest.approx(50e-6, abs=0.05e-6)
    assert half == pytest.approx(1.96 * 2e-6, rel=0.05)


def test_a_side_that_says_nothing_is_held_and_the_value_is_the_middle() -> None:
    """A steep wall below, above it a level that is no less likely up to a wall 8 µm away."""
    walls = at_50(lambda d: 50.0 if d < -0.2 or d > 8.0 else 0.0)
    value, half = widened(walls, 50e-6, 1e-6, 1.0)
    assert value + half > 50e-6 + 6e-6
    assert value - half <= 50e-6 - 1e-6
    assert value > 52e-6


def test_residuals_as_large_as_they_are_widen_it() -> None:
    parabola = at_50(lambda d: 0.5 * (d / 0.5) ** 2)
    narrow, wide = (widened(parabola, 50e-6, 0.3e-6, misfit)[1] for misfit in (1.0, 4.0))
    assert wide == pytest.approx(2.0 * narrow, rel=0.05)


def test_no_gap_below_nothing_is_tried() -> None:
    tried: list[float] = []

    def rise(value: float) -> float:
        tried.append(value)
        return 0.0

    widened(rise, 50e-6, 20e-6, 1.0)
    assert np.min(tried) > 0.0


def test_few_values_are_held_where_each_costs_a_fit() -> None:
    """The narrower the interval began, the larger the strides."""
    for half, most in ((1.96, 4), (0.2, 8)):
        tried: list[float] = []

        def rise(value: float, tried: list[float] = tried) -> float:
            tried.append(value)
            return 0.5 * (value - 50e-6) ** 2 / 1e-12

        found = widened(rise, 50e-6, half * 1e-6, 1.0)
        assert found == pytest.approx((50e-6, 1.96e-6), rel=0.1)
        assert len(tried) <= most
