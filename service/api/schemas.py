"""What the API says and hears. SI units, the unit in the name; times are RFC 3339 in UTC."""

from __future__ import annotations

from datetime import date, datetime
from typing import Literal

from pydantic import ConfigDict, Field, model_validator

from service.api.base import UTC_TIME, Interval, Schema
from service.api.model_schemas import ComputingView, ModelCheckView, RevisionView, StepsView
from service.monitoring.alarm import AlarmEvent, AlarmKind

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


class ByProductView(Schema):
    """Another parameter of the axis' model that the run determined."""

    name: str = Field(description="Which parameter, e.g. contact_stiffness or coulomb_friction.")
    value: float = Field(
        description="Its value, in `unit`; stiffness and friction per kilogram of moved mass."
    )
    std: float = Field(description="Its standard deviation, in `unit`.")
    unit: str = Field(description="The unit.")


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


class ByProductSeries(Schema):
    """The history of one by-product of an axis."""

    name: str = Field(description="Which parameter.")
    unit: str = Field(description="The unit of all values here.")
    level: float = Field(description="Where it stands: the median of the last nine values.")
    level_interval_95: Interval | None = Field(
        description="95 % interval of the level; null below six values."
    )
    slope_per_day: float | None = Field(
        description="Theil-Sen slope a day; null below nine values or a week."
    )
    items: list[ByProductPoint] = Field(description="The values, the newest first.")


class ByProductHistory(Schema):
    """All by-products of an axis."""

    items: list[ByProductSeries] = Field(description="One series per parameter.")


class AlarmView(Schema):
    """One occurrence of an alarm; active and acknowledged as in OPC UA Part 9 and ISA-18.2."""

    id: int = Field(description="The alarm's number.")
    axis: str = Field(description="The axis that it is about.")
    kind: AlarmKind = Field(description="What it is about: the trend too high or too low, or runs missing.")
    active: bool = Field(description="Whether its condition holds. Missing or refused runs never end it.")
    acknowledged: bool = Field(description="Whether a person has said to have seen it.")
    raised_at: datetime = Field(description=f"When it was raised ({UTC_TIME}).")
    cleared_at: datetime | None = Field(
        description=f"When its condition ended ({UTC_TIME}); null while active."
    )
    acknowledged_at: datetime | None = Field(
        description=f"When it was acknowledged ({UTC_TIME}); null before."
    )
    acknowledged_by: str | None = Field(description="Who acknowledged it; null before.")
    detail: str = Field(description="What was seen when it was raised.")


class AlarmEventView(Schema):
    """One line of an alarm's journal."""

    event: AlarmEvent = Field(description="What happened.")
    at: datetime = Field(description=f"When ({UTC_TIME}).")
    by: str | None = Field(description="Who did it; null when the service did.")
    run_id: int | None = Field(description="The run that led to it; null without one.")
    detail: str = Field(description="What was seen, or the person's comment.")


class AlarmDetail(AlarmView):
    """An alarm with its journal."""

    events: list[AlarmEventView] = Field(description="All that happened to it, oldest first.")


AlarmState = Literal["normal", "unacknowledged", "acknowledged", "returned_unacknowledged"]


class AxisView(Schema):
    """An axis as it stands now."""

    name: str = Field(description="The axis' name.")
    group: str = Field(description="The group that moves together with it in a run: a gantry, or itself.")
    reference_m: float | None = Field(description="Backlash that it is meant to have [m]; null when not set.")
    tolerance_m: float | None = Field(
        description="How far the trend may be from the reference [m]; null when not set."
    )
    series: str = Field(description="The series of its current values: 'declared', or a model revision.")
    current: ValueView | None = Field(
        description="The latest accepted value, with its trend; null before the first."
    )
    latest: ValueView | None = Field(description="The latest answer, refused or not; null before the first.")
    declared: ValueView | None = Field(
        description="The latest accepted value by the declared model, where the series is a revision's; else null."
    )
    model_check: ModelCheckView | None = Field(
        description="The latest verdict on what the axis' model lacks; null before the first."
    )
    revision: RevisionView | None = Field(
        description="The accepted model revision that the current values are computed with; null when declared."
    )
    proposed: list[RevisionView] = Field(
        description="Model revisions that wait for a decision, newest first."
    )
    alarm_state: AlarmState = Field(description="The most urgent state of its alarms, in ISA-18.2's words.")
    alarms: list[AlarmView] = Field(
        description="Its alarms that are active or not acknowledged, newest first."
    )


