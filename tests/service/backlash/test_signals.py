"""Placing samples, deriving, and what is known of the noise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.backlash.signals import derivative, even, running_integral, window_width
from service.recording import Trace


def test_lost_samples_are_known_and_bridged() -> None:
    time = 1e-3 * np.arange(20.0)
    keep = np.ones(20, bool)
    keep[[5, 6, 12]] = False
    placed = even(Trace(time[keep], 3.0 * time[keep]))
    assert np.flatnonzero(placed.lost).tolist() == [5, 6, 12]
    assert placed.value == pytest.approx(3.0 * time)
    assert placed.lost_between(0.004, 0.007) == 2
    assert placed.lost_between(0.007, 0.011) == 0


@given(st.floats(0.96, 1.04), st.floats(0.0, 0.2), st.integers(0, 1000))
def test_a_jittering_stamp_does_not_move_the_grid(clock: float, jitter: float, seed: int) -> None:
    """A sensor clock some percent off its rate, stamps jittering by up to a fifth of the period."""
    counter = np.arange(400.0)
    period = clock * 2.5e-4
    shaken = period * (counter + jitter * np.random.default_rng(seed).uniform(-1, 1, 400))
    placed = even(Trace(shaken, counter))
    assert placed.period == pytest.approx(period, rel=2e-3)
    assert np.max(np.abs(placed.time - period * counter)) < 0.1 * period


@pytest.mark.parametrize("width", [3, 5, 9])
def test_the_derivative_of_a_parabola_is_exact(width: int) -> None:
    time = 1e-3 * np.arange(50.0)
    found = derivative(2.0 * time**2 + time, 1e-3, width)
    inside = slice(width // 2, -(width // 2))
    assert found[inside] == pytest.approx((4.0 * time + 1.0)[inside])


def test_the_integral_of_a_ramp_is_exact() -> None:
    time = 1e-3 * np.arange(50.0)
    assert running_integral(2.0 * time, 1e-3) == pytest.approx(time**2)


def test_a_noisier_speed_gets_a_wider_window() -> None:
    """At 1 kHz a speed noise of s makes s/(1 ms·√2) with 3 samples, s/(1 ms·√10) with 5."""
    widths = [window_width(noise, 1e-3, 4.0) for noise in (0.0, 0.28e-3, 0.29e-3, 0.63e-3, 0.64e-3, 1.0)]
    assert widths == [3, 3, 5, 5, 7, 9]
