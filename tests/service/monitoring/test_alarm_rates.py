"""What the alarm costs and what it buys: false alarms per axis-year, and nights until a change is seen."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from service.monitoring.alarm import AlarmKind, AlarmRule, Band, judge, outside
from service.monitoring.trend import levels

NIGHTS = 365
BAND = Band(reference=57e-6, tolerance=15e-6)


def noise(rng: np.random.Generator, sigma: float, rho: float, nights: int) -> NDArray[np.float64]:
    """Noise [m] of the standard deviation sigma, AR(1) with rho: a machine that is warm or cold for days."""
    found = np.empty(nights)
    found[0] = rng.normal(0, sigma)
    kicks = rng.normal(0, sigma * np.sqrt(1 - rho**2), nights)
    for k in range(1, nights):
        found[k] = rho * found[k - 1] + kicks[k]
    return found


def first_alarm(b: NDArray[np.float64], rule: AlarmRule) -> int | None:
    """Index of the value after which an alarm is first raised."""
    level = levels(b, rule.window)
    raised = [_first_raise(outside(level, BAND, kind), rule) for kind in AlarmKind if "backlash" in kind]
    return min((n for n in raised if n is not None), default=None)


def _first_raise(beyond: NDArray[np.bool_], rule: AlarmRule) -> int | None:
    beyond[: rule.minimum - 1] = False
    both = np.flatnonzero(beyond[1:] & beyond[:-1]) + 1
    return int(both[0]) if both.size else None


def alarmed_years(sigma: float, rho: float, years: int) -> float:
    rng = np.random.default_rng(2026)
    histories = (BAND.reference + noise(rng, sigma, rho, NIGHTS) for _ in range(years))
    return sum(first_alarm(b, AlarmRule()) is not None for b in histories) / years


def test_the_simulation_decides_as_the_product_does() -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        b = BAND.reference + noise(rng, 12e-6, 0.6, 60)
        raised = next((n for n in range(60) if judge(np.arange(n + 1.0), b[: n + 1], BAND).changes), None)
        assert raised == first_alarm(b, AlarmRule())


@pytest.mark.parametrize(
    ("sigmas", "rho", "bound"),
    [
        (3.0, 0.0, 0.005),
        (3.0, 0.6, 0.02),
        (2.0, 0.0, 0.02),
    ],
)
def test_false_alarms_per_axis_year(sigmas: float, rho: float, bound: float) -> None:
    """A tolerance of three standard deviations of one night's value, or of two, and nothing ever changes.

    For comparison: one value beyond 3 sigma is an alarm in 62 % of axis-years.
    """
    assert alarmed_years(BAND.tolerance / sigmas, rho, years=400) <= bound


def test_a_single_value_limit_would_alarm_in_most_years() -> None:
    """The same simulation on bare values gives the 62 % that are computed by hand: 1 - 0.9973^365."""
    rng = np.random.default_rng(2026)
    sigma = BAND.tolerance / 3
    hits = [bool((np.abs(noise(rng, sigma, 0.0, NIGHTS)) > BAND.tolerance).any()) for _ in range(400)]
    assert np.mean(hits) == pytest.approx(1 - 0.9973**365, abs=0.08)


def test_a_jump_beyond_the_band_is_seen_after_six_nights() -> None:
    rng = np.random.default_rng(8)
    delays = []
    for _ in range(200):
        b = BAND.reference + noise(rng, 1e-6, 0.0, 80)
        b[40:] += 25e-6
        found = first_alarm(b, AlarmRule())
        assert found is not None
        delays.append(found - 40 + 1)
    assert max(delays) == 6


def test_wear_is_seen_within_a_week_of_leaving_the_band() -> None:
    rng = np.random.default_rng(9)
    delays = []
    for _ in range(200):
        truth = BAND.reference + np.maximum(0, np.arange(200) - 50) * 0.25e-6
        b = truth + noise(rng, 1e-6, 0.0, 200)
        found = first_alarm(b, AlarmRule())
        assert found is not None
        left = int(np.argmax(truth > BAND.reference + BAND.tolerance))
        delays.append(found - left)
    assert np.median(delays) <= 7
    assert np.percentile(delays, 95) <= 10
