"""The alarms and their acknowledgement."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from typing import Annotated

from fastapi import APIRouter, Path, Query, Request, Response

from service.api.alarm_schemas import Acknowledgement, AlarmDetail, Alarms
from service.api.problems import responses
from service.api.replies import tagged
from service.api.views import alarm_detail, alarm_view
from service.store.repository import Repository

AlarmId = Annotated[int, Path(ge=1, le=2**63 - 1, description="The alarm's number.")]
AllEver = Annotated[bool, Query(alias="all", description="Also those that are over and acknowledged.")]
OfAxis = Annotated[str | None, Query(max_length=64, description="Only those of this axis.")]


def router(repository: Repository, clock: Callable[[], datetime]) -> APIRouter:
    """Build the routes of the alarms."""
    api = APIRouter(prefix="/alarms", tags=["alarms"])

    @api.get("", response_model=Alarms, responses=responses(), summary="Alarms, the newest first")
    def alarms(request: Request, all_ever: AllEver = False, axis: OfAxis = None) -> Response:
        """List the alarms that are active or not acknowledged, or the latest 200 there ever were."""
        found = repository.alarms(axis=axis, all_ever=all_ever)
        return tagged(request, Alarms(items=[alarm_view(alarm) for alarm in found]))

    @api.get("/{alarm_id}", response_model=AlarmDetail, responses=responses(404), summary="One alarm")
    def alarm(request: Request, alarm_id: AlarmId) -> Response:
        """Show an alarm with its journal."""
        return tagged(request, _detail(repository, alarm_id))

    @api.post("/{alarm_id}/acknowledge", responses=responses(404), summary="Acknowledge an alarm")
    def acknowledge(alarm_id: AlarmId, body: Acknowledgement) -> AlarmDetail:
        """Say to have seen an alarm. Its condition is not changed by that; a second time changes nothing."""
        repository.acknowledge(alarm_id, clock(), body.by, body.comment)
        return _detail(repository, alarm_id)

    return api


def _detail(repository: Repository, alarm_id: int) -> AlarmDetail:
    return alarm_detail(repository.alarm(alarm_id), repository.alarm_events(alarm_id))
