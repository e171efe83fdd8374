"""The runs with their steps, their captures and pictures of their steps."""

from __future__ import annotations

from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Path, Query, Request, Response
from fastapi.responses import FileResponse

from service.api.ports import Picture, WebSettings
from service.api.problems import ProblemError, responses
from service.api.replies import tagged
from service.api.schemas import RunDetail, RunPage
from service.api.views import run_detail, run_view
from service.store.records import RunRecord
from service.store.repository import Repository

LARGEST = 2**63 - 1

RunId = Annotated[int, Path(ge=1, le=LARGEST, description="The run's number.")]
Cursor = Annotated[int | None, Query(ge=1, le=LARGEST, description="next_cursor of the page before.")]
Limit = Annotated[int, Query(ge=1, le=200, description="How many runs at most.")]
OfAxis = Annotated[str | None, Query(max_length=64, description="Only the runs that moved this axis.")]
Axis = Annotated[str, Query(max_length=64, description="The axis.")]
Step = Annotated[int, Query(ge=0, le=10_000, description="The step's number in the run, from 0.")]

_PARQUET = "application/vnd.apache.parquet"
_SVG_POLICY = "default-src 'none'; style-src 'unsafe-inline'; sandbox"


def router(repository: Repository, picture: Picture, settings: WebSettings) -> APIRouter:
    """Build the routes of the runs."""
    api = APIRouter(prefix="/runs", tags=["runs"])

    @api.get("", response_model=RunPage, responses=responses(), summary="Runs, the newest first")
    def runs(request: Request, cursor: Cursor = None, limit: Limit = 50, axis: OfAxis = None) -> Response:
        """Page through the runs, those that were refused or failed with their reasons."""
        found = repository.runs(limit=limit + 1, before=cursor, axis=axis)
        more = found[limit - 1].id if len(found) > limit else None
        return tagged(request, RunPage(items=[run_view(run) for run in found[:limit]], next_cursor=more))

    @api.get(
        "/{run_id}", response_model=RunDetail, responses=responses(404), summary="One run with its steps"
    )
    def run(request: Request, run_id: RunId) -> Response:
        """Show a run: each axis' answer by each method, each step, the reason of each refusal."""
        return tagged(request, _detail(repository, settings, run_id))

    @api.get(
        "/{run_id}/capture",
        response_class=FileResponse,
        responses={200: {"content": {_PARQUET: {}}, "description": "The capture."}, **responses(404)},
        summary="A run's capture",
    )
    def capture(run_id: RunId) -> FileResponse:
        """Download what a run recorded, in the capture format (Parquet)."""
        return _capture(repository.run(run_id), settings)

    @api.get(
        "/{run_id}/picture",
        response_class=Response,
        responses={200: {"content": {"image/svg+xml": {}}, "description": "The picture."}, **responses(404)},
        summary="A picture of one step",
    )
    def step_picture(run_id: RunId, axis: Axis, step: Step = 0) -> Response:
        """Draw one step: motor and load acceleration, and where the flanks part and meet."""
        drawn = picture(repository.run(run_id), axis, step)
        if drawn is None:
            raise _absent(f"run {run_id} has no step {step} of axis {axis!r} to show")
        headers = {"Content-Security-Policy": _SVG_POLICY, "Cache-Control": "private, max-age=3600"}
        return Response(drawn, media_type="image/svg+xml", headers=headers)

    return api


def _detail(repository: Repository, settings: WebSettings, run_id: int) -> RunDetail:
    checks = repository.models.explanations(run_id=run_id)
    return run_detail(repository.run(run_id), repository.outcomes(run_id), checks, settings.moved_masses)


def _capture(run: RunRecord, settings: WebSettings) -> FileResponse:
    if run.capture is None:
        raise _absent(f"run {run.id} left no capture: it is not finished, or failed before it had recorded")
    folder = settings.captures_folder.resolve()
    path = (folder / run.capture.path).resolve()
    if not path.is_relative_to(folder) or not path.is_file():
        raise _absent(
            f"the capture of run {run.id} is no longer in the captures' folder: moved or deleted by hand"
        )
    headers = {"ETag": f'"{run.capture.sha256}"', "Cache-Control": "private"}
    return FileResponse(path, media_type=_PARQUET, filename=path.name, headers=headers)


def _absent(detail: str) -> ProblemError:
    return ProblemError(HTTPStatus.NOT_FOUND, "nothing-to-show", "Nothing to show", detail)
