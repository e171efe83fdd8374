"""Asking for a check, and seeing where it stands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Header, Response

from service.api.model_schemas import MoveRequest
from service.api.ports import Checks, Loop, WebSettings, now_utc
from service.api.problems import ProblemError, responses
from service.api.schemas import CheckAccepted, CheckRequest, Status
from service.api.views import computing_view, progress_view
from service.store.records import (
    BeyondLimits,
    Busy,
    CheckAnswer,
    KeyReused,
    Queued,
    StepParameters,
    Unavailable,
    UnknownTarget,
)
from service.store.repository import Repository

Key = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key",
        min_length=1,
        max_length=255,
        description="Any text of the caller's choice; asked again with it, the answer is the same run.",
    ),
]

_LOCATION = {"headers": {"Location": {"description": "The run.", "schema": {"type": "string"}}}}


def router(
    repository: Repository,
    checks: Checks,
    loop: Loop,
    missing: Callable[[], Sequence[str]],
    settings: WebSettings,
) -> APIRouter:
    """Build the routes of the checks."""
    api = APIRouter(tags=["checks"])
    _add_moves(api, repository, checks)

    @api.post(
        "/checks",
        status_code=202,
        response_model=CheckAccepted,
        responses={202: _LOCATION, **responses(409, 503)},
        summary="Check an axis or a group now",
    )
    def check(body: CheckRequest, response: Response, idempotency_key: Key = None) -> CheckAccepted:
        """Put a check into the box of one run. **The machine moves.** Follow it at the header Location."""
        target = _target(body, repository)
        queued = _queued(checks.request(target, idempotency_key))
        location = f"/api/v1/runs/{queued.run_id}"
        response.headers["Location"] = location
        return CheckAccepted(run_id=queued.run_id, location=location, replayed=queued.replayed)

    @api.get("/status", responses=responses(), summary="What the service is doing")
    def status() -> Status:
        """Say where the check in the box stands, and what keeps the service from measuring."""
        return Status(
            version=settings.version,
            time=now_utc(),
            progress=progress_view(checks.progress()),
            computing=computing_view(loop.progress()),
            not_ready=list(missing()),
        )

    return api


def _add_moves(api: APIRouter, repository: Repository, checks: Checks) -> None:
    @api.post(
        "/moves",
        status_code=202,
        response_model=CheckAccepted,
        responses={202: _LOCATION, **responses(409, 503)},
        summary="Make a separating move",
    )
    def move(body: MoveRequest, response: Response) -> CheckAccepted:
        """Put a run of these steps into the box, to tell two effects apart. **The machine moves.**

        The run is recorded and explained; its values are no measurements of the axis and enter no trend.
        """
        target = _target(CheckRequest(axis=body.axis), repository)
        steps = StepParameters(body.length_m, body.jerk_m_s3, body.direction, tuple(body.positions_m))
        answer = checks.request_steps(target, steps)
        if isinstance(answer, BeyondLimits):
            raise ProblemError(
                HTTPStatus.UNPROCESSABLE_ENTITY, "beyond-limits", "More than the axis may do", answer.detail
            )
        queued = _queued(answer)
        location = f"/api/v1/runs/{queued.run_id}"
        response.headers["Location"] = location
        return CheckAccepted(run_id=queued.run_id, location=location, replayed=queued.replayed)


def _target(body: CheckRequest, repository: Repository) -> str:
    """Return what is asked for: an axis where an axis is named, a group where a group is."""
    axes = repository.axes()
    known = sorted({axis.name for axis in axes} if body.axis is not None else {axis.group for axis in axes})
    asked = body.axis if body.axis is not None else body.group
    if asked not in known:
        raise _unknown(asked, known)
    return str(asked)


def _queued(answer: CheckAnswer) -> Queued:
    """Return the run, or raise the problem that keeps it from being one."""
    match answer:
        case Queued():
            return answer
        case Busy(run_id):
            detail = (
                f"run {run_id} is waiting or moving, and there is one machine; ask again when it has ended"
            )
            raise ProblemError(HTTPStatus.CONFLICT, "busy", "The machine is busy", detail, run_id=run_id)
        case KeyReused(run_id):
            detail = f"this Idempotency-Key asked for something else before (run {run_id}); use a new one"
            raise ProblemError(
                HTTPStatus.UNPROCESSABLE_ENTITY,
                "key-reused",
                "Idempotency-Key used twice",
                detail,
                run_id=run_id,
            )
        case UnknownTarget(known):
            raise _unknown(None, known)
        case Unavailable(detail):
            raise ProblemError(
                HTTPStatus.SERVICE_UNAVAILABLE, "unavailable", "The machine cannot move", detail
            )


def _unknown(asked: str | None, known: Sequence[str]) -> ProblemError:
    detail = f"{asked!r} is not configured; configured are {', '.join(known)}"
    return ProblemError(HTTPStatus.UNPROCESSABLE_ENTITY, "unknown-target", "Unknown axis or group", detail)
