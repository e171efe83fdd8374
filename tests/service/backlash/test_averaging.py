"""The mean of the steps, its interval, and steps that do not belong."""

from __future__ import annotations

import numpy as np
import pytest

from service.backlash.averaging import StepValue, average, too_few, unsure
from service.backlash.results import Reason, StepResult


def values(*b: float, below: float = 0.0, above: float = 0.0) -> list[StepValue]:
    return [StepValue(x, x - below, x + above) for x in b]


def test_the_interval_is_students_around_the_mean() -> None:
    """For 1, 2, 3, 4, 5: mean 3, s = √2.5, t(0.975, 4) = 2.776 (tables)."""
    found = average(values(1.0, 2.0, 3.0, 4.0, 5.0))
    half = 2.776 * np.sqrt(2.5) / np.sqrt(5)
    assert found.b == pytest.approx(3.0)
    assert found.interval_95 == pytest.approx((3.0 - half, 3.0 + half), rel=1e-3)


def test_what_is_alike_in_every_step_is_not_averaged_away() -> None:
    found = average(values(*[50e-6] * 10, below=3e-6, above=5e-6))
    assert found.interval_95 == pytest.approx((47e-6, 55e-6))


def test_an_outlier_is_not_averaged() -> None:
    found = average(values(50.0, 51.0, 49.0, 50.5, 90.0))
    assert found.kept == (True, True, True, True, False)
    assert found.b == pytest.approx(50.125)


def test_the_interval_covers_95_percent_of_normal_steps() -> None:
    draws = np.random.default_rng(2).normal(50.0, 1.0, (2000, 10))
    intervals = [average(values(*row)).interval_95 for row in draws]
    covered = np.mean([low <= 50.0 <= high for low, high in intervals])
    assert 0.93 < covered < 0.97


@pytest.mark.parametrize(
    ("steps", "reason"),
    [
        (values(-1.0, -1.0, -1.0), Reason.GAP_NOT_CROSSED),
        (values(50.0, 50.0, 50.0, below=60.0, above=60.0), Reason.INTERVAL_TOO_WIDE),
        (values(50.0, 20.0, 90.0, 40.0, 70.0, 30.0, 80.0, 50.0, 60.0, 20.0), Reason.STEPS_DISAGREE),
        (values(50.0, 50.0, 50.0), None),
    ],
)
def test_a_mean_that_the_steps_do_not_support_is_refused(
    steps: list[StepValue], reason: Reason | None
) -> None:
    refusal = unsure(average(steps))
    assert (refusal.reason if refusal else None) is reason


def test_the_axis_takes_the_reason_that_most_steps_share() -> None:
    lost = [StepResult(i, 1, "refused", Reason.FRAME_LOSS, "lost") for i in range(7)]
    other = [StepResult(7, 1, "refused", Reason.NO_RELEASE, "none")]
    assert too_few([*lost, *other]).reason is Reason.FRAME_LOSS
    assert too_few([lost[0], *other]).reason is Reason.TOO_FEW_STEPS
