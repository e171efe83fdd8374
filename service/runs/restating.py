"""Values with a revised model: of each new run, and of the older ones, as a series of its own beside the declared.

An accepted revision begins a series. Every later run is computed with it as well; the runs before are computed
anew, newest first, so that the trend has its history. Nothing that was stored is changed. A run that the revised
model does not explain is refused in that series, with the reason; its declared value stands beside it.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence

from service.backlash.results import AxisResult
from service.captures import CaptureError
from service.identification.explanation import CannotExplain
from service.runs.analysis import AnalysisError
from service.runs.diagnostic_run import Workshop
from service.runs.judging import is_measurement, judge_result
from service.runs.pairs import NothingToExplain, is_sound, known_capture, neighbours
from service.store.model_records import RevisionRecord
from service.store.records import AlarmChange, AxisOutcome, RunRecord

log = logging.getLogger(__name__)

RESTATED = 30
"""Runs before the decision that are computed anew; chosen: three windows of the trend (its level wants nine)."""


def to_restate(workshop: Workshop, axis: str) -> tuple[int, ...]:
    """Return the runs of an axis that lack a value of its accepted revision, the newest first."""
    repository = workshop.repository
    revision = repository.models.in_force(axis)
    if revision is None:
        return ()
    runs = repository.runs(axis=axis, limit=2 * RESTATED)
    measured = [run for run in runs if is_measurement(run) and is_sound(run)][:RESTATED]
    return tuple(run.id for run in measured if not _has_value(workshop, run.id, revision))


def restate(workshop: Workshop, run_id: int) -> None:
    """Compute the value of a run with the accepted revisions of its axes, where it has none yet, and store it.

    A value that cannot be computed (capture gone, program fault) is left out, and said in the journal.
    """
    run = workshop.repository.run(run_id)
    revisions = {axis: workshop.repository.models.in_force(axis) for axis in run.axes}
    open_ones = {
        axis: revision
        for axis, revision in revisions.items()
        if revision is not None and not _has_value(workshop, run_id, revision)
    }
    if not open_ones or not (is_measurement(run) and is_sound(run)):
        return
    try:
        results = _computed(workshop, run, {axis: r.effects for axis, r in open_ones.items()})
    except (AnalysisError, CaptureError, CannotExplain, NothingToExplain) as error:
        log.warning("run %d has no value with the revised model: %s", run_id, error)
        return
    _store(workshop, run, results, open_ones)


def _computed(
    workshop: Workshop, run: RunRecord, effects: Mapping[str, tuple[str, ...]]
) -> Sequence[AxisResult]:
    folder = workshop.captures
    others = [known_capture(folder, other) for other in neighbours(workshop.repository, folder, run)]
    return workshop.analysis.revised(known_capture(folder, run), effects, others)


def _store(
    workshop: Workshop,
    run: RunRecord,
    results: Sequence[AxisResult],
    revisions: Mapping[str, RevisionRecord],
) -> None:
    """Values of runs after the decision are judged; restated ones only enter the history."""
    repository = workshop.repository
    outcomes: list[AxisOutcome] = []
    changes: list[AlarmChange] = []
    at = run.finished_at or workshop.wall_time()
    for result in results:
        revision = revisions[result.axis]
        if revision.decided_at is None or at <= revision.decided_at:
            outcomes.append(AxisOutcome(result, series=revision.series, model_revision=revision.id))
            continue
        outcome, found = judge_result(repository, repository.axis(result.axis), result, at, revision)
        outcomes.append(outcome)
        changes += found
    repository.add_outcomes(run.id, outcomes)
    if changes:
        repository.change_alarms(changes, workshop.wall_time())


def _has_value(workshop: Workshop, run_id: int, revision: RevisionRecord) -> bool:
    outcomes = (value.outcome for value in workshop.repository.outcomes(run_id))
    return any(one.result.axis == revision.axis and one.series == revision.series for one in outcomes)
