"""What the loop answers: which effect an axis' declared model lacks, and the error before and after adding it.

Plain frozen data; ``as_json`` is the form that the command prints and the interface returns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from service.recording import FloatArray

Finding = Literal["effect", "none", "unknown"]


class CannotExplain(ValueError):
    """The recordings do not allow a verdict: says which one, why, and what to record instead."""


@dataclass(frozen=True)
class Parameter:
    """One identified value with its standard deviation, both in ``unit``."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class Accepted:
    """What the model of an axis has by an accepted revision: names of effects, and the numbers that it was found with,
    under the names and in the units of an axis' ``parameters``: a place to begin."""

    effects: tuple[str, ...]
    numbers: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Candidate:
    """One effect that was tried as the next addition.

    ``validation_rms`` is the held-out error with it, in the channel's unit; ``p_value`` is already corrected
    for the number of candidates that were tried. ``why`` says in words why it was (not) taken.
    """

    effect: str
    validation_rms: float
    p_value: float
    accepted: bool = False
    why: str = ""


@dataclass(frozen=True)
class ErrorReport:
    """The model's error on the fitted and on the held-out recording, in the channel's unit.

    ``normalised_rms`` is validation_rms over the RMS of the measured signal, ``whiteness`` the lag-one
    autocorrelation of the held-out residual (0 is white). ``backlash`` [m] and its interval are None where
    the recording holds no diagnostic moves. ``expected_rms`` is the validation_rms of a right model, by the noise of
    all channels and by what the fitted recording does not tell of its numbers; None where that is not known.
    """

    train_rms: float
    validation_rms: float
    normalised_rms: float
    whiteness: float
    backlash: float | None = None
    interval_95: tuple[float, float] | None = None
    expected_rms: float | None = None


@dataclass(frozen=True)
class SeparatingMove:
    """The move that would tell two rivals apart: length [m], jerk [m/s³], direction, and why it does."""

    length: float
    jerk: float
    direction: int
    position: str
    why: str


@dataclass(frozen=True)
class Prediction:
    """What a model says the channel reads, at the channel's own time stamps [s] of the held-out recording."""

    model: Literal["before", "after"]
    time: FloatArray
    value: FloatArray


@dataclass(frozen=True)
class AxisExplanation:
    """The verdict on one axis in one channel; ``effects`` in the order in which they were found, strongest first.

    ``accepted`` are the effects that the model had already, ``before`` and ``after`` alike; ``absent`` those that it
    was accepted to have and that the moves do not show.
    """

    axis: str
    channel: str
    finding: Finding
    noise_rms: float
    before: ErrorReport
    after: ErrorReport
    effects: tuple[str, ...] = ()
    indistinguishable: tuple[tuple[str, ...], ...] = ()
    separating_move: SeparatingMove | None = None
    candidates: tuple[Candidate, ...] = ()
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    evidence: tuple[str, ...] = ()
    predictions: tuple[Prediction, ...] = ()
    accepted: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()


@dataclass(frozen=True)
class Explanation:
    """The verdicts on all axes of a recording."""

    axes: tuple[AxisExplanation, ...]

    def as_json(self) -> dict[str, Any]:
        """One object of plain types, units in the names; predictions are not in it (see ``predictions``)."""
        return {"axes": [_axis_json(axis) for axis in self.axes]}

    def predictions(self) -> dict[str, list[Any]]:
        """Columns ``time_s, axis, channel, model, value`` of every prediction, one row per sample."""
        rows: dict[str, list[Any]] = {key: [] for key in ("time_s", "axis", "channel", "model", "value")}
        for axis in self.axes:
            for prediction in axis.predictions:
                count = len(prediction.time)
                rows["time_s"].extend(prediction.time.tolist())
                rows["value"].extend(prediction.value.tolist())
                rows["axis"].extend([axis.axis] * count)
                rows["channel"].extend([axis.channel] * count)
                rows["model"].extend([prediction.model] * count)
        return rows


def _number(value: float | None) -> float | None:
    """JSON has no NaN: what is not finite is said to be absent."""
    return None if value is None or not np.isfinite(value) else float(value)


def _error_json(report: ErrorReport) -> dict[str, Any]:
    interval = None if report.interval_95 is None else [_number(end) for end in report.interval_95]
    return {
        "train_rms": _number(report.train_rms),
        "validation_rms": _number(report.validation_rms),
        "expected_rms": _number(report.expected_rms),
        "normalised_rms": _number(report.normalised_rms),
        "whiteness": _number(report.whiteness),
        "backlash_m": _number(report.backlash),
        "interval_95_m": interval,
    }


def _candidate_json(candidate: Candidate) -> dict[str, Any]:
    return {
        "effect": candidate.effect,
        "validation_rms": _number(candidate.validation_rms),
        "p_value": _number(candidate.p_value),
        "accepted": candidate.accepted,
        "why": candidate.why,
    }


def _move_json(move: SeparatingMove | None) -> dict[str, Any] | None:
    if move is None:
        return None
    return {
        "length_m": move.length,
        "jerk_m_s3": move.jerk,
        "direction": move.direction,
        "position": move.position,
        "why": move.why,
    }


def _axis_json(axis: AxisExplanation) -> dict[str, Any]:
    return {
        "axis": axis.axis,
        "channel": axis.channel,
        "finding": axis.finding,
        "effects": list(axis.effects),
        "accepted": list(axis.accepted),
        "absent": list(axis.absent),
        "indistinguishable": [list(group) for group in axis.indistinguishable],
        "separating_move": _move_json(axis.separating_move),
        "candidates": [_candidate_json(c) for c in axis.candidates],
        "noise_rms": _number(axis.noise_rms),
        "before": _error_json(axis.before),
        "after": _error_json(axis.after),
        "parameters": {
            name: {"value": _number(p.value), "std": _number(p.std), "unit": p.unit}
            for name, p in axis.parameters.items()
        },
        "evidence": list(axis.evidence),
    }
