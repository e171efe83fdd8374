"""What every schema of the API shares."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

Interval = tuple[float, float]

UTC_TIME = "UTC, RFC 3339"


class Schema(BaseModel):
    """The base of all: a key that is not known is an error."""

    model_config = ConfigDict(extra="forbid")
