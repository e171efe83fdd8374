"""The web application, put together from its routes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import datetime
from typing import Any

from fastapi import Depends, FastAPI
from fastapi.openapi.utils import get_openapi
from starlette.types import Lifespan

from service.api import problems
from service.api.access import guard
from service.api.limits import BodyLimit
from service.api.ports import Checks, Loop, Picture, Report, WebSettings, nothing_missing, now_utc
from service.api.routes import alarms, axes, checks, health, models, page, runs
from service.store.repository import Repository

_DESCRIPTION = (
    "Backlash of rack-and-pinion axes: values, trends, alarms, runs. SI units, the unit in every name; "
    "errors are problem+json (RFC 9457). A refused value is null and has a reason."
)


def create_web_app(
    repository: Repository,
    box: Checks,
    loop: Loop,
    settings: WebSettings,
    *,
    picture: Picture,
    report: Report,
    missing: Callable[[], Sequence[str]] = nothing_missing,
    clock: Callable[[], datetime] = now_utc,
    lifespan: Lifespan[FastAPI] | None = None,
) -> FastAPI:
    """Build the application.

    ``missing`` says what keeps the service from measuring, in sentences, empty when nothing does;
    ``lifespan`` is the composition root's, for what it starts and stops with the server.
    """
    app = FastAPI(
        title="Flankwatch",
        version=settings.version,
        description=_DESCRIPTION,
        docs_url=None,  # both documentation pages load their scripts from the internet
        redoc_url=None,
        lifespan=lifespan,
    )
    problems.install(app)
    app.add_middleware(BodyLimit)
    guarded = [Depends(guard(settings))]
    for router in (
        axes.router(repository, settings),
        runs.router(repository, picture, settings),
        checks.router(repository, box, loop, missing, settings),
        models.router(repository, loop, report, settings),
        alarms.router(repository, clock),
    ):
        app.include_router(router, prefix="/api/v1", dependencies=guarded)
    app.include_router(health.metrics_router(repository, box, missing, settings), dependencies=guarded)
    app.include_router(health.router(repository, missing))
    app.include_router(page.router())
    app.openapi = lambda: _openapi(app)  # type: ignore[method-assign]
    return app


def _openapi(app: FastAPI) -> dict[str, Any]:
    """Describe the application, with the schema of problems that its responses refer to."""
    if app.openapi_schema is None:
        schema = get_openapi(
            title=app.title, version=app.version, description=app.description, routes=app.routes
        )
        problem = problems.Problem.model_json_schema(ref_template="#/components/schemas/{model}")
        known = schema["components"]["schemas"]
        known |= {**problem.pop("$defs"), "Problem": problem}
        for unused in ("HTTPValidationError", "ValidationError"):
            known.pop(unused, None)
        app.openapi_schema = schema
    return app.openapi_schema
