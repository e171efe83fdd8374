"""Intervals from held values: of a fit that is a parabola, and of one that says nothing on one side."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from service.backlash import model_fit_profile
from service.backlash.model_fit_profile import widened


def outcome(misfit: float = 1.0) -> SimpleNamespace:
    """A fit of 50 µm at a cost of 100."""
    return SimpleNamespace(
        problem=SimpleNamespace(model=None),
        fit=SimpleNamespace(value=lambda model, name: 50e-6, cost=100.0, misfit=misfit),
    )


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[float], float]], None]:
    """Put a cost over the distance [µm] from the fit's value."""

    def put(fall: Callable[[float], float]) -> None:
        monkeypatch.setattr(
            model_fit_profile, "cost_held", lambda o, name, value: 100.0 + fall((value - 50e-6) * 1e6)
        )

    return put


def test_a_parabola_keeps_its_interval(held: Callable[[Callable[[float], float]], None]) -> None:
    held(lambda d: 0.5 * (d / 0.4) ** 2)
    assert widened(outcome(), "X1.backlash", 1.96 * 0.4e-6) == pytest.approx((50e-6, 1.96 * 0.4e-6), rel=0.02)


def test_an_interval_that_is_wider_than_the_likelihoods_is_kept(
    held: Callable[[Callable[[float], float]], None],
) -> None:
    held(lambda d: 0.5 * (d / 0.1) ** 2)
    assert widened(outcome(), "X1.backlash", 2e-6) == pytest.approx((50e-6, 2e-6))


def test_one_that_is_too_narrow_becomes_the_likelihoods(
    held: Callable[[Callable[[float], float]], None],
) -> None:
    held(lambda d: 0.5 * (d / 2.0) ** 2)
    value, half = widened(outcome(), "X1.backlash", 0.5e-6)
    assert value == pytest.approx(50e-6, abs=0.05e-6)
    assert half == pytest.approx(1.96 * 2e-6, rel=0.05)


def test_a_side_that_says_nothing_is_held_and_the_value_is_the_middle(
    held: Callable[[Callable[[float], float]], None],
) -> None:
    """A steep wall below, above it a level that is no less likely up to a wall 8 µm away."""
    held(lambda d: 50.0 if d < -0.2 or d > 8.0 else 0.0)
    value, half = widened(outcome(), "X1.backlash", 1e-6)
    assert value + half > 50e-6 + 6e-6
    assert value - half <= 50e-6 - 1e-6
    assert value > 52e-6


def test_residuals_as_large_as_they_are_widen_it(held: Callable[[Callable[[float], float]], None]) -> None:
    held(lambda d: 0.5 * (d / 0.5) ** 2)
    narrow, wide = (widened(outcome(misfit), "X1.backlash", 0.3e-6)[1] for misfit in (1.0, 4.0))
    assert wide == pytest.approx(2.0 * narrow, rel=0.05)


def test_no_gap_below_nothing_is_tried(held: Callable[[Callable[[float], float]], None]) -> None:
    tried: list[float] = []

    def fall(d: float) -> float:
        tried.append(d)
        return 0.0

    held(fall)
    widened(outcome(), "X1.backlash", 20e-6)
    assert np.min(tried) > -50.0
