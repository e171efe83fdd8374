"""The axes as they stand, and their histories."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Request, Response

from service.api.part_views import by_product_history
from service.api.problems import responses
from service.api.replies import read_value_cursor, tagged, value_cursor
from service.api.schemas import Axes, AxisView, ByProductHistory, HistoryPage
from service.api.views import axis_view, value_view
from service.store.records import AxisRecord
from service.store.repository import Repository

AxisName = Annotated[str, Path(description="An axis' name.", max_length=64)]
Cursor = Annotated[str | None, Query(description="next_cursor of the page before.", max_length=200)]
Limit = Annotated[int, Query(ge=1, le=500, description="How many values at most.")]


def router(repository: Repository) -> APIRouter:
    """Build the routes of the axes."""
    api = APIRouter(prefix="/axes", tags=["axes"])

    @api.get("", response_model=Axes, responses=responses(), summary="All axes as they stand now")
    def axes(request: Request) -> Response:
        """List the configured axes with current value, interval, trend and alarms."""
        return tagged(request, Axes(items=[_view(repository, axis) for axis in repository.axes()]))

    @api.get(
        "/{name}", response_model=AxisView, responses=responses(404), summary="One axis as it stands now"
    )
    def axis(request: Request, name: AxisName) -> Response:
        """Show one axis with current value, interval, trend and alarms."""
        return tagged(request, _view(repository, repository.axis(name)))

    @api.get(
        "/{name}/history", response_model=HistoryPage, responses=responses(404), summary="An axis' values"
    )
    def history(request: Request, name: AxisName, cursor: Cursor = None, limit: Limit = 100) -> Response:
        """Page through an axis' values, the newest first; refused runs are in it, with their reasons."""
        return tagged(request, _page(repository, repository.axis(name), cursor, limit))

    @api.get(
        "/{name}/by-products",
        response_model=ByProductHistory,
        responses=responses(404),
        summary="Histories of an axis' stiffness, friction and skew",
    )
    def by_products(request: Request, name: AxisName, limit: Limit = 100) -> Response:
        """List what the accepted runs found beside the backlash, one series per parameter."""
        found = repository.parts.by_products(repository.axis(name).name, limit)
        return tagged(request, by_product_history(found))

    return api


def _view(repository: Repository, axis: AxisRecord) -> AxisView:
    accepted = repository.values(axis.name, limit=1, accepted=True)
    latest = repository.values(axis.name, limit=1)
    return axis_view(
        axis, next(iter(accepted), None), next(iter(latest), None), repository.alarms(axis=axis.name)
    )


def _page(repository: Repository, axis: AxisRecord, cursor: str | None, limit: int) -> HistoryPage:
    found = repository.values(axis.name, limit=limit + 1, before=read_value_cursor(cursor))
    shown, last = found[:limit], found[limit - 1 : limit]
    more = value_cursor(last[0].measured_at, last[0].id) if len(found) > limit else None
    return HistoryPage(items=[value_view(value) for value in shown], next_cursor=more)
