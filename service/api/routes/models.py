"""What the models of the axes lack: explanations of runs, and the revisions that are proposed and decided."""

from __future__ import annotations

from http import HTTPStatus
from pathlib import Path as FilePath
from typing import Annotated

from fastapi import APIRouter, Path, Query, Request, Response
from fastapi.responses import FileResponse

from service.api.model_schemas import (
    Decision,
    ExplainAccepted,
    ExplainRequest,
    Explanations,
    ExplanationView,
    RevisionDetail,
    Revisions,
)
from service.api.model_views import (
    EXPLANATIONS,
    explanation_view,
    model_check_view,
    revision_detail,
    revision_view,
)
from service.api.ports import Loop, Report, WebSettings
from service.api.problems import ProblemError, responses
from service.api.replies import tagged
from service.api.routes.runs import LARGEST, RunId
from service.runs.deciding import AxisGoneError
from service.runs.pairs import NothingToExplain
from service.store.errors import AlreadyDecidedError
from service.store.model_records import RevisionRecord, RevisionState
from service.store.repository import Repository

ExplanationId = Annotated[int, Path(ge=1, le=LARGEST, description="The explanation's number.")]
RevisionId = Annotated[int, Path(ge=1, le=LARGEST, description="The revision's number.")]
OfAxis = Annotated[str | None, Query(max_length=64, description="Only those of this axis.")]
InState = Annotated[RevisionState | None, Query(description="Only those in this state.")]

_LOCATION = {"headers": {"Location": {"description": "The explanation.", "schema": {"type": "string"}}}}
_PARQUET = "application/vnd.apache.parquet"
_PAGE_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "private",
}


def router(repository: Repository, loop: Loop, report: Report, settings: WebSettings) -> APIRouter:
    """Build the routes of the explanations and revisions."""
    api = APIRouter(tags=["models"])
    _add_explaining(api, repository, loop)
    _add_results(api, repository, report, settings)
    _add_revisions(api, repository, report)
    _add_decisions(api, loop)
    return api


def _add_explaining(api: APIRouter, repository: Repository, loop: Loop) -> None:
    @api.post(
        "/runs/{run_id}/explanations",
        status_code=202,
        responses={202: _LOCATION, **responses(404, 409)},
        summary="Explain a run: what does the model lack?",
    )
    def explain(run_id: RunId, response: Response, body: ExplainRequest | None = None) -> ExplainAccepted:
        """Fit the models to earlier runs and judge them on this one. Takes minutes; nothing moves."""
        try:
            number = loop.explain(run_id, body.train_run_ids if body else ())
        except NothingToExplain as error:
            raise ProblemError(
                HTTPStatus.CONFLICT, error.kind, "The run cannot be explained", str(error)
            ) from error
        location = f"{EXPLANATIONS}/{number}"
        response.headers["Location"] = location
        train = list(repository.models.explanation(number).train_run_ids)
        return ExplainAccepted(id=number, location=location, train_run_ids=train)

    @api.get(
        "/runs/{run_id}/explanations",
        response_model=Explanations,
        responses=responses(404),
        summary="The explanations of a run",
    )
    def explanations(request: Request, run_id: RunId) -> Response:
        """List what was found of a run, by itself and asked for."""
        repository.run(run_id)
        found = repository.models.explanations(run_id=run_id)
        return tagged(request, Explanations(items=[model_check_view(one) for one in found]))


