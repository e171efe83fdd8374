"""One explanation of one run, from its captures to a stored verdict and, where it is confirmed, a proposal."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Literal

from service.captures import CaptureError
from service.captures.report import write_predictions
from service.identification.explanation import Accepted, CannotExplain, Explanation
from service.runs.analysis import AnalysisError, AnalysisStopped
from service.runs.deciding import decide
from service.runs.diagnostic_run import Workshop
from service.runs.pairs import NothingToExplain, known_capture
from service.runs.proposing import is_clear, to_propose
from service.store.model_records import ExplanationEnd, ExplanationRecord

log = logging.getLogger(__name__)

Policy = Literal["ask", "accept_when_clear"]
POLICY_NAME = "policy accept_when_clear"


@dataclass(frozen=True)
class _Answer:
    """What the analysis said, or why it said nothing."""

    state: Literal["done", "cannot_tell", "skipped", "failed"]
    explanation: Explanation | None = None
    detail: str | None = None


def explain_run(
    workshop: Workshop, explanation_id: int, policy: Policy, tell: Callable[[str], None]
) -> tuple[str, ...]:
    """Compute a queued explanation, store its verdict, propose what is confirmed; the axes revised by policy."""
    models = workshop.repository.models
    models.begin(explanation_id)
    order = models.explanation(explanation_id)
    answer = _answer(workshop, order, tell)
    end = _end(workshop, order, answer)
    models.finish(end)
    if answer.explanation is None:
        log.info("explanation %d of run %d: %s: %s", order.id, order.run_id, end.state, end.detail)
        return ()
    return _propose(workshop, models.explanation(explanation_id), policy, end.finished_at)


def _answer(workshop: Workshop, order: ExplanationRecord, tell: Callable[[str], None]) -> _Answer:
    """Ask the analysis process; whatever forbids a verdict becomes its reason."""
    repository, folder = workshop.repository, workshop.captures
    try:
        train = [known_capture(folder, repository.run(number)) for number in order.train_run_ids]
        validate = known_capture(folder, repository.run(order.run_id))
        return _Answer("done", workshop.analysis.explain(train, validate, tell, _accepted(workshop, order)))
    except (CannotExplain, CaptureError, NothingToExplain) as error:
        return _Answer("cannot_tell", detail=str(error))
    except AnalysisStopped:
        return _Answer(
            "skipped", detail="the service ended before this was done; ask for it again if it matters"
        )
    except AnalysisError as error:
        return _Answer("failed", detail=str(error))


def _accepted(workshop: Workshop, order: ExplanationRecord) -> dict[str, Accepted]:
    """What is in force beyond the declared models of a run's axes."""
    models = workshop.repository.models
    revisions = {axis: models.in_force(axis) for axis in workshop.repository.run(order.run_id).axes}
    return {
        axis: Accepted(revision.effects, revision.numbers)
        for axis, revision in revisions.items()
        if revision is not None
    }


def _end(workshop: Workshop, order: ExplanationRecord, answer: _Answer) -> ExplanationEnd:
    now = workshop.wall_time()
    if answer.explanation is None:
        return ExplanationEnd(order.id, answer.state, now, answer.detail)
    path = _keep_predictions(workshop, order, answer.explanation)
    return ExplanationEnd(order.id, "done", now, None, answer.explanation.as_json(), path)


def _keep_predictions(workshop: Workshop, order: ExplanationRecord, found: Explanation) -> str | None:
    """Write the predictions beside the run's capture; without them the verdict is none the worse."""
    capture = workshop.repository.run(order.run_id).capture
    if capture is None:
        return None
    path = Path(capture.path).with_suffix(f".explanation-{order.id}.parquet")
    try:
        write_predictions(found.predictions(), workshop.captures / path)
    except OSError:
        log.exception("the predictions of explanation %d could not be written", order.id)
        return None
    return str(path)


def _propose(workshop: Workshop, now: ExplanationRecord, policy: Policy, at: datetime) -> tuple[str, ...]:
    """Propose a revision for each axis whose finding is confirmed; accept the clear ones where told to."""
    models = workshop.repository.models
    accepted = []
    for axis in workshop.repository.run(now.run_id).axes:
        others = [other for other in models.explanations(axis=axis) if other.id != now.id]
        finding = to_propose(now, others, axis, models.revisions(axis), models.in_force(axis))
        if finding is None:
            continue
        revision_id = models.propose(axis, finding, at, run_id=now.run_id, explanation_id=now.id)
        log.info("model revision %d of axis %s is proposed: %s", revision_id, axis, finding["effects"])
        if policy == "accept_when_clear" and is_clear(finding):
            decide(workshop, revision_id, accept=True, by=POLICY_NAME, note="the finding was clear")
            accepted.append(axis)
    return tuple(accepted)
