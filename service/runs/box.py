"""A box in which to put the current run and nothing else: one machine, one worker.

A second request while a run is queued or moving is answered Busy, by the store's own word, so that the
answer survives a restart and holds for the scheduler and for a person alike.
"""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from datetime import date

from service.config import Settings, check_excitation, check_room
from service.motion import messages
from service.runs.diagnostic_run import Workshop, diagnostic_run
from service.store.errors import StoreError
from service.store.records import (
    AlreadyRun,
    BeyondLimits,
    CheckAnswer,
    Progress,
    QueueAnswer,
    Queued,
    RunEnd,
    RunKind,
    RunOrder,
    RunRecord,
    StepParameters,
    StepsAnswer,
    UnknownTarget,
)

log = logging.getLogger(__name__)

FINAL = ("ok", "refused", "failed")

LONGEST_STEP = 10.0
"""Longest duration of a step that may be asked for [s]; chosen: a hundred times the diagnostic step's."""


class Box(AbstractContextManager["Box"]):
    """Takes one run at a time and carries it out in its worker thread."""

    def __init__(
        self,
        settings: Settings,
        workshop: Workshop,
        *,
        abort: Callable[[], None],
        refine: Callable[[int], None],
        explain: Callable[[int], None] = lambda _run: None,
    ) -> None:
        """``abort`` stops what moves when the box is left.

        ``refine`` is told each run that gave a value, ``explain`` each that was refused.
        """
        self._settings = settings
        self._workshop = workshop
        self._abort = abort
        self._refine = refine
        self._explain = explain
        self._orders: queue.Queue[int | None] = queue.Queue()
        self._progress: Progress | None = None
        self._finished = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="runs")

    def __enter__(self) -> Box:
        self._thread.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self._abort()
        self._orders.put(None)
        self._thread.join()

    def request(self, target: str, idempotency_key: str | None = None) -> CheckAnswer:
        """Put a check of the axis or group called ``target`` into the box, or say why not."""
        answer = self._put(target, "on_demand", None, idempotency_key)
        assert not isinstance(answer, AlreadyRun), "only a nightly run belongs to a date"
        return answer

    def request_steps(self, target: str, steps: StepParameters) -> StepsAnswer:
        """Put a run of other steps than the configured ones into the box, or say why not."""
        if beyond := beyond_limits(self._settings, target, steps):
            return BeyondLimits(beyond)
        answer = self._put(target, "on_demand", None, None, steps)
        assert not isinstance(answer, AlreadyRun), "only a nightly run belongs to a date"
        return answer

    def request_nightly(self, group: str, local_date: date) -> QueueAnswer | UnknownTarget:
        """Put the nightly run of a group and local date into the box, or say why not."""
        return self._put(group, "nightly", local_date, None)

    def progress(self) -> Progress | None:
        """Where the run in the box stands; None when the machine is idle."""
        return self._progress

    def wait(self, run_id: int, timeout: float) -> RunRecord:
        """Wait up to ``timeout`` [s] for a run of this box to end, and return it as it stands then."""
        with self._finished:
            self._finished.wait_for(lambda: self._run(run_id).state in FINAL, timeout)
        return self._run(run_id)

    def _run(self, run_id: int) -> RunRecord:
        return self._workshop.repository.run(run_id)

    def _put(
        self,
        target: str,
        kind: RunKind,
        local_date: date | None,
        idempotency_key: str | None,
        steps: StepParameters | None = None,
    ) -> QueueAnswer | UnknownTarget:
        groups = self._settings.groups
        group = self._settings.group_of(target)
        if group is None:
            return UnknownTarget(tuple(sorted({*groups, *(axis.name for axis in self._settings.axis)})))
        order = RunOrder(
            kind=kind,
            target=target,
            group=group,
            axes=groups[group],
            requested_at=self._workshop.wall_time(),
            local_date=local_date,
            idempotency_key=idempotency_key,
            steps=steps,
        )
        answer = self._workshop.repository.queue_run(order)
        if isinstance(answer, Queued) and not answer.replayed:
            self._orders.put(answer.run_id)
        return answer

    def _work(self) -> None:
        while (run_id := self._orders.get()) is not None:
            self._carry_out(run_id)
            self._progress = None
            with self._finished:
                self._finished.notify_all()

    def _carry_out(self, run_id: int) -> None:
        try:
            run = self._run(run_id)
            self._note(run, messages.Progress(0, 0, "connect to the drives"))
            end = diagnostic_run(self._workshop, run, lambda progress: self._note(run, progress))
            if end.state == "ok":
                self._refine(run_id)
            elif end.state == "refused":
                self._explain(run_id)
        except Exception:
            # The worker must outlive whatever a run does; the run itself is stored as failed.
            log.exception("run %d ended by a fault of the program", run_id)
            self._give_up(run_id)

    def _note(self, run: RunRecord, progress: messages.Progress) -> None:
        self._progress = Progress(run.id, run.target, progress.text, progress.done, progress.total)

    def _give_up(self, run_id: int) -> None:
        end = RunEnd(
            run_id,
            "failed",
            self._workshop.wall_time(),
            "program_fault",
            "the program failed while it worked on this run; the journal holds the trace. Please report it",
        )
        try:
            self._workshop.repository.finish_run(end)
        except StoreError:
            log.exception("run %d could not be stored as failed", run_id)


def beyond_limits(settings: Settings, target: str, steps: StepParameters) -> str | None:
    """Say which limit of an axis the steps exceed; None when they exceed none."""
    group = settings.group_of(target)
    changed = {"step_length_m": steps.length, "jerk_m_s3": steps.jerk}
    excitation = settings.excitation.model_copy(update=changed)
    try:
        for axis in settings.groups[group] if group else ():
            check_excitation(settings.axis_named(axis), excitation)
            check_room(settings.axis_named(axis), steps.places, steps.length)
    except ValueError as error:
        return str(error)
    duration = 4 * (steps.length / (2 * steps.jerk)) ** (1 / 3)
    if duration > LONGEST_STEP:
        return f"a step would last {duration:.0f} s, at most {LONGEST_STEP:.0f} s are allowed: raise the jerk"
    return None
