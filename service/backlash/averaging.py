"""Ten steps make one experiment: their mean, its 95 % interval, and whether they agree (section V)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from service.backlash.results import Reason, Refusal, StepResult

FEWEST_STEPS = 3
"""Sound steps that one experiment needs. Chosen: with two, their scatter says nothing."""

OUTLIER = 5.0
"""A step so many robust standard deviations from the median is not averaged. Chosen: never by chance."""

SMALLEST_SPREAD = 0.02
"""Scatter of the steps that makes no outlier, over their median. Chosen: the resolution of the method, a tenth
of a 1 kHz sampling time in a pass of 10 ms (db/b = 3 dt/T)."""

LARGEST_SPREAD = 0.3
"""Scatter of the steps over their mean beyond which they do not measure one quantity. Chosen: half more than
the 20 % that section V reports of a real machine."""


WIDEST = 0.6
"""Half width of the interval over the mean that still is a value. Chosen: beyond it, two runs of one axis could not
tell a doubled gap."""


@dataclass(frozen=True)
class StepValue:
    """b of one step [m], and the bounds that the uncertainty of t1 and t2 leaves it [m]."""

    b: float
    lower: float
    upper: float


@dataclass(frozen=True)
class Average:
    """Mean of the kept steps [m], 95 % interval [m], standard deviation of one step [m], which were kept."""

    b: float
    interval_95: tuple[float, float]
    spread: float
    kept: tuple[bool, ...]


def average(values: Sequence[StepValue]) -> Average:
    """Mean of the steps, and an interval that holds what is random and what is not.

    Random is the scatter of the steps, divided over them (Student's t). The uncertainty of t1 and t2 is alike
    in every step and ten of them do not reduce it: the bounds are averaged, the random part comes on top.

    Parameters
    ----------
    values : at least one step; one alone has an infinite interval
    """
    b, lower, upper = np.array([(value.b, value.lower, value.upper) for value in values]).T
    middle = float(np.median(b))
    scatter = max(1.4826 * float(np.median(np.abs(b - middle))), SMALLEST_SPREAD * abs(middle))
    kept = np.abs(b - middle) <= OUTLIER * scatter
    n = int(np.count_nonzero(kept))
    spread = float(np.std(b[kept], ddof=1)) if n > 1 else np.inf
    random = float(stats.t.ppf(0.975, max(n - 1, 1))) * spread / np.sqrt(n)
    interval = (float(np.mean(lower[kept]) - random), float(np.mean(upper[kept]) + random))
    return Average(float(np.mean(b[kept])), interval, spread, tuple(bool(k) for k in kept))


def outlier(value: StepValue) -> Refusal:
    """Why a step is not averaged that differs from the others."""
    return Refusal(
        Reason.STEPS_DISAGREE,
        f"{value.b * 1e6:.1f} µm lies far from the other steps; something disturbed this one.",
    )


def too_few(steps: Sequence[StepResult]) -> Refusal:
    """The reason that most refused steps share is the axis' reason; else too few of several kinds."""
    reasons = Counter(step.reason for step in steps if step.reason is not None)
    sound = len(steps) - sum(reasons.values())
    seen = f"Only {sound} of {len(steps)} steps can be used, {FEWEST_STEPS} are needed."
    reason, count = reasons.most_common(1)[0] if reasons else (None, 0)
    if reason is None or 2 * count <= sum(reasons.values()):
        return Refusal(Reason.TOO_FEW_STEPS, f"{seen} Each says why; repeat the run.")
    detail = next(step.detail for step in steps if step.reason is reason)
    return Refusal(reason, f"{seen} {detail}")


def unsure(mean: Average) -> Refusal | None:
    """Refuse a mean that the steps do not support."""
    if mean.b <= 0.0:
        return Refusal(
            Reason.GAP_NOT_CROSSED,
            f"Motor and load part by {mean.b * 1e6:.1f} µm, no gap; the flanks stay in touch: check brake, preload.",
        )
    if mean.spread > LARGEST_SPREAD * mean.b:
        return Refusal(
            Reason.STEPS_DISAGREE,
            f"The steps scatter by {mean.spread * 1e6:.1f} µm around {mean.b * 1e6:.1f} µm; something else moves the "
            "load, or the gap differs from step to step: look at the single steps, repeat the run.",
        )
    half = (mean.interval_95[1] - mean.interval_95[0]) / 2
    if half > WIDEST * mean.b:
        return Refusal(
            Reason.INTERVAL_TOO_WIDE,
            f"{mean.b * 1e6:.1f} ± {half * 1e6:.1f} µm is no value; release and impact cannot be told closely enough "
            "for so small a gap: sample faster, or choose a longer step or a larger jerk.",
        )
    return None
