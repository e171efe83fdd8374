"""The scatter of an axis' values, and the tolerance that it leaves room for."""

from __future__ import annotations

import numpy as np
import pytest

from service.monitoring.repeatability import repeatability, tolerance_hint

SIGMA = 0.5e-6


def values(n: int, drift: float = 0.0) -> np.ndarray:
    noise = np.random.default_rng(3).normal(0.0, SIGMA, n)
    return 57e-6 + noise + drift * np.arange(n)


def test_it_is_the_standard_deviation_of_a_value() -> None:
    assert repeatability(values(4000)) == pytest.approx(SIGMA, rel=0.05)


def test_wear_and_a_wild_value_do_not_count() -> None:
    """A drift of a tenth of a standard deviation a night, and one night in fifty 30 µm off."""
    drifting = values(4000, drift=0.1 * SIGMA)
    drifting[::50] += 30e-6
    assert repeatability(drifting) == pytest.approx(SIGMA, rel=0.1)


def test_of_a_few_values_nothing_is_said() -> None:
    assert repeatability(values(5)) is None
    assert tolerance_hint(10e-6, None) is None
    assert tolerance_hint(None, SIGMA) is None


def test_a_tolerance_within_three_standard_deviations_is_named_with_one_that_is_not() -> None:
    assert tolerance_hint(3.0 * SIGMA, SIGMA) is None
    hint = tolerance_hint(1.0e-6, SIGMA)
    assert hint is not None
    assert "set tolerance_um to 1.5 or more" in hint
