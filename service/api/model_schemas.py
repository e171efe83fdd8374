"""What the API says and hears about the axes' models: explanations, revisions, moves. SI units in the names."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from service.api.base import UTC_TIME, Interval, Schema


class Found(BaseModel):
    """A part of what an explanation found; what a later version adds is passed on as it is."""

    model_config = ConfigDict(extra="allow")


class ErrorView(Found):
    """A model's error, in the channel's unit (acceleration: m/s²)."""

    train_rms: float | None = Field(description="RMS on the runs that were fitted, in the channel's unit.")
    validation_rms: float | None = Field(
        description="RMS on the run that was not fitted, in the channel's unit."
    )
    backlash_m: float | None = Field(description="Backlash by this model [m]; null without diagnostic moves.")
    interval_95_m: Interval | None = Field(description="95 % interval of the backlash [m]; null without one.")


class CandidateView(Found):
    """One effect that was tried."""

    effect: str = Field(description="The effect's name in the library.")
    validation_rms: float | None = Field(description="Held-out RMS with it, in the channel's unit.")
    p_value: float | None = Field(
        description="Chance of such a gain by luck, corrected for the search; no unit."
    )


class ParameterView(Found):
    """One number of the model."""

    value: float | None = Field(description="The value, in 'unit'.")
    std: float | None = Field(description="Its standard deviation, in 'unit'.")
    unit: str = Field(description="Unit of value and std.")


class SeparatingMoveView(Found):
    """The move that would tell two candidates apart."""

    length_m: float = Field(description="Length of a step [m].")
    jerk_m_s3: float = Field(description="Jerk of a step [m/s³].")
    direction: int = Field(description="Direction of the first step: 1 towards larger positions, -1 back.")
    position: str = Field(description="Where on the axis, in words.")
    why: str = Field(description="What it would show.")


class FindingView(Found):
    """What the model of one axis lacks."""

    axis: str = Field(description="The axis' name.")
    channel: str = Field(description="The channel whose residual was judged.")
    finding: Literal["effect", "none", "unknown"] = Field(
        description="A named effect, nothing, or something that no known effect explains."
    )
    effects: list[str] = Field(description="Names of the effects, the strongest first.")
    accepted: list[str] = Field(
        default=[],
        description="Effects that the model had by an accepted revision; 'effects' are beyond them.",
    )
    absent: list[str] = Field(
        default=[],
        description="Effects of the accepted revision that the run does not show; the declared model was judged.",
    )
    indistinguishable: list[list[str]] = Field(
        description="Groups of effects that these moves cannot tell apart."
    )
    separating_move: SeparatingMoveView | None = Field(
        description="The move that would; null where none is needed."
    )
    candidates: list[CandidateView] = Field(description="What was tried.")
    noise_rms: float | None = Field(
        description="The sensor's noise, measured at rest, in the channel's unit."
    )
    before: ErrorView = Field(description="The error of the declared model, or of the accepted one.")
    after: ErrorView = Field(description="The error with the effects.")
    parameters: dict[str, ParameterView] = Field(description="The model's numbers, by name.")


class ExplanationBody(Found):
    """What an explanation found."""

    axes: list[FindingView] = Field(description="One finding per axis.")


State = Literal["queued", "running", "done", "cannot_tell", "skipped", "failed"]


class ModelCheckView(Schema):
    """An explanation of a run in short."""

    id: int = Field(description="The explanation's number.")
    run_id: int = Field(description="The run that it judges.")
    train_run_ids: list[int] = Field(description="The runs that the model was fitted to.")
    kind: Literal["background", "on_demand"] = Field(
        description="Made by itself after the run, or asked for."
    )
    state: State = Field(
        description="'done' with a finding; 'cannot_tell' when the recordings allow none, 'skipped', 'failed'."
    )
    detail: str | None = Field(description="Why there is no finding; null where there is one, or before.")
    requested_at: datetime = Field(description=f"When it was asked for ({UTC_TIME}).")
    finished_at: datetime | None = Field(description=f"When it ended ({UTC_TIME}); null before.")
    in_words: dict[str, str] = Field(description="By axis, what was found, in a technician's words.")
    separating_moves: dict[str, SeparatingMoveView] = Field(
        description="By axis, the move that tells apart what looks alike; ask for it with POST /moves."
    )
    report: str | None = Field(description="Address of the page about it; null without a finding.")


class ExplanationView(ModelCheckView):
    """An explanation of a run."""

    found: ExplanationBody | None = Field(description="What was found; null unless 'done'.")


class Explanations(Schema):
    """The explanations of a run."""

    items: list[ModelCheckView] = Field(description="The explanations, the newest first.")


class ExplainRequest(Schema):
    """What to fit to."""

    train_run_ids: list[int] = Field(
        default=[],
        max_length=5,
        description="Runs to fit the model to; empty: the nearest earlier sound run.",
    )


class ExplainAccepted(Schema):
    """An explanation that waits for its turn."""

    id: int = Field(description="The explanation's number.")
    location: str = Field(description="Where to follow it, as in the header Location.")
    train_run_ids: list[int] = Field(description="The runs that the model is fitted to.")


class RevisionView(Schema):
    """A model revision of an axis."""

    id: int = Field(description="The revision's number.")
    axis: str = Field(description="The axis' name.")
    state: Literal["proposed", "accepted", "rejected"] = Field(description="Where it stands.")
    effects: list[str] = Field(description="What it adds to the declared model, the strongest first.")
    in_words: str = Field(description="The finding in a technician's words.")
    separating_move: SeparatingMoveView | None = Field(
        description="The move that would tell its effect from one that looks alike; null where none does."
    )
    series: str = Field(description="Series of the values that are computed with it, once it is accepted.")
    backlash_before_m: float | None = Field(
        description="Backlash by the declared model [m], in the run that judged."
    )
    backlash_after_m: float | None = Field(
        description="Backlash with the effects [m], in the run that judged."
    )
    run_id: int | None = Field(description="The run that the finding was judged on.")
    explanation_id: int | None = Field(description="The explanation that it came of.")
    created_at: datetime = Field(description=f"When it was proposed ({UTC_TIME}).")
    decided_at: datetime | None = Field(description=f"When it was decided ({UTC_TIME}); null before.")
    decided_by: str | None = Field(description="Who decided: a person, or the policy; null before.")
    note: str | None = Field(description="What was left with the decision; null without a note.")
    report: str | None = Field(description="Address of the page about it; null without one.")


class RevisionDetail(RevisionView):
    """A model revision with its finding."""

    finding: FindingView = Field(description="What the explanation found for the axis.")


class Revisions(Schema):
    """A list of model revisions."""

    items: list[RevisionView] = Field(description="The revisions, the newest first.")


class Decision(Schema):
    """Who decides about a revision, and why."""

    by: str = Field(min_length=1, max_length=128, description="The person's name or initials.")
    note: str = Field(default="", max_length=2000, description="What the person wants to leave with it.")


class MoveRequest(Schema):
    """A separating move as an explanation proposes it: the configured number of steps of this kind, to and fro."""

    axis: str = Field(min_length=1, max_length=64, description="The axis; its gantry moves with it.")
    length_m: float = Field(gt=0, le=10, allow_inf_nan=False, description="Length of a step [m].")
    jerk_m_s3: float = Field(gt=0, le=1e6, allow_inf_nan=False, description="Jerk of a step [m/s³].")
    direction: Literal[-1, 1] = Field(
        default=1, description="Direction of the first step, where there is room."
    )
    positions_m: list[Annotated[float, Field(allow_inf_nan=False)]] = Field(
        default=[],
        max_length=50,
        description="Where along the rack to step [m], travelling there and back; empty: where the axis stands.",
    )
    position: str = Field(default="", max_length=200, description="As proposed, in words.")
    why: str = Field(default="", max_length=2000, description="As proposed.")


class StepsView(Schema):
    """Steps other than the configured ones."""

    length_m: float = Field(description="Length of a step [m].")
    jerk_m_s3: float = Field(description="Jerk of a step [m/s³].")
    direction: int = Field(description="Direction of the first step, where there was room.")
    positions_m: list[float] = Field(description="Where along the rack [m]; empty: where the axis stood.")


class ComputingView(Schema):
    """What is being computed beside the runs."""

    run_id: int = Field(description="The run that it is about.")
    what: str = Field(description="What is done now, in words.")
