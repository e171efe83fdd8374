"""What the store knows of the axes' models: explanations of runs, and the model revisions that came of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal

ExplanationKind = Literal["background", "on_demand"]
ExplanationState = Literal["queued", "running", "done", "cannot_tell", "skipped", "failed"]
ExplanationEndState = Literal["done", "cannot_tell", "skipped", "failed"]
RevisionState = Literal["proposed", "accepted", "rejected"]


@dataclass(frozen=True)
class ExplanationOrder:
    """A run to be explained: the model is fitted to the train runs and judged on the run itself."""

    run_id: int
    train_run_ids: tuple[int, ...]
    kind: ExplanationKind
    requested_at: datetime


@dataclass(frozen=True)
class ExplanationRecord:
    """An explanation as it stands. ``found`` is its JSON object (keys and units as ``flankwatch explain --json``).

    ``detail`` says why there is none: the recordings allow no verdict (cannot_tell), it was not begun (skipped),
    or the program failed. ``predictions_path`` is relative to the captures' folder.
    """

    id: int
    run_id: int
    train_run_ids: tuple[int, ...]
    kind: ExplanationKind
    state: ExplanationState
    requested_at: datetime
    finished_at: datetime | None = None
    detail: str | None = None
    found: Mapping[str, Any] | None = None
    predictions_path: str | None = None

    def of_axis(self, axis: str) -> Mapping[str, Any] | None:
        """What was found for one axis, None where nothing was."""
        axes = () if self.found is None else self.found["axes"]
        return next((found for found in axes if found["axis"] == axis), None)


@dataclass(frozen=True)
class ExplanationEnd:
    """How an explanation ended; ``found`` is given for a done one and only there, ``detail`` for all others."""

    id: int
    state: ExplanationEndState
    finished_at: datetime
    detail: str | None = None
    found: Mapping[str, Any] | None = None
    predictions_path: str | None = None


@dataclass(frozen=True)
class RevisionRecord:
    """A model revision of an axis.

    ``finding`` is what the explanation says of the axis (effects, parameters, error before and after);
    ``run_id`` is the run that the finding was judged on, ``note`` what the person who decided left with it.
    """

    id: int
    axis: str
    state: RevisionState
    finding: Mapping[str, Any]
    created_at: datetime
    run_id: int | None = None
    decided_at: datetime | None = None
    decided_by: str | None = None
    note: str | None = None
    explanation_id: int | None = None

    @property
    def effects(self) -> tuple[str, ...]:
        """The effects that the revised model has beyond the declared one: those of the revision before, then those that
        were found beyond it, strongest first."""
        return (*self.finding.get("accepted", ()), *self.finding.get("effects", ()))

    @property
    def numbers(self) -> Mapping[str, float]:
        """The model's numbers as they were found, by the names and in the units of the finding."""
        found = self.finding.get("parameters", {})
        return {name: one["value"] for name, one in found.items() if one["value"] is not None}

    @property
    def series(self) -> str:
        """Name of the series of values that are computed with it."""
        return f"revision-{self.id}"
