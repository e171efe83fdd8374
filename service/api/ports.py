"""What the API needs of the house beside the store, and what it is told when it is built."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Protocol

from service.store.records import CheckAnswer, Progress, RunRecord

Picture = Callable[[RunRecord, str, int], str | None]
"""Draw one step of a run as SVG: (run, axis, step index); None where the run has no such step to show."""


class Checks(Protocol):
    """The box of one run: what the API asks of the machine. Both calls return at once."""

    def request(self, target: str, idempotency_key: str | None) -> CheckAnswer:
        """Put a check of an axis or a group into the box, or say why not."""

    def progress(self) -> Progress | None:
        """Say where the run in the box stands; None when the machine is idle."""


@dataclass(frozen=True)
class WebSettings:
    """What the web application is told.

    ``token_sha256`` is the SHA-256 (hexadecimal) of the bearer token that every call must carry, None for
    none: right on loopback only. Without a token only requests to a name in ``hosts`` are answered, so that
    no web site can reach the machine through a technician's browser (DNS rebinding).
    """

    version: str
    captures_folder: Path
    token_sha256: str | None = None
    hosts: tuple[str, ...] = ("127.0.0.1", "localhost", "[::1]")


def nothing_missing() -> Sequence[str]:
    """Report readiness when the composition has nothing to say."""
    return ()


def now_utc() -> datetime:
    """Return the wall time."""
    return datetime.now(UTC)
