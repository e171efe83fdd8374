"""Who may ask: a bearer token where one is set, and never a web site through a technician's browser."""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Callable
from http import HTTPStatus
from urllib.parse import urlsplit

from fastapi import Request

from service.api.ports import WebSettings
from service.api.problems import ProblemError

_SAFE = {"GET", "HEAD", "OPTIONS"}


def guard(settings: WebSettings) -> Callable[[Request], None]:
    """Build the dependency that every route of the API has."""

    def allow(request: Request) -> None:
        if settings.token_sha256 is None:
            _require_known_host(request, settings.hosts)
        else:
            _require_token(request, settings.token_sha256)
        if request.method not in _SAFE:
            _require_own_origin(request)

    return allow


def _require_token(request: Request, token_sha256: str) -> None:
    """Compare hashes in constant time; the token is random and long, so a slow hash would gain nothing."""
    scheme, _, token = request.headers.get("Authorization", "").partition(" ")
    given = hashlib.sha256(token.strip().encode()).hexdigest()
    if scheme.lower() != "bearer" or not hmac.compare_digest(given, token_sha256.lower()):
        raise ProblemError(
            HTTPStatus.UNAUTHORIZED,
            "unauthorised",
            "Token missing or wrong",
            "this service wants the header 'Authorization: Bearer <token>' with the token of its "
            "installation",
            headers={"WWW-Authenticate": "Bearer"},
        )


def _require_known_host(request: Request, hosts: tuple[str, ...]) -> None:
    asked = urlsplit(f"//{request.headers.get('Host', '')}").netloc
    name = asked.rpartition(":")[0] if not asked.endswith("]") and ":" in asked else asked
    if name.lower() not in hosts:
        raise ProblemError(
            HTTPStatus.FORBIDDEN,
            "unknown-host",
            "Not asked by a name of this machine",
            f"without a token this service answers {', '.join(hosts)} only, but was asked as {asked!r}",
        )


def _require_own_origin(request: Request) -> None:
    """Refuse what another web site's script sends: it could make the machine move."""
    origin = request.headers.get("Origin")
    if origin is not None and urlsplit(origin).netloc != request.headers.get("Host"):
        raise ProblemError(
            HTTPStatus.FORBIDDEN,
            "foreign-origin",
            "Asked by another web site",
            f"a page of {origin} sent this",
        )
