"""A new value in its axis' history: the trend with it, and what becomes of the axis' alarms.

Alarms go by the axis' current series alone: the declared model's until a revision is accepted, the revised
model's from then on. The other series goes on beside it and raises nothing. Values that are restated for older
runs raise and clear nothing either; the next newly measured value is judged with them.

While a finding is proposed and undecided, alarms are raised as ever, since nobody has said yet that the change
is the model's; the alarm says that a decision is waiting. The trend rests on several values, so that a finding
of the first nights is there before an alarm for the same effect is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime

from service.backlash.results import AxisResult
from service.monitoring.alarm import Band, Change, judge
from service.report.words import named
from service.store.model_records import RevisionRecord
from service.store.records import DECLARED, AlarmChange, AxisOutcome, AxisRecord, RunRecord
from service.store.repository import Repository

Judged = tuple[AxisOutcome, tuple[AlarmChange, ...]]


def judge_result(
    repository: Repository,
    axis: AxisRecord,
    result: AxisResult,
    at: datetime,
    revision: RevisionRecord | None = None,
) -> Judged:
    """Set a newly measured value into the history of its series, the declared one or a revision's."""
    series = DECLARED if revision is None else revision.series
    history = repository.history(axis.name, result.method, series=series)
    history = history.with_value(at.timestamp(), result.backlash)
    band = None
    if axis.reference is not None and axis.tolerance is not None:
        band = Band(axis.reference, axis.tolerance)
    judgement = judge(history.t, history.b, band, repository.active_alarms(axis.name))
    outcome = AxisOutcome(
        result,
        series=series,
        trend=judgement.trend if result.verdict == "ok" else None,
        model_revision=None if revision is None else revision.id,
    )
    if series != axis.series:
        return outcome, ()
    said = _context(revision, repository.models.revisions(axis.name, "proposed"))
    return outcome, tuple(AlarmChange(axis.name, _with(change, said)) for change in judgement.changes)


def beside(result: AxisResult) -> AxisOutcome:
    """An answer that stands beside the axis' value and enters no trend."""
    return AxisOutcome(result, reported=False)


def is_measurement(run: RunRecord) -> bool:
    """Whether a run measures its axes; one of other steps serves the model alone."""
    return run.steps is None


def _context(revision: RevisionRecord | None, proposed: Sequence[RevisionRecord]) -> str:
    parts = []
    if revision is not None:
        parts.append(f"values with model revision {revision.id} ({named(revision.effects)})")
    if proposed:
        waiting = proposed[0]
        parts.append(
            f"model revision {waiting.id} ({named(waiting.effects)}) is proposed and waits for a decision, so that "
            "part of the change may be the model's and not the machine's"
        )
    return "; ".join(parts)


def _with(change: Change, said: str) -> Change:
    return replace(change, detail=f"{change.detail}; {said}") if said else change
