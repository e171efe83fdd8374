"""What the API needs of the house beside the store, and what it is told when it is built."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Protocol

from service.store.model_records import ExplanationRecord, RevisionRecord
from service.store.records import CheckAnswer, Progress, RunRecord, StepParameters, StepsAnswer

Picture = Callable[[RunRecord, str, int], str | None]
"""Draw one step of a run as SVG: (run, axis, step index); None where the run has no such step to show."""


class Checks(Protocol):
    """The box of one run: what the API asks of the machine. Both calls return at once."""

    def request(self, target: str, idempotency_key: str | None) -> CheckAnswer:
        """Put a check of an axis or a group into the box, or say why not."""

    def request_steps(self, target: str, steps: StepParameters) -> StepsAnswer:
        """Put a run of other steps than the configured ones into the box, or say why not."""

    def progress(self) -> Progress | None:
        """Say where the run in the box stands; None when the machine is idle."""


class Loop(Protocol):
    """What is computed beside the runs. All calls return at once."""

    def explain(self, run_id: int, train: Sequence[int]) -> int:
        """Have a run explained; the explanation's id. Raises NothingToExplain, UnknownRecordError."""

    def decide(self, revision_id: int, *, accept: bool, by: str, note: str | None) -> RevisionRecord:
        """Accept or reject a proposed model revision.

        Raises AlreadyDecidedError, AxisGoneError, UnknownRecordError.
        """

    def progress(self) -> tuple[int, str] | None:
        """The run that is being computed and what is done; None at rest."""


Report = Callable[[ExplanationRecord], str | None]
"""Write the page about an explanation as HTML; None where there is nothing to write about."""


@dataclass(frozen=True)
class Masses:
    """Moved masses [kg] as configured, None where they are not: an axis' ``own``, and its gantry's ``first`` axis'."""

    own: float | None = None
    first: float | None = None


NO_MASSES = Masses()


@dataclass(frozen=True)
class WebSettings:
    """What the web application is told.

    ``token_sha256`` is the SHA-256 (hexadecimal) of the bearer token that every call must carry, None for
    none: right on loopback only. Without a token only requests to a name in ``hosts`` are answered, so that
    no web site can reach the machine through a technician's browser (DNS rebinding).
    ``diagnostic_positions`` is where along its rack a check of an axis steps [m], for those that travel;
    ``moved_masses`` are the masses that are configured, by axis.
    """

    version: str
    captures_folder: Path
    token_sha256: str | None = None
    diagnostic_positions: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    moved_masses: Mapping[str, Masses] = field(default_factory=dict)
    hosts: tuple[str, ...] = ("127.0.0.1", "localhost", "[::1]")


def nothing_missing() -> Sequence[str]:
    """Report readiness when the composition has nothing to say."""
    return ()


def now_utc() -> datetime:
    """Return the wall time."""
    return datetime.now(UTC)
