"""Which runs a model is fitted to, and which run it is judged on.

Rule: a run is judged by the model that was fitted to the **nearest earlier run** of the same group whose
recording is sound. Near in time the two have most in common, and one run holds enough steps for a fit. A run
of other steps than the configured ones (made to tell two candidates apart) is judged by the fit to the last
two ordinary runs before it.

Should an effect begin at run k, the pair (k-1, k) straddles the change: what is fitted to k-1 cannot hold the
effect, and the verdict may be anything. Such a pair is not told by itself; ``proposing`` therefore wants a
finding confirmed by a pair that lies wholly after the first one's train run.

Sound is a recording that gave a value, or whose refusal speaks of the model and not of the recording (misfit,
steps that disagree, an interval too wide): those are the runs that need an explanation most.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from service.backlash.results import Reason
from service.captures import CaptureError, sha256
from service.runs.analysis import KnownCapture
from service.store.records import RunRecord
from service.store.repository import Repository

OF_THE_MODEL = {
    Reason.MISFIT,
    Reason.STEPS_DISAGREE,
    Reason.INTERVAL_TOO_WIDE,
    Reason.TOO_FEW_STEPS,
    Reason.SIGNALS_DISAGREE,
}
"""Reasons of a refusal that leave the recording usable."""

LOOK_BACK = 20
"""How many earlier runs are looked through for a sound one; chosen: three weeks of nights."""


class NothingToExplain(RuntimeError):
    """A run cannot be explained; ``kind`` names why in short, the message in a sentence with what to do."""

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind


def is_sound(run: RunRecord) -> bool:
    """Whether a model can be fitted to a run's recording."""
    if run.capture is None:
        return False
    return run.state == "ok" or (run.state == "refused" and run.reason in OF_THE_MODEL)


def known_capture(folder: Path, run: RunRecord) -> KnownCapture:
    """The capture of a run; raise NothingToExplain when there is none, or it is not what was written."""
    if run.capture is None:
        why = (
            "it is not finished" if run.state in ("queued", "running") else "it failed before it had recorded"
        )
        raise NothingToExplain("no-capture", f"run {run.id} left no capture: {why}")
    path = folder / run.capture.path
    try:
        same = sha256(path) == run.capture.sha256
    except (CaptureError, OSError) as error:
        raise NothingToExplain(
            "capture-missing",
            f"the capture of run {run.id} cannot be read ({path}): moved or deleted by hand, or the disk is not "
            "mounted. Put it back from a backup, or explain another run",
        ) from error
    if not same:
        raise NothingToExplain(
            "capture-changed",
            f"the capture of run {run.id} is not what was written ({path}): its checksum differs. A worn disk, or "
            "a file that was changed by hand. Put it back from a backup, or explain another run",
        )
    return KnownCapture(path, run.capture.sha256)


def training_runs(repository: Repository, folder: Path, run: RunRecord) -> tuple[RunRecord, ...]:
    """Choose the runs that the model is fitted to; raise NothingToExplain when there are none."""
    wanted = 1 if run.steps is None else 2
    found = list(_usable(repository, folder, run, wanted))
    if not found:
        raise NothingToExplain(
            "no-train-run",
            f"there is no earlier sound run of {run.group} to fit the model to, and no model is judged on the run that "
            f"it was fitted to. Check {run.group} once more: that run is judged by a fit to this one",
        )
    return tuple(reversed(found))


def given_runs(
    repository: Repository, folder: Path, run: RunRecord, ids: Sequence[int]
) -> tuple[RunRecord, ...]:
    """Return the runs that a person chose to fit to; raise NothingToExplain when they do not fit together."""
    runs = tuple(repository.run(number) for number in ids)
    for train in runs:
        if train.id == run.id:
            raise NothingToExplain("same-run", f"run {run.id} cannot be judged by a model fitted to itself")
        if train.axes != run.axes:
            raise NothingToExplain(
                "other-axes",
                f"run {train.id} moved {', '.join(train.axes)}, run {run.id} moved {', '.join(run.axes)}; "
                "choose runs of the same axes",
            )
        known_capture(folder, train)
    return runs


def neighbours(repository: Repository, folder: Path, run: RunRecord) -> tuple[RunRecord, ...]:
    """Return the sound runs next to a run, the earlier one first, where there are any."""
    before = list(_usable(repository, folder, run, 1))
    later = [
        other
        for other in repository.runs(axis=run.axes[0], limit=200)
        if other.id > run.id and _is_like(other, run)
    ]
    after = [other for other in reversed(later) if _is_there(folder, other)][:1]
    return (*before, *after)


def _usable(repository: Repository, folder: Path, run: RunRecord, count: int) -> Iterator[RunRecord]:
    """The nearest earlier runs like this one whose captures are there, the newest first."""
    for other in repository.runs(axis=run.axes[0], before=run.id, limit=LOOK_BACK):
        if count == 0:
            return
        if _is_like(other, run) and _is_there(folder, other):
            count -= 1
            yield other


def _is_like(other: RunRecord, run: RunRecord) -> bool:
    return other.axes == run.axes and other.steps is None and is_sound(other)


def _is_there(folder: Path, run: RunRecord) -> bool:
    try:
        known_capture(folder, run)
    except NothingToExplain:
        return False
    return True
