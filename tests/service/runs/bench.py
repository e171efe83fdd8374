"""What the tests of the loop live in: a store, captures of a few samples, and an analysis that reads their notes.

A capture's note says what its machine has: nothing, or the name of an effect. The analysis finds an effect where
both runs of a pair have it, and "unknown" where the pair straddles a change, as the real one would at best.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from service.backlash.results import AxisResult, Reason
from service.captures import write_capture
from service.identification.explanation import (
    Accepted,
    AxisExplanation,
    Candidate,
    CannotExplain,
    ErrorReport,
    Explanation,
    Parameter,
    Prediction,
)
from service.motion.messages import Recorded
from service.recording import AxisDescription, Move, Recording, Trace
from service.runs.analysis import KnownCapture
from service.runs.diagnostic_run import Workshop
from service.runs.judging import judge_result
from service.runs.revised import Effects, by_explaining
from service.store.records import CaptureFile, Queued, RunEnd, RunOrder
from service.store.repository import Repository

NOON = datetime(2026, 11, 1, 12, tzinfo=UTC)
TRUE_B, WRONG_B = 57e-6, 80e-6
"""Backlash [m] of every machine, and what the declared model makes of it under an effect."""


def recording(note: str | None, axes: Sequence[str] = ("Y",), seed: int = 0) -> Recording:
    """A capture of a few samples and two moves."""
    time = np.arange(0.0, 1.2, 1e-3)
    noise = np.random.default_rng(seed).normal(0.0, 1.0, len(time))
    return Recording(
        machine="bench",
        axes=tuple(AxisDescription(axis, 0.003) for axis in axes),
        traces={
            (axis, channel): Trace(time, noise)
            for axis in axes
            for channel in ("motor_speed", "acceleration")
        },
        moves=(Move(0.35, 1, 0.004, 200.0, 0.086), Move(0.8, -1, 0.004, 200.0, 0.086)),
        note=note,
    )


def explained(
    train: Sequence[Recording],
    validate: Recording,
    tell: Callable[[str], None],
    accepted: Mapping[str, Accepted],
) -> Explanation:
    """Read the notes of the captures; what is accepted is there if it is noted."""
    tell("reads the notes")
    if validate.note == "flat":
        raise CannotExplain("Y acceleration: flat; the sensor is dead or unplugged")
    names = {one.note for one in (*train, validate)}
    effects = tuple(validate.note.split(", ")) if validate.note and len(names) == 1 else ()
    finding = "effect" if effects else ("none" if names == {None} else "unknown")
    return Explanation(
        tuple(
            _beyond(_axis(axis.name, finding, effects, train[-1], validate), accepted)
            for axis in validate.axes
        )
    )


def _beyond(found: AxisExplanation, accepted: Mapping[str, Accepted]) -> AxisExplanation:
    """The verdict begun with what is accepted of the axis, where that is noted."""
    known = accepted[found.axis].effects if found.axis in accepted else ()
    if not set(known) <= set(found.effects):
        return replace(found, absent=known)
    more = tuple(name for name in found.effects if name not in known)
    if known and not more and found.finding == "effect":
        return replace(found, finding="none", before=found.after, effects=(), accepted=known)
    return replace(found, effects=more, accepted=known)


def _axis(
    axis: str, finding: Any, effects: tuple[str, ...], train: Recording, validate: Recording
) -> AxisExplanation:
    wrong = WRONG_B if train.note else TRUE_B
    before = ErrorReport(0.09, 0.1, 0.1, 0.9, wrong, (wrong - 1e-6, wrong + 1e-6), 0.0321)
    after = ErrorReport(0.03, 0.031, 0.03, 0.1, TRUE_B, (TRUE_B - 1e-6, TRUE_B + 1e-6)) if effects else before
    trace = validate.traces[axis, "acceleration"]
    moving = (trace.time >= 0.35) & (trace.time < 0.95)
    time, value = trace.time[moving], trace.value[moving]
    return AxisExplanation(
        axis,
        "acceleration",
        finding,
        0.03,
        before,
        after,
        effects=effects,
        candidates=(
            Candidate(effects[0], 0.031, 1e-9, True, "best"),
            Candidate("sensor_gain", 0.09, 0.4, False, "no"),
        )
        if effects
        else (),
        parameters={"latency_s": Parameter(0.0017, 1e-5, "s")} if effects else {},
        predictions=(Prediction("before", time, 0.5 * value), Prediction("after", time, 0.9 * value)),
    )


@dataclass
class NoteReader:
    """An analysis in the test's own process; notes the pairs that it was asked about, and the
    accepted numbers that it was told."""

    pairs: list[tuple[str, str]] = field(default_factory=list)
    accepted: list[dict[str, Mapping[str, float]]] = field(default_factory=list)
    stopped: bool = False

    def immediate(self, path: Path, sha256: str) -> Sequence[AxisResult]:
        raise AssertionError("no run is made on the bench")

    refined = immediate

    def explain(
        self,
        train: Sequence[KnownCapture],
        validate: KnownCapture,
        tell: Callable[[str], None],
        accepted: Mapping[str, Accepted],
    ) -> Explanation:
        self.pairs.append((train[-1].path.stem, validate.path.stem))
        self.accepted.append({axis: one.numbers for axis, one in accepted.items()})
        return explained([one.read() for one in train], validate.read(), tell, accepted)

    def revised(
        self, capture: KnownCapture, effects: Effects, others: Sequence[KnownCapture]
    ) -> Sequence[AxisResult]:
        return by_explaining(capture.read(), effects, [one.read() for one in others], explained)

    def stop(self) -> None:
        self.stopped = True


class NoMotion:
    """Nothing moves on the bench."""

    def execute(self, *_: object) -> Recorded:
        raise AssertionError("no run is made on the bench")


@dataclass
class Bench:
    """A workshop, and runs put into its store without a machine."""

    repository: Repository
    captures: Path
    analysis: NoteReader = field(default_factory=NoteReader)
    day: int = 0

    @property
    def workshop(self) -> Workshop:
        return Workshop(NoMotion(), self.analysis, self.repository, self.captures, self.now)

    def now(self) -> datetime:
        return NOON + timedelta(days=self.day, hours=1)

    def run(self, note: str | None = None, *, reason: Reason | None = None, capture: bool = True) -> int:
        """Store the next night's run of Y; the declared model's value is wrong under an effect."""
        self.day += 1
        at = NOON + timedelta(days=self.day)
        answer = self.repository.queue_run(RunOrder("on_demand", "Y", "Y", ("Y",), at))
        assert isinstance(answer, Queued)
        file = None
        if capture:
            path = f"night-{self.day}.parquet"
            file = CaptureFile(path, write_capture(recording(note, seed=self.day), self.captures / path))
        if reason is not None:
            refused = AxisResult("Y", "refused", "model_fit", reason, "as the test wants it")
            outcome, changes = judge_result(self.repository, self.repository.axis("Y"), refused, at)
            end = RunEnd(answer.run_id, "refused", at, reason, "as the test wants it", file)
        else:
            b = (WRONG_B if note else TRUE_B) + 0.2e-6 * (self.day % 3)
            value = AxisResult("Y", "ok", "model_fit", None, None, b, (b - 1e-6, b + 1e-6))
            outcome, changes = judge_result(self.repository, self.repository.axis("Y"), value, at)
            end = RunEnd(answer.run_id, "ok", at, capture=file)
        self.repository.finish_run(end, [outcome], changes)
        return answer.run_id
