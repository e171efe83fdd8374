"""What the API says of one value: trend, steps, directions, the map along the rack, by-products. SI units."""

from __future__ import annotations

from datetime import datetime
from typing import Literal

from pydantic import Field

from service.api.base import UTC_TIME, Interval, Schema

Verdict = Literal["ok", "refused"]


class Reasoned(Schema):
    """Something that is refused with a reason where it is not ok."""

    reason: str | None = Field(
        description="Why it was refused or failed, as a fixed name; null when it was not."
    )
    reason_in_words: str | None = Field(description="The reason in a technician's words; null without one.")
    detail: str | None = Field(description="What was seen, the likely physical cause, and what to do.")


class TrendView(Schema):
    """Where an axis' backlash stands: the median of the last values."""

    level_m: float = Field(description="Median of the last accepted values [m].")
    interval_95_m: Interval | None = Field(
        description="95 % interval of the level [m], from order statistics; null below six values."
    )
    slope_m_per_day: float | None = Field(
        description="Theil-Sen slope [m/day]; null below nine values or one week."
    )
    slope_interval_95_m_per_day: Interval | None = Field(
        description="95 % interval of the slope [m/day]; null where the slope is."
    )
    count: int = Field(description="Number of values under the level.")


class ValueView(Reasoned):
    """One run's answer for one axis."""

    run_id: int = Field(description="The run that measured it.")
    axis: str = Field(description="The axis' name.")
    measured_at: datetime = Field(description=f"When the run ended ({UTC_TIME}).")
    method: str = Field(description="The estimator that gave it.")
    series: str = Field(
        description="'declared', or the accepted model revision that the value was computed with."
    )
    reported: bool = Field(
        description="Whether it is the axis' value; other methods' answers stand beside it."
    )
    verdict: Verdict = Field(description="'ok', or 'refused' with a reason and without a value.")
    backlash_m: float | None = Field(description="Backlash [m]; null when refused.")
    interval_95_m: Interval | None = Field(
        description="95 % interval of the backlash [m]; null when refused."
    )
    trend: TrendView | None = Field(description="The axis' trend with this value in it; null when refused.")


class StepView(Reasoned):
    """One step of a run."""

    index: int = Field(description="The step's number in the run, from 0.")
    direction: Literal[-1, 1] = Field(description="Direction of travel: 1 towards larger positions, -1 back.")
    verdict: Verdict = Field(description="'ok', or 'refused' with a reason and without a value.")
    backlash_m: float | None = Field(description="Backlash found in this step [m]; null when refused.")
    t1_s: float | None = Field(
        description="When the flanks part [s], on the capture's clock; null if not found."
    )
    t2_s: float | None = Field(
        description="When the flanks meet [s], on the capture's clock; null if not found."
    )
    position_m: float | None = Field(
        description="Middle of the step along the rack [m]; null where the recording does not say."
    )


class DirectionView(Schema):
    """What the steps of one direction say by themselves; the gap is the same both ways."""

    direction: Literal[-1, 1] = Field(description="Direction of travel: 1 towards larger positions, -1 back.")
    backlash_m: float = Field(description="Mean over the direction's steps [m].")
    interval_95_m: Interval = Field(description="95 % interval of it [m].")
    steps: int = Field(description="How many steps it is the mean of.")


class PlaceView(Reasoned):
    """One point of the map along the rack."""

    position_m: float = Field(description="Where along the rack [m]: the middle of the steps there.")
    verdict: Verdict = Field(description="'ok', or 'refused' with a reason and without a value.")
    backlash_m: float | None = Field(description="Backlash there [m]; null when refused.")
    interval_95_m: Interval | None = Field(description="95 % interval of it [m]; null when refused.")


class ShownValue(Schema):
    """A by-product of one run, in a unit of the workshop."""

    unit: str = Field(description="The unit of both numbers; per kg where no mass is configured.")
    value: float = Field(description="The value, in `unit`.")
    std: float = Field(description="Its standard deviation, in `unit`.")


class ByProductView(Schema):
    """Another parameter of the axis' model that the run determined."""

    name: str = Field(description="Which parameter, e.g. contact_stiffness or coulomb_friction.")
    value: float = Field(
        description="Its value, in `unit`; stiffness and friction per kilogram of moved mass."
    )
    std: float = Field(description="Its standard deviation, in `unit`.")
    unit: str = Field(description="The SI unit.")
    label: str = Field(description="Its name in a technician's words.")
    shown: ShownValue = Field(description="The same in a unit of the workshop.")


class ResultView(ValueView):
    """One run's answer for one axis, with its steps."""

    steps: list[StepView] = Field(description="The steps in their order, those refused with their reasons.")
    by_direction: list[DirectionView] = Field(description="Each direction by itself; empty when refused.")
    by_place: list[PlaceView] = Field(description="The map along the rack; empty where no place is known.")
    by_products: list[ByProductView] = Field(description="What else the method found; empty where nothing.")


class ByProductPoint(Schema):
    """A by-product's value in one run."""

    run_id: int = Field(description="The run.")
    measured_at: datetime = Field(description=f"When the run ended ({UTC_TIME}).")
    value: float = Field(description="Its value, in the series' unit.")
    std: float = Field(description="Its standard deviation, in the series' unit.")


class ShownTrend(Schema):
    """Where a by-product stands, in a unit of the workshop."""

    unit: str = Field(description="The unit of `level` and its interval; per kg where no mass is configured.")
    level: float = Field(description="The median of the last nine values, in `unit`.")
    level_interval_95: Interval | None = Field(
        description="95 % interval of the level, in `unit`; null below six values."
    )
    trend_in_words: str = Field(
        description="'steady', growing or falling by how much a month, or why there is none."
    )


class ByProductSeries(Schema):
    """The history of one by-product of an axis."""

    name: str = Field(description="Which parameter.")
    unit: str = Field(description="The SI unit of all values here but those under `shown`.")
    label: str = Field(description="Its name in a technician's words.")
    says: str = Field(description="What a change of it means; empty where that is not known.")
    shown: ShownTrend = Field(description="Where it stands, in a unit of the workshop.")
    level: float = Field(description="Where it stands: the median of the last nine values.")
    level_interval_95: Interval | None = Field(
        description="95 % interval of the level; null below six values."
    )
    slope_per_day: float | None = Field(
        description="Theil-Sen slope a day; null below nine values or a week."
    )
    slope_interval_95_per_day: Interval | None = Field(
        description="95 % interval of the slope a day; null where the slope is."
    )
    items: list[ByProductPoint] = Field(description="The values, the newest first.")


class ByProductHistory(Schema):
    """All by-products of an axis."""

    items: list[ByProductSeries] = Field(description="One series per parameter.")
