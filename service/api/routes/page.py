"""The technician's page: three files from this package, and nothing from anywhere else."""

from __future__ import annotations

from importlib.resources import files

from fastapi import APIRouter, Response

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}
_FILES = {
    "/": ("page.html", "text/html"),
    "/page.js": ("page.js", "text/javascript"),
    "/page.css": ("page.css", "text/css"),
}


def router() -> APIRouter:
    """Build the routes of the page's files, which are read once."""
    api = APIRouter(include_in_schema=False)
    folder = files("service.api") / "static"
    for path, (name, media_type) in _FILES.items():
        _add(api, path, (folder / name).read_bytes(), media_type)
    return api


def _add(api: APIRouter, path: str, content: bytes, media_type: str) -> None:
    @api.get(path)
    def file() -> Response:
        return Response(content, media_type=media_type, headers=_HEADERS)
