"""What the API says and hears of axes, runs and checks. SI units, the unit in the name; times are RFC 3339 in UTC."""

from __future__ import annotations

from datetime import date, datetime
from typing import Literal

from pydantic import ConfigDict, Field, model_validator

from service.api.alarm_schemas import AlarmState, AlarmView
from service.api.base import UTC_TIME, Schema
from service.api.model_schemas import ComputingView, ModelCheckView, RevisionView, StepsView
from service.api.value_schemas import PlaceView, Reasoned, ResultView, ValueView


class AxisView(Schema):
    """An axis as it stands now."""

    name: str = Field(description="The axis' name.")
    group: str = Field(description="The group that moves together with it in a run: a gantry, or itself.")
    reference_m: float | None = Field(description="Backlash that it is meant to have [m]; null when not set.")
    tolerance_m: float | None = Field(
        description="How far the trend may be from the reference [m]; null when not set."
    )
    repeatability_m: float | None = Field(
        description="Standard deviation of one value [m], from the differences of neighbours; null below six values."
    )
    tolerance_hint: str | None = Field(
        description="What to do where the tolerance is less than three times that; null where it is not."
    )
    diagnostic_positions_m: list[float] = Field(
        description="Where along the rack a check steps [m], travelling there; empty: where the axis stands."
    )
    series: str = Field(description="The series of its current values: 'declared', or a model revision.")
    current: ValueView | None = Field(
        description="The latest accepted value, with its trend; null before the first."
    )
    by_place: list[PlaceView] = Field(
        description="The current value's map along the rack; empty where it was measured at one place."
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
    other_steps: StepsView | None = Field(
        description="The steps it made where they were not the configured ones: its values measure nothing."
    )
    remarks: list[str] = Field(
        description="What was noticed and ended nothing: warnings of drives and sensors, in sentences."
    )
    capture_sha256: str | None = Field(
        description="SHA-256 of its capture, hexadecimal; null without a capture."
    )


class RunDetail(RunView):
    """A run with all that it found."""

    results: list[ResultView] = Field(description="Each axis' answer by each method, with its steps.")
    model_checks: list[ModelCheckView] = Field(
        description="What the models lacked in this run, the newest verdict first."
    )


class RunPage(Schema):
    """A page of runs."""

    items: list[RunView] = Field(description="The runs, the newest first.")
    next_cursor: int | None = Field(
        description="Give it as 'cursor' for the older runs; null on the last page."
    )


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
