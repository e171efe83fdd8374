"""What many routes share: ETag with 304, and cursors."""

from __future__ import annotations

import base64
import hashlib
from datetime import datetime

from fastapi import Request, Response
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel


def tagged(request: Request, body: BaseModel) -> Response:
    """Reply with an ETag of the content, or with 304 when the client has just that."""
    content = body.model_dump_json().encode()
    tag = f'"{hashlib.sha256(content).hexdigest()[:32]}"'
    headers = {"ETag": tag, "Cache-Control": "no-cache"}
    if _matches(request.headers.get("If-None-Match"), tag):
        return Response(status_code=304, headers=headers)
    return Response(content, media_type="application/json", headers=headers)


def _matches(given: str | None, tag: str) -> bool:
    """Compare weakly, as RFC 9110 section 13.1.2 wants it."""
    tags = {part.strip().removeprefix("W/") for part in (given or "").split(",")}
    return tag in tags or "*" in tags


def value_cursor(measured_at: datetime, value_id: int) -> str:
    """Write the place of a value in a history as an opaque cursor."""
    return base64.urlsafe_b64encode(f"{measured_at.isoformat()}|{value_id}".encode()).decode()


def read_value_cursor(cursor: str | None) -> tuple[datetime, int] | None:
    """Read a cursor; a foreign one is a request that cannot be understood."""
    if cursor is None:
        return None
    try:
        at, _, value_id = base64.urlsafe_b64decode(cursor.encode("ascii")).decode().partition("|")
        measured_at, number = datetime.fromisoformat(at), int(value_id)
        if measured_at.tzinfo is None or not 0 <= number < 2**63:
            raise ValueError(cursor)
    except (ValueError, OverflowError) as error:
        raise _invalid_cursor() from error
    return measured_at, number


def _invalid_cursor() -> RequestValidationError:
    return RequestValidationError(
        [
            {
                "loc": ("query", "cursor"),
                "msg": "not a cursor of this list; take next_cursor of the page before",
            }
        ]
    )
