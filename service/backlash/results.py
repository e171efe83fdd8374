"""What an estimate of the backlash says: per step, per axis; a value with an interval, or a named refusal.

A step in which no gap can be found is a result, not an exception: a wrong value is worse than none.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal, NamedTuple

Verdict = Literal["ok", "refused"]


class Reason(StrEnum):
    """Why a step or an axis was refused. The value is what the API and the store show."""

    NO_MOVES = "no_moves"
    CHANNEL_MISSING = "channel_missing"
    RATE_TOO_LOW = "rate_too_low"
    NOT_FINITE = "not_finite"
    IMPLAUSIBLE_MAGNITUDE = "implausible_magnitude"
    FRAME_LOSS = "frame_loss"
    STEP_INCOMPLETE = "step_incomplete"
    SENSOR_FLAT = "sensor_flat"
    SENSOR_CLIPPED = "sensor_clipped"
    WRONG_SIGN = "wrong_sign"
    SIGNALS_DISAGREE = "signals_disagree"
    SENSORS_SWAPPED = "sensors_swapped"
    SENSORS_IN_DOUBT = "sensors_in_doubt"
    TRAJECTORY_NOT_FOLLOWED = "trajectory_not_followed"
    EXCITATION = "excitation"
    NO_RELEASE = "no_release"
    NO_RECONTACT = "no_recontact"
    GAP_NOT_CROSSED = "gap_not_crossed"
    GAP_TOO_SHORT = "gap_too_short"
    STEPS_DISAGREE = "steps_disagree"
    TOO_FEW_STEPS = "too_few_steps"
    MISFIT = "misfit"
    GANTRY_PARTNER_MISSING = "gantry_partner_missing"
    INTERVAL_TOO_WIDE = "interval_too_wide"


OF_THE_METHOD = frozenset({Reason.INTERVAL_TOO_WIDE, Reason.TOO_FEW_STEPS})
"""Reasons that say only what one method cannot do with a run; another's value may stand. All others speak of the run:
its recording, its moves, or a machine that does something else than every method takes for granted. A misfit is one of
these: a second gap, a swinging body or a tilting sensor drives the plain value far out of its interval, and neither the
size of the misfit nor the plain method's own steps tell these from effects that leave it alone."""


class Refusal(NamedTuple):
    """Why there is no value; ``detail`` says what was seen, the likely physical cause and what to do."""

    reason: Reason
    detail: str


@dataclass(frozen=True)
class StepResult:
    """One step. ``backlash`` [m], ``t1`` and ``t2`` [s] on the recording's clock are None when refused.

    ``reason`` is None when the verdict is ok; ``detail`` says in a sentence what was seen, the likely
    physical cause and what to do. ``position`` [m] is the middle of the step along the rack, None where the
    recording does not say where the axis stood.
    """

    index: int
    direction: int
    verdict: Verdict
    reason: Reason | None = None
    detail: str | None = None
    backlash: float | None = None
    t1: float | None = None
    t2: float | None = None
    position: float | None = None


@dataclass(frozen=True)
class DirectionValue:
    """Backlash [m] of the steps of one direction ±1 with its 95 % interval [m], and how many steps they are.

    The gap is the same both ways; a difference says that something else moves the load.
    """

    direction: int
    backlash: float
    interval_95: tuple[float, float]
    steps: int


@dataclass(frozen=True)
class PlaceValue:
    """Backlash [m] at one ``position`` [m] along the rack with its 95 % interval [m]; or why there is none."""

    position: float
    verdict: Verdict
    reason: Reason | None = None
    detail: str | None = None
    backlash: float | None = None
    interval_95: tuple[float, float] | None = None


@dataclass(frozen=True)
class ByProduct:
    """Another parameter of the axis' model that the run determined: value and standard deviation in ``unit``."""

    name: str
    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class AxisResult:
    """One axis of one run: ``backlash`` [m] and its 95 % interval [m], None when refused.

    ``by_direction`` and ``by_place`` say what parts of the run say by themselves, ``by_products`` what else the
    method found; each is empty where there is nothing to say.
    """

    axis: str
    verdict: Verdict
    method: str
    reason: Reason | None = None
    detail: str | None = None
    backlash: float | None = None
    interval_95: tuple[float, float] | None = None
    steps: tuple[StepResult, ...] = field(default=())
    by_direction: tuple[DirectionValue, ...] = field(default=())
    by_place: tuple[PlaceValue, ...] = field(default=())
    by_products: tuple[ByProduct, ...] = field(default=())
