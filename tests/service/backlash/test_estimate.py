"""Which of two methods' answers counts."""

from __future__ import annotations

import pytest

from service.backlash.estimate import best
from service.backlash.results import AxisResult, Reason

PLAIN = AxisResult("X1", "ok", "paper", backlash=50e-6, interval_95=(45e-6, 55e-6))
FIT = AxisResult("X1", "ok", "model_fit", backlash=51e-6, interval_95=(50.8e-6, 51.2e-6))


def refused(method: str, reason: Reason) -> AxisResult:
    return AxisResult("X1", "refused", method, reason, "why")


IN_DOUBT = refused("paper", Reason.SENSORS_IN_DOUBT)


@pytest.mark.parametrize(
    ("plain", "fit", "counts"),
    [
        (PLAIN, FIT, FIT),
        (IN_DOUBT, FIT, FIT),
        (PLAIN, refused("model_fit", Reason.TOO_FEW_STEPS), PLAIN),
        (PLAIN, refused("model_fit", Reason.MISFIT), refused("model_fit", Reason.MISFIT)),
        (
            IN_DOUBT,
            refused("model_fit", Reason.INTERVAL_TOO_WIDE),
            refused("model_fit", Reason.INTERVAL_TOO_WIDE),
        ),
    ],
)
def test_the_fit_counts_unless_it_only_could_not_and_the_plain_method_could(
    plain: AxisResult, fit: AxisResult, counts: AxisResult
) -> None:
    assert best([plain], [fit]) == (counts,)
