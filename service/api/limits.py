"""How much a request may bring: every body of this API is a few lines of JSON."""

from __future__ import annotations

from http import HTTPStatus

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from service.api.problems import ProblemError, respond_http

LARGEST_BODY = 64 * 1024


class BodyLimit:
    """Middleware that answers 413 to a large body and 411 to one of unknown length, before reading it."""

    def __init__(self, app: ASGIApp) -> None:
        """Stand before ``app``."""
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        refusal = _refusal(Headers(scope=scope)) if scope["type"] == "http" else None
        if refusal is None:
            await self.app(scope, receive, send)
        else:
            response = await respond_http(Request(scope), refusal)
            await response(scope, receive, send)


def _refusal(headers: Headers) -> ProblemError | None:
    if "transfer-encoding" in headers:
        detail = "send the body with its Content-Length, not in chunks"
        return ProblemError(HTTPStatus.LENGTH_REQUIRED, "length-required", "Length required", detail)
    length = headers.get("content-length", "0")
    if length.isdecimal() and int(length) <= LARGEST_BODY:
        return None
    detail = f"a body has at most {LARGEST_BODY} bytes"
    return ProblemError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "too-large", "Body too large", detail)
