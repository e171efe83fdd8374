"""Explanations and revisions as the API shows them."""

from __future__ import annotations

from service.api.model_schemas import (
    ExplanationBody,
    ExplanationView,
    FindingView,
    ModelCheckView,
    RevisionDetail,
    RevisionView,
    SeparatingMoveView,
    StepsView,
)
from service.report.words import finding_in_words
from service.store.model_records import ExplanationRecord, RevisionRecord
from service.store.records import StepParameters

EXPLANATIONS = "/api/v1/explanations"


def model_check_view(record: ExplanationRecord) -> ModelCheckView:
    """Show an explanation in short."""
    axes = () if record.found is None else record.found["axes"]
    return ModelCheckView(
        id=record.id,
        run_id=record.run_id,
        train_run_ids=list(record.train_run_ids),
        kind=record.kind,
        state=record.state,
        detail=record.detail,
        requested_at=record.requested_at,
        finished_at=record.finished_at,
        in_words={axis["axis"]: finding_in_words(axis) for axis in axes},
        separating_moves={
            axis["axis"]: SeparatingMoveView.model_validate(axis["separating_move"])
            for axis in axes
            if axis.get("separating_move")
        },
        report=f"{EXPLANATIONS}/{record.id}/report" if record.found is not None else None,
    )


def explanation_view(record: ExplanationRecord) -> ExplanationView:
    """Show an explanation."""
    found = None if record.found is None else ExplanationBody.model_validate(record.found)
    return ExplanationView(**dict(model_check_view(record)), found=found)


def revision_view(record: RevisionRecord) -> RevisionView:
    """Show a revision in short."""
    finding = record.finding
    move = finding.get("separating_move")
    return RevisionView(
        id=record.id,
        axis=record.axis,
        state=record.state,
        effects=list(record.effects),
        in_words=finding_in_words(finding),
        separating_move=SeparatingMoveView.model_validate(move) if move else None,
        series=record.series,
        backlash_before_m=finding["before"]["backlash_m"],
        backlash_after_m=finding["after"]["backlash_m"],
        run_id=record.run_id,
        explanation_id=record.explanation_id,
        created_at=record.created_at,
        decided_at=record.decided_at,
        decided_by=record.decided_by,
        note=record.note,
        report=None if record.explanation_id is None else f"{EXPLANATIONS}/{record.explanation_id}/report",
    )


def revision_detail(record: RevisionRecord) -> RevisionDetail:
    """Show a revision with its finding."""
    finding = FindingView.model_validate(record.finding)
    return RevisionDetail(**dict(revision_view(record)), finding=finding)


def steps_view(steps: StepParameters | None) -> StepsView | None:
    """Show the steps of a run that were not the configured ones."""
    if steps is None:
        return None
    return StepsView(
        length_m=steps.length,
        jerk_m_s3=steps.jerk,
        direction=steps.direction,
        positions_m=list(steps.places),
    )
