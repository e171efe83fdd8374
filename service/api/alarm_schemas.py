"""What the API says and hears of alarms; active and acknowledged as in OPC UA Part 9 and ISA-18.2."""

from __future__ import annotations

from datetime import datetime
from typing import Literal

from pydantic import Field

from service.api.base import UTC_TIME, Schema
from service.monitoring.alarm import AlarmEvent, AlarmKind


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


class Alarms(Schema):
    """A list of alarms."""

    items: list[AlarmView] = Field(description="The alarms, the newest first.")


class Acknowledgement(Schema):
    """Who has seen an alarm."""

    by: str = Field(min_length=1, max_length=128, description="The person's name or initials.")
    comment: str = Field(
        default="", max_length=2000, description="What the person wants to leave in the journal."
    )


AlarmState = Literal["normal", "unacknowledged", "acknowledged", "returned_unacknowledged"]
