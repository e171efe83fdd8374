"""The trend: its robustness, and that its interval covers what it says."""

from __future__ import annotations

import numpy as np
import pytest

from service.monitoring.trend import levels, median_interval, median_rank, trend

DAY = 86_400.0


@pytest.mark.parametrize(
    ("n", "rank"), [(1, None), (5, None), (6, 1), (8, 1), (9, 2), (11, 2), (12, 3), (15, 4), (20, 6)]
)
def test_ranks_are_those_of_the_binomial_table(n: int, rank: int | None) -> None:
    """The ranks of the two-sided 5 % sign test, as printed in tables (Conover, table A3)."""
    assert median_rank(n) == rank


def test_interval_covers_the_median_of_a_skewed_distribution() -> None:
    rng = np.random.default_rng(11)
    samples = rng.exponential(size=(4000, 9))
    covered = 0
    for sample in samples:
        low, high = median_interval(sample) or (np.nan, np.nan)
        covered += low <= np.log(2.0) <= high
    # 1 - 2 (1 + 9) / 2^9 = 0.9609; four standard errors of 4000 trials are 0.012.
    assert covered / len(samples) == pytest.approx(0.9609, abs=0.0125)


def test_one_wild_value_moves_neither_level_nor_interval_by_much() -> None:
    b = np.array([50.0, 51.0, 49.0, 50.5, 49.5, 50.2, 49.8, 50.1, 49.9]) * 1e-6
    wild = b.copy()
    wild[4] = 500e-6
    t = np.arange(9) * DAY
    calm, shaken = trend(t, b), trend(t, wild)
    assert calm is not None
    assert shaken is not None
    assert abs(shaken.level - calm.level) <= 0.2e-6
    assert shaken.interval is not None
    assert shaken.interval[1] < 52e-6


def test_levels_agree_with_the_trend_of_every_prefix() -> None:
    b = np.random.default_rng(3).normal(60e-6, 1e-6, 25)
    t = np.arange(25) * DAY
    for n in range(1, 26):
        now = trend(t[:n], b[:n])
        assert now is not None
        assert levels(b)[n - 1] == now.level
        assert now.count == min(n, 9)


def test_slope_finds_wear_among_outliers() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(40) * DAY
    b = 50e-6 + 0.3e-6 * t / DAY + rng.normal(0, 0.5e-6, 40)
    b[[7, 21, 33]] += 80e-6
    now = trend(t, b)
    assert now is not None
    assert now.slope is not None
    assert now.slope * DAY == pytest.approx(0.3e-6, abs=0.03e-6)
    assert now.slope_interval is not None
    assert now.slope_interval[0] < 0.3e-6 / DAY < now.slope_interval[1]


def test_nine_checks_in_an_hour_state_no_slope() -> None:
    now = trend(np.arange(9) * 300.0, np.linspace(50e-6, 60e-6, 9))
    assert now is not None
    assert now.slope is None


def test_an_empty_history_has_no_trend() -> None:
    assert trend(np.array([]), np.array([])) is None


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_value_that_is_no_number_is_refused(bad: float) -> None:
    with pytest.raises(ValueError, match="not finite"):
        trend(np.array([0.0, 1.0]), np.array([5e-5, bad]))


def test_times_and_values_must_match() -> None:
    with pytest.raises(ValueError, match="one time per value"):
        trend(np.arange(3.0), np.full(4, 5e-5))
