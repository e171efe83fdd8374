"""Errors as RFC 9457 problem+json, for everything that can go wrong, 404, 405 and 500 included."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.exceptions import HTTPException
from starlette.routing import Match

from service.store.errors import UnknownRecordError

log = logging.getLogger(__name__)

MEDIA_TYPE = "application/problem+json"


class InvalidField(BaseModel):
    """One field of a request that was not understood."""

    model_config = ConfigDict(extra="forbid")
    location: str = Field(description="Where it stands: body, query, path or header, and the field's name.")
    message: str = Field(description="What is wrong with it, in a sentence.")


class Problem(BaseModel):
    """An error by RFC 9457."""

    model_config = ConfigDict(extra="forbid")
    type: str = Field(description="URN that names the kind of problem, or about:blank.")
    title: str = Field(description="The kind of problem in a few words, the same for all of its kind.")
    status: int = Field(description="The HTTP status code, without a unit.")
    detail: str = Field(description="What went wrong this time, the likely cause, and what to do.")
    instance: str = Field(description="The path that was asked for.")
    run_id: int | None = Field(default=None, description="The run that is in the way, if one is.")
    errors: list[InvalidField] | None = Field(
        default=None, description="The fields that were not understood."
    )


class ProblemError(HTTPException):
    """An HTTP error with the members of a problem."""

    def __init__(
        self, status: HTTPStatus, kind: str, title: str, detail: str, *, run_id: int | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> None:  # fmt: skip
        """Name the kind (last part of the URN), its title and what happened."""
        super().__init__(status, detail, dict(headers or {}))
        self.kind, self.title, self.run_id = kind, title, run_id


def responses(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Describe the problems of a route for OpenAPI; those that every route can have are included.

    A body can be no JSON (400), of unknown length (411) or too large (413), on any route that is sent one.
    """
    schema = {"schema": {"$ref": "#/components/schemas/Problem"}}
    every = sorted({400, 401, 403, 411, 413, 422, 500, *statuses})
    return {code: {"description": HTTPStatus(code).phrase, "content": {MEDIA_TYPE: schema}} for code in every}


def install(app: FastAPI) -> None:
    """Answer every error of an application as problem+json."""
    app.add_exception_handler(HTTPException, respond_http)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(UnknownRecordError, _unknown)
    app.add_exception_handler(Exception, _unexpected)


def _respond(request: Request, problem: Problem, headers: Mapping[str, str] | None = None) -> JSONResponse:
    body = problem.model_dump(exclude_none=True)
    body["instance"] = request.url.path
    return JSONResponse(body, problem.status, dict(headers or {}), media_type=MEDIA_TYPE)


def _problem(status: int, kind: str, title: str, detail: str, **more: Any) -> Problem:
    urn = f"urn:flankwatch:problem:{kind}" if kind else "about:blank"
    return Problem(type=urn, title=title, status=status, detail=detail, instance="", **more)


async def respond_http(request: Request, error: Exception) -> JSONResponse:
    """Answer an HTTP error as a problem."""
    assert isinstance(error, HTTPException)
    headers = dict(error.headers or {})
    if isinstance(error, ProblemError):
        found = _problem(error.status_code, error.kind, error.title, error.detail, run_id=error.run_id)
        return _respond(request, found, headers)
    phrase = HTTPStatus(error.status_code).phrase
    detail = f"{request.method} {request.url.path}: {str(error.detail).lower()}"
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        headers["Allow"] = ", ".join(sorted(_allowed(request)))
        detail = f"{request.url.path} answers {headers['Allow']} only"
    return _respond(request, _problem(error.status_code, "", phrase, detail), headers)


async def _invalid(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    fields = [_field(item) for item in error.errors()]
    detail = "; ".join(f"{field.location}: {field.message}" for field in fields)
    return _respond(request, _problem(422, "invalid-request", "Invalid request", detail, errors=fields))


def _field(item: Mapping[str, Any]) -> InvalidField:
    """Name one fault; a body that is not even an object is told what it should be."""
    kind = item.get("type")
    if kind == "json_invalid":
        where = f" (at character {item['loc'][-1]})" if isinstance(item["loc"][-1], int) else ""
        return InvalidField(location="body", message=f"is not JSON{where}")
    if item["loc"] == ("body",) and kind in ("model_attributes_type", "missing"):
        told = "is not a JSON object; send one, with the header Content-Type: application/json"
        return InvalidField(location="body", message=told)
    return InvalidField(
        location=".".join(str(part) for part in item["loc"]),
        message=item["msg"].removeprefix("Value error, "),
    )


async def _unknown(request: Request, error: Exception) -> JSONResponse:
    return _respond(request, _problem(404, "unknown-record", "Unknown record", str(error)))


async def _unexpected(request: Request, error: Exception) -> JSONResponse:
    log.error("%s %s failed", request.method, request.url.path, exc_info=error)
    detail = "an error in Flankwatch itself; the journal of the service holds its trace"
    return _respond(request, _problem(500, "internal", "Internal error", detail))


def _allowed(request: Request) -> set[str]:
    """All methods under which some route knows the path; Starlette names only those of the first."""
    app: FastAPI = request.app
    asked = ({**request.scope, "method": method} for method in ("DELETE", "GET", "PATCH", "POST", "PUT"))
    return {
        scope["method"] for scope in asked for route in app.routes if route.matches(scope)[0] is Match.FULL
    }
