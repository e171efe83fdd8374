"""The axes as they stand, and their histories."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

from fastapi import APIRouter, Path, Query, Request, Response

from service.api.by_products import by_product_history
from service.api.ports import NO_MASSES, WebSettings
from service.api.problems import responses
from service.api.replies import read_value_cursor, tagged, value_cursor
from service.api.schemas import Axes, AxisView, HistoryPage
from service.api.value_schemas import ByProductHistory
from service.api.views import axis_view, value_view
from service.monitoring.repeatability import repeatability
from service.monitoring.trend import SLOPE_VALUES, trend
from service.store.records import DECLARED, AxisRecord, ValueRecord
from service.store.repository import Repository

AxisName = Annotated[str, Path(description="An axis' name.", max_length=64)]
Cursor = Annotated[str | None, Query(description="next_cursor of the page before.", max_length=200)]
Limit = Annotated[int, Query(ge=1, le=500, description="How many values at most.")]


def router(repository: Repository, settings: WebSettings) -> APIRouter:
    """Build the routes of the axes."""
    api = APIRouter(prefix="/axes", tags=["axes"])

    @api.get("", response_model=Axes, responses=responses(), summary="All axes as they stand now")
    def axes(request: Request) -> Response:
        """List the configured axes with current value, interval, trend and alarms."""
        return tagged(request, Axes(items=[_view(repository, settings, axis) for axis in repository.axes()]))

    @api.get(
        "/{name}", response_model=AxisView, responses=responses(404), summary="One axis as it stands now"
    )
    def axis(request: Request, name: AxisName) -> Response:
        """Show one axis with current value, interval, trend and alarms."""
        return tagged(request, _view(repository, settings, repository.axis(name)))

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
        return tagged(request, by_product_history(found, settings.moved_masses.get(name, NO_MASSES)))

    return api


def _view(repository: Repository, settings: WebSettings, axis: AxisRecord) -> AxisView:
    models = repository.models
    accepted = repository.values(axis.name, limit=1, accepted=True)
    declared = repository.values(axis.name, limit=1, accepted=True, series=DECLARED)
    latest = repository.values(axis.name, limit=1)
    checks = (one for one in models.explanations(axis=axis.name) if one.state in ("done", "cannot_tell"))
    return axis_view(
        axis,
        _with_trend(repository, next(iter(accepted), None)),
        next(iter(latest), None),
        repository.alarms(axis=axis.name),
        sigma=repeatability(repository.history(axis.name, limit=SLOPE_VALUES).b),
        diagnostic_positions=settings.diagnostic_positions.get(axis.name, ()),
        by_place=repository.parts.places(accepted[0].id) if accepted else (),
        declared=next(iter(declared), None) if axis.series != DECLARED else None,
        model_check=next(checks, None),
        revision=models.in_force(axis.name),
        proposed=models.revisions(axis.name, "proposed"),
    )


def _with_trend(repository: Repository, value: ValueRecord | None) -> ValueRecord | None:
    """A restated value has no trend of its own: the values before it are computed after it."""
    if value is None or value.outcome.trend is not None or value.outcome.model_revision is None:
        return value
    history = repository.history(value.outcome.result.axis)
    return replace(value, outcome=replace(value.outcome, trend=trend(history.t, history.b)))


def _page(repository: Repository, axis: AxisRecord, cursor: str | None, limit: int) -> HistoryPage:
    found = repository.values(axis.name, limit=limit + 1, before=read_value_cursor(cursor))
    shown, last = found[:limit], found[limit - 1 : limit]
    more = value_cursor(last[0].measured_at, last[0].id) if len(found) > limit else None
    return HistoryPage(items=[value_view(value) for value in shown], next_cursor=more)
