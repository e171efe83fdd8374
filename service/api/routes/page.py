"""The technician's page: files of this package, and nothing from anywhere else."""

from __future__ import annotations

import base64
import hashlib
from importlib.resources import files

from fastapi import APIRouter, Response

from service.report.page import STYLE

_STYLE = base64.b64encode(hashlib.sha256(STYLE.encode()).digest()).decode()
"""Of the report's page: fetched with a token and opened, it inherits the policy of this one."""

_POLICY = (
    f"default-src 'none'; script-src 'self'; style-src 'self' 'sha256-{_STYLE}'; "
    "img-src 'self' blob:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}
_TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}


def router() -> APIRouter:
    """Build the routes of the page's files, which are read once."""
    api = APIRouter(include_in_schema=False)
    for file in (files("service.api") / "static").iterdir():
        media_type = _TYPES["." + file.name.rpartition(".")[2]]
        path = "/" if file.name == "page.html" else f"/static/{file.name}"
        _add(api, path, file.read_bytes(), media_type)
    return api


def _add(api: APIRouter, path: str, content: bytes, media_type: str) -> None:
    @api.get(path)
    def file() -> Response:
        return Response(content, media_type=media_type, headers=_HEADERS)
