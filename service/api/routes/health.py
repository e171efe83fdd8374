"""Probes and metrics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from http import HTTPStatus

from fastapi import APIRouter, Response

from service.api.metrics import CONTENT_TYPE, collect, render
from service.api.ports import Checks, WebSettings
from service.api.problems import ProblemError, responses
from service.api.schemas import Health
from service.store.repository import Repository


def router(repository: Repository, missing: Callable[[], Sequence[str]]) -> APIRouter:
    """Build the probes."""
    api = APIRouter(tags=["health"])

    @api.get("/livez", responses=responses(), summary="Does the process answer?")
    def livez() -> Health:
        """Answer; a supervisor restarts the process when this does not come."""
        return Health(status="ok")

    @api.get("/readyz", responses=responses(503), summary="Can it measure?")
    def readyz() -> Health:
        """Answer ok when the store answers and nothing is missing; else say what is."""
        repository.axes()
        if absent := missing():
            raise ProblemError(HTTPStatus.SERVICE_UNAVAILABLE, "not-ready", "Not ready", "; ".join(absent))
        return Health(status="ok")

    return api


def metrics_router(
    repository: Repository, checks: Checks, missing: Callable[[], Sequence[str]], settings: WebSettings
) -> APIRouter:
    """Build the route that Prometheus scrapes."""
    api = APIRouter(tags=["health"])

    @api.get(
        "/metrics",
        response_class=Response,
        responses={200: {"content": {"text/plain": {}}, "description": "The metrics."}, **responses()},
        summary="Prometheus' metrics",
    )
    def metrics() -> Response:
        """Write all gauges in Prometheus' text format."""
        families = collect(repository, settings.version, missing(), checks.progress() is not None)
        return Response(render(families), media_type=CONTENT_TYPE)

    return api
