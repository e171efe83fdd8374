"""An analysis that knows one effect, friction that differs by direction: for tests of the loop around it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from service.backlash.estimate import immediate
from service.backlash.results import Reason
from service.identification.explanation import (
    Accepted,
    AxisExplanation,
    ErrorReport,
    Explanation,
    Parameter,
    Prediction,
    SeparatingMove,
)
from service.recording import Recording
from service.runs.analysis import Analysis, Results
from service.runs.revised import by_explaining

ORDINARY = 0.004
"""Length of the configured steps [m]: in them a constant force looks like friction that differs by direction."""

RIVALS = (("asymmetric_friction", "constant_force"),)
SLOWER = SeparatingMove(
    0.004 * 2, 50.0, -1, "as before", "a slow reversal keeps a force and turns friction over"
)

MISSING_FROM = 8.0
"""Mean force [N] from which it is found."""


def pull(recording: Recording, axis: str) -> float:
    """The mean force that resists the steps to and fro [N]: friction that is the same both ways leaves none."""
    torque = recording.traces[axis, "motor_torque"]
    return float(np.mean(torque.value)) / recording.axis(axis).transmission


def explain_pull(
    train: Sequence[Recording],
    validate: Recording,
    tell: Callable[[str], None],
    _accepted: Mapping[str, Accepted],
) -> Explanation:
    """Find it where both recordings have it; the backlash is the paper's, before and after."""
    return Explanation(tuple(_axis(train[-1], validate, axis.name) for axis in validate.axes))


def _axis(train: Recording, validate: Recording, axis: str) -> AxisExplanation:
    there = [abs(pull(one, axis)) > MISSING_FROM for one in (train, validate)]
    before = _report(train, axis, 0.1 if any(there) else 0.03)
    trace = validate.traces[axis, "acceleration"]
    alike = all(there) and validate.moves[0].length == ORDINARY
    return AxisExplanation(
        axis,
        "acceleration",
        "effect" if all(there) else ("unknown" if any(there) else "none"),
        0.03,
        before,
        replace(before, train_rms=0.03, validation_rms=0.03),
        effects=("asymmetric_friction",) if all(there) else (),
        indistinguishable=RIVALS if alike else (),
        separating_move=SLOWER if alike else None,
        parameters={"force": Parameter(pull(train, axis), 1.0, "N")},
        predictions=(
            Prediction("before", trace.time, 0 * trace.value),
            Prediction("after", trace.time, trace.value),
        ),
    )


def _report(recording: Recording, axis: str, rms: float) -> ErrorReport:
    result = next(one for one in immediate(recording) if one.axis == axis)
    return ErrorReport(rms, rms, 0.1, 0.5, result.backlash, result.interval_95)


class PullAnalysis(Analysis):
    """The paper's method, no refinement, and ``explain_pull``, all in this process."""

    def __init__(self) -> None:
        super().__init__(explain_pull, partial(by_explaining, explainer=explain_pull))

    def refined(self, path: Path, sha256: str) -> Results:
        return tuple(
            replace(
                one,
                verdict="refused",
                method="model_fit",
                reason=Reason.TOO_FEW_STEPS,
                detail="not fitted here",
                backlash=None,
                interval_95=None,
                steps=(),
            )
            for one in self.immediate(path, sha256)
        )

    def _apart(self, job: Any, path: Path, tell: Any = lambda _: None, niceness: int = 0) -> Any:
        return job(tell)