def _add_results(api: APIRouter, repository: Repository, report: Report, settings: WebSettings) -> None:
    @api.get(
        "/explanations/{explanation_id}",
        response_model=ExplanationView,
        responses=responses(404),
        summary="An explanation as it stands",
    )
    def explanation(request: Request, explanation_id: ExplanationId) -> Response:
        """Show the finding of each axis with the error before and after, or why there is none."""
        return tagged(request, explanation_view(repository.models.explanation(explanation_id)))

    @api.get(
        "/explanations/{explanation_id}/report",
        response_class=Response,
        responses={200: {"content": {"text/html": {}}, "description": "The page."}, **responses(404)},
        summary="The page about an explanation",
    )
    def page(explanation_id: ExplanationId) -> Response:
        """Write the page: measured and predicted, before and after, what was tried, what it means."""
        return _page(repository, report, explanation_id)

    @api.get(
        "/explanations/{explanation_id}/predictions",
        response_class=FileResponse,
        responses={200: {"content": {_PARQUET: {}}, "description": "One row per sample."}, **responses(404)},
        summary="The predictions before and after",
    )
    def predictions(explanation_id: ExplanationId) -> FileResponse:
        """Download the predictions for the run (Parquet): time [s], value in the channel's unit."""
        kept = repository.models.explanation(explanation_id).predictions_path
        path = None if kept is None else _inside(settings.captures_folder, kept)
        if path is None:
            raise _absent(
                f"explanation {explanation_id} has no predictions: it found nothing, or they were deleted"
            )
        return FileResponse(path, media_type=_PARQUET, filename=path.name)


def _add_revisions(api: APIRouter, repository: Repository, report: Report) -> None:
    @api.get(
        "/revisions", response_model=Revisions, responses=responses(), summary="Model revisions, newest first"
    )
    def revisions(request: Request, axis: OfAxis = None, state: InState = None) -> Response:
        """List the model revisions: proposed, accepted and rejected."""
        found = repository.models.revisions(axis, state)
        return tagged(request, Revisions(items=[revision_view(one) for one in found]))

    @api.get(
        "/revisions/{revision_id}",
        response_model=RevisionDetail,
        responses=responses(404),
        summary="A revision",
    )
    def revision(request: Request, revision_id: RevisionId) -> Response:
        """Show a model revision with the finding that it came of."""
        return tagged(request, revision_detail(repository.models.revision(revision_id)))

    @api.get(
        "/revisions/{revision_id}/report",
        response_class=Response,
        responses={200: {"content": {"text/html": {}}, "description": "The page."}, **responses(404)},
        summary="The page about a revision",
    )
    def page(revision_id: RevisionId) -> Response:
        """Write the page about the explanation that the revision came of."""
        number = repository.models.revision(revision_id).explanation_id
        if number is None:
            raise _absent(f"revision {revision_id} came of no stored explanation")
        return _page(repository, report, number)


def _add_decisions(api: APIRouter, loop: Loop) -> None:
    @api.post(
        "/revisions/{revision_id}/accept", responses=responses(404, 409), summary="Accept a model revision"
    )
    def accept(revision_id: RevisionId, body: Decision) -> RevisionDetail:
        """Compute the axis' values with it from now on, and restate its history as a series beside the old one."""
        return revision_detail(_decided(loop, revision_id, body, accept=True))

    @api.post(
        "/revisions/{revision_id}/reject", responses=responses(404, 409), summary="Reject a model revision"
    )
    def reject(revision_id: RevisionId, body: Decision) -> RevisionDetail:
        """Leave the axis' model as it is; the same finding is not proposed again."""
        return revision_detail(_decided(loop, revision_id, body, accept=False))


def _decided(loop: Loop, revision_id: int, body: Decision, *, accept: bool) -> RevisionRecord:
    try:
        return loop.decide(revision_id, accept=accept, by=body.by, note=body.note or None)
    except AlreadyDecidedError as error:
        raise ProblemError(HTTPStatus.CONFLICT, "already-decided", "Decided before", str(error)) from error
    except AxisGoneError as error:
        raise ProblemError(
            HTTPStatus.CONFLICT, "axis-gone", "The axis is no longer there", str(error)
        ) from error


def _page(repository: Repository, report: Report, explanation_id: int) -> Response:
    record = repository.models.explanation(explanation_id)
    page = report(record)
    if page is None:
        raise _absent(
            f"explanation {explanation_id} is {record.state}: {record.detail or 'it is not finished'}"
        )
    return Response(page, media_type="text/html", headers=_PAGE_HEADERS)


def _inside(folder: FilePath, name: str) -> FilePath | None:
    path = (folder / name).resolve()
    return path if path.is_relative_to(folder.resolve()) and path.is_file() else None


def _absent(detail: str) -> ProblemError:
    return ProblemError(HTTPStatus.NOT_FOUND, "nothing-to-show", "Nothing to show", detail)