class Axes(Schema):
    """All configured axes."""

    items: list[AxisView] = Field(description="The axes in the configuration's order.")


class HistoryPage(Schema):
    """A page of an axis' values."""

    items: list[ValueView] = Field(description="Reported values, refused ones too, the newest first.")
    next_cursor: str | None = Field(
        description="Give it as 'cursor' for the older values; null on the last page."
    )


class RunView(Reasoned):
    """A run in short."""

    id: int = Field(description="The run's number.")
    kind: Literal["on_demand", "nightly"] = Field(
        description="Whether a person asked for it or the schedule did."
    )
    state: Literal["queued", "running", "ok", "refused", "failed"] = Field(
        description="Where it stands; 'refused' when no axis gave a value, 'failed' when none was measured."
    )
    target: str = Field(description="What was asked for: an axis or a group.")
    group: str = Field(description="The group that moved.")
    axes: list[str] = Field(description="The axes that moved.")
    local_date: date | None = Field(
        description="The local date that a nightly run belongs to; null on demand."
    )
    requested_at: datetime = Field(description=f"When it was asked for ({UTC_TIME}).")
    started_at: datetime | None = Field(description=f"When it began to move ({UTC_TIME}); null before.")
    finished_at: datetime | None = Field(description=f"When it ended ({UTC_TIME}); null before.")
    capture_sha256: str | None = Field(
        description="SHA-256 of its capture, hexadecimal; null without a capture."
    )


class RunDetail(RunView):
    """A run with all that it found."""

    results: list[ResultView] = Field(description="Each axis' answer by each method, with its steps.")
    other_steps: StepsView | None = Field(
        description="The steps it made where they were not the configured ones: its values measure nothing."
    )
    model_checks: list[ModelCheckView] = Field(
        description="What the models lacked in this run, the newest verdict first."
    )


class RunPage(Schema):
    """A page of runs."""

    items: list[RunView] = Field(description="The runs, the newest first.")
    next_cursor: int | None = Field(
        description="Give it as 'cursor' for the older runs; null on the last page."
    )


class Alarms(Schema):
    """A list of alarms."""

    items: list[AlarmView] = Field(description="The alarms, the newest first.")


class CheckRequest(Schema):
    """What to check: exactly one of the two."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"minProperties": 1, "maxProperties": 1})
    axis: str | None = Field(
        default=None, min_length=1, max_length=64, description="An axis' name; its gantry moves with it."
    )
    group: str | None = Field(default=None, min_length=1, max_length=64, description="A group's name.")

    @model_validator(mode="after")
    def _exactly_one(self) -> CheckRequest:
        if (self.axis is None) == (self.group is None):
            raise ValueError("name an axis or a group, not both and not neither")
        return self


class CheckAccepted(Schema):
    """A check that waits for the machine or moves it."""

    run_id: int = Field(description="The run that the check became.")
    location: str = Field(description="Where to follow it, as in the header Location.")
    replayed: bool = Field(description="True when this Idempotency-Key had asked for it before.")


class Acknowledgement(Schema):
    """Who has seen an alarm."""

    by: str = Field(min_length=1, max_length=128, description="The person's name or initials.")
    comment: str = Field(
        default="", max_length=2000, description="What the person wants to leave in the journal."
    )


class ProgressView(Schema):
    """Where the run in the box stands."""

    run_id: int = Field(description="The run.")
    target: str = Field(description="What is checked: an axis or a group.")
    phase: str = Field(description="What happens now, in words.")
    done: int = Field(description="Steps made.")
    total: int = Field(description="Steps to make; 0 where steps are not what is waited for.")


class Status(Schema):
    """What the service is doing."""

    version: str = Field(description="Flankwatch's version.")
    time: datetime = Field(description=f"The service's clock ({UTC_TIME}).")
    progress: ProgressView | None = Field(
        description="The check that waits or moves; null when the machine is idle."
    )
    computing: ComputingView | None = Field(
        description="What is being computed beside the runs; null at rest."
    )
    not_ready: list[str] = Field(
        description="What keeps the service from measuring, in sentences; empty when nothing."
    )


class Health(Schema):
    """That a probe succeeded."""

    status: Literal["ok"] = Field(
        description="Always 'ok'; anything else is a problem with another status code."
    )
