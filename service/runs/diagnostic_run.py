"""One diagnostic run, as the method has it: enable, ten steps, record; estimate; store; judge.

The one place where the bus and the mathematics of backlash meet.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Protocol

from service.backlash.estimate import best
from service.backlash.results import AxisResult
from service.captures import CaptureError, write_capture
from service.identification.explanation import Accepted, Explanation
from service.motion.client import MotionError
from service.motion.messages import Progress, Recorded, Steps
from service.recording import Recording
from service.runs.analysis import AnalysisError, KnownCapture
from service.runs.judging import beside, is_measurement, judge_result
from service.runs.revised import Effects
from service.store.errors import StoreError
from service.store.records import CaptureFile, RunEnd, RunRecord
from service.store.repository import Repository

log = logging.getLogger(__name__)


class Motion(Protocol):
    """What moves the axes and records them."""

    def execute(
        self, group: str, on_progress: Callable[[Progress], None], steps: Steps | None = None
    ) -> Recorded:
        """Make the configured steps, or others; MotionError when they could not be made."""


class Analysis(Protocol):
    """What estimates the backlash of every axis of the capture at a path with a known checksum."""

    def immediate(self, path: Path, sha256: str) -> Sequence[AxisResult]:
        """At once, several percent accurate, with an interval that says so."""

    def refined(self, path: Path, sha256: str) -> Sequence[AxisResult]:
        """In seconds to tens of seconds, a fraction of a micrometre accurate."""

    def explain(
        self,
        train: Sequence[KnownCapture],
        validate: KnownCapture,
        tell: Callable[[str], None],
        accepted: Mapping[str, Accepted],
    ) -> Explanation:
        """In minutes, what the axes' models lack beyond what is accepted of them."""

    def revised(
        self, capture: KnownCapture, effects: Effects, others: Sequence[KnownCapture]
    ) -> Sequence[AxisResult]:
        """With the effects that were accepted for the axes' models."""

    def stop(self) -> None:
        """End what is under way."""


@dataclass(frozen=True)
class Workshop:
    """What a run needs: the machine, the numerics, the store, the folder of captures, and the wall clock."""

    motion: Motion
    analysis: Analysis
    repository: Repository
    captures: Path
    wall_time: Callable[[], datetime]


def diagnostic_run(workshop: Workshop, run: RunRecord, on_progress: Callable[[Progress], None]) -> RunEnd:
    """Carry out one queued run to its end, which is always stored: ok, refused or failed, with the reason."""
    workshop.repository.start_run(run.id, workshop.wall_time())
    capture: CaptureFile | None = None
    try:
        recorded = workshop.motion.execute(run.group, on_progress, _steps(run))
        capture = keep_capture(workshop, run, recorded.recording)
        keep_bus_log(workshop, run, recorded.bus_log, Path(capture.path))
        answers = analyse(workshop, capture, on_progress)
    except MotionError as error:
        keep_bus_log(workshop, run, error.bus_log, _capture_name(run, workshop.wall_time()))
        return _failed(workshop, run, error.kind, str(error), capture)
    except (AnalysisError, CaptureError, OSError) as error:
        return _failed(workshop, run, type(error).__name__, str(error), capture)
    return _concluded(workshop, run, capture, answers, recorded.warnings)


def analyse(
    workshop: Workshop, capture: CaptureFile, on_progress: Callable[[Progress], None]
) -> list[Sequence[AxisResult]]:
    """Each method's results, the immediate ones first; the fit is waited for only where those refuse an axis."""
    path = workshop.captures / capture.path
    on_progress(Progress(0, 0, "estimate the backlash"))
    answers = [workshop.analysis.immediate(path, capture.sha256)]
    if any(result.verdict == "refused" for result in answers[0]):
        on_progress(Progress(0, 0, "fit the model, because the plain method refuses"))
        answers.append(workshop.analysis.refined(path, capture.sha256))
    return answers


def keep_capture(workshop: Workshop, run: RunRecord, recording: Recording) -> CaptureFile:
    """Write the recording as a capture; the path is relative to the folder of captures."""
    now = workshop.wall_time()
    name = _capture_name(run, now)
    path = workshop.captures / name
    path.parent.mkdir(parents=True, exist_ok=True)
    return CaptureFile(str(name), write_capture(replace(recording, recorded_at=now), path))


def keep_bus_log(workshop: Workshop, run: RunRecord, bus_log: bytes, capture: Path) -> None:
    """Write the bus log beside the capture, or where it would have been; without it the run is none the worse."""
    if not bus_log:
        return
    path = (workshop.captures / capture).with_suffix(".blf")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(bus_log)
    except OSError:
        log.exception("the bus log of run %d could not be written", run.id)
    else:
        log.info("the bus log of run %d is %s", run.id, path)


def _capture_name(run: RunRecord, at: datetime) -> Path:
    """Where in the folder of captures the run's capture belongs."""
    return Path(f"{at:%Y}") / f"{at:%Y%m%dT%H%M%SZ}-{run.group}-{run.id}.parquet"


def _concluded(
    workshop: Workshop,
    run: RunRecord,
    capture: CaptureFile,
    answers: Sequence[Sequence[AxisResult]],
    remarks: tuple[str, ...],
) -> RunEnd:
    """Judge every axis by its best result and store all of it in one transaction."""
    now = workshop.wall_time()
    repository = workshop.repository
    reported = best(answers[0], answers[-1])
    others = [beside(result) for answer in answers for result in answer if result not in reported]
    end = replace(_end(run, now, capture, reported), remarks=remarks)
    if not is_measurement(run):
        repository.finish_run(end, [beside(result) for result in reported] + others)
        return end
    judged = [judge_result(repository, repository.axis(result.axis), result, now) for result in reported]
    changes = [change for _, found in judged for change in found]
    repository.finish_run(end, [outcome for outcome, _ in judged] + others, changes)
    return end


def _steps(run: RunRecord) -> Steps | None:
    if run.steps is None:
        return None
    return Steps(run.steps.length, run.steps.jerk, run.steps.direction, run.steps.places)


def _end(run: RunRecord, now: datetime, capture: CaptureFile, reported: Sequence[AxisResult]) -> RunEnd:
    """Ok with at least one value; the detail says what was refused beside it."""
    refused = [result for result in reported if result.verdict == "refused"]
    reasons = "; ".join(f"{result.axis}: {result.detail or result.reason}" for result in refused) or None
    if len(refused) == len(reported):
        return RunEnd(run.id, "refused", now, str(refused[0].reason), reasons, capture)
    return RunEnd(run.id, "ok", now, detail=reasons, capture=capture)


def _failed(
    workshop: Workshop, run: RunRecord, reason: str, detail: str, capture: CaptureFile | None
) -> RunEnd:
    log.error("run %d on %s failed: %s", run.id, run.group, detail)
    end = RunEnd(run.id, "failed", workshop.wall_time(), reason, detail, capture)
    try:
        workshop.repository.finish_run(end)
    except StoreError:
        log.exception("run %d could not be stored as failed", run.id)
        raise
    return end
