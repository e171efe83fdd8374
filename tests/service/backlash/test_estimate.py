"""Which of two methods' answers counts, and what is asked before the fit."""

from __future__ import annotations

from dataclasses import replace

import pytest

from service.backlash import estimate
from service.backlash.estimate import best
from service.backlash.results import AxisResult, Reason, Refusal
from service.recording import AxisDescription, Recording

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


@pytest.mark.parametrize("exchanged", [False, True])
def test_the_fit_asks_the_machine_once_which_sensor_sits_where(
    monkeypatch: pytest.MonkeyPatch, exchanged: bool
) -> None:
    verdict = Refusal(Reason.SENSORS_SWAPPED, "exchange them") if exchanged else None
    asked: list[tuple[str, str]] = []
    pair = (AxisDescription("X1", 0.006), AxisDescription("X2", 0.006))
    gantry = Recording("two in doubt", pair, {}, (), (("X1", "X2"),))

    def ask(_recording: Recording, axes: tuple[str, str]) -> Refusal | None:
        asked.append(axes)
        return verdict

    def fitted(_recording: Recording, _axis: str) -> dict[str, AxisResult]:
        return {name: replace(FIT, axis=name) for name in ("X1", "X2")}

    monkeypatch.setattr(estimate, "admit", lambda *_: Refusal(Reason.SENSORS_IN_DOUBT, "ask"))
    monkeypatch.setattr(estimate, "swapped", ask)
    monkeypatch.setattr(estimate, "model_fit_axes", fitted)
    monkeypatch.setattr(estimate, "at_each_place", lambda recording, method: method(recording))
    monkeypatch.setattr(estimate, "compiled_apart", lambda: asked.append(("made", "first")))
    results = estimate.refined(gantry)
    assert asked.pop(0) == ("made", "first"), "the machine code, by a process of its own"
    assert asked == [("X1", "X2")]
    assert [r.axis for r in results] == ["X1", "X2"]
    assert {r.reason for r in results} == {Reason.SENSORS_SWAPPED if exchanged else None}
