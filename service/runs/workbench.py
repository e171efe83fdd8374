"""What is computed when nothing else is: verdicts on finished runs, and values with revised models.

One thing at a time, in this order: the value of the newest run with its axis' accepted revision, explanations
that a person asked for, the verdicts on finished runs, the restating of older runs; within each the newest run
first. Nothing begins while a run moves or is being refined, and what is computed runs at the lowest priority,
so that it never delays the value of the next run. When more verdicts wait than a night can bring, the oldest
are skipped, and say so.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from enum import IntEnum
from typing import NamedTuple

from service.runs.deciding import decide
from service.runs.diagnostic_run import Workshop
from service.runs.explaining import Policy, explain_run
from service.runs.pairs import NothingToExplain, given_runs, known_capture, training_runs
from service.runs.restating import restate, to_restate
from service.store.model_records import (
    ExplanationEnd,
    ExplanationKind,
    ExplanationOrder,
    RevisionRecord,
)
from service.store.records import RunRecord

log = logging.getLogger(__name__)

MOST_WAITING = 3
"""Verdicts that may wait; chosen: at some minutes each, what a busy hour of checks leaves for the next one."""
LOOK_EVERY = 0.5
"""How often it is looked whether the machine is at rest [s]."""


class Rank(IntEnum):
    """What comes first."""

    NEW_VALUE = 0
    ASKED_FOR = 1
    VERDICT = 2
    OLD_VALUE = 3


class Task(NamedTuple):
    """One thing to compute, in the order of its fields: rank, newest run first; ``explanation`` of a verdict."""

    rank: Rank
    newest_first: int
    run_id: int
    explanation: int | None = None


class Workbench(AbstractContextManager["Workbench"]):
    """Works off what it is given until it is left; what is under way then is given up and skipped.

    ``is_busy`` says whether a run moves or is being refined; ``explain`` is False where no verdict is wanted.
    """

    def __init__(
        self,
        workshop: Workshop,
        is_busy: Callable[[], bool],
        *,
        explain: bool = True,
        policy: Policy = "ask",
    ) -> None:
        self._workshop = workshop
        self._is_busy = is_busy
        self._explain, self._policy = explain, policy
        self._tasks: list[Task] = []
        self._doing: Task | None = None
        self._told = ""
        self._leaving = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="workbench")

    def __enter__(self) -> Workbench:
        for axis in self._workshop.repository.axes():
            self._restate(axis.name)
        self._thread.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self._workshop.analysis.stop()
        with self._changed:
            self._leaving = True
            self._changed.notify_all()
        self._thread.join()
        self._workshop.repository.models.give_up_unfinished(self._workshop.wall_time())

    def submit(self, run_id: int) -> None:
        """Have a finished run computed with the revised model, if its axis has one, and its verdict made."""
        repository = self._workshop.repository
        run = repository.run(run_id)
        if any(repository.models.in_force(axis) for axis in run.axes):
            self._put(Task(Rank.NEW_VALUE, -run_id, run_id))
        if self._explain and run.capture is not None:
            self._order_verdict(run)

    def explain(self, run_id: int, train: Sequence[int] = ()) -> int:
        """Have a run explained for a person; the explanation's id.

        Without ``train`` the runs to fit to are chosen, see ``pairs``.

        Raises
        ------
        UnknownRecordError, NothingToExplain
        """
        repository, folder = self._workshop.repository, self._workshop.captures
        run = repository.run(run_id)
        known_capture(folder, run)
        chosen = given_runs(repository, folder, run, train)
        runs = chosen or training_runs(repository, folder, run)
        number = self._order(run, runs, "on_demand")
        self._put(Task(Rank.ASKED_FOR, -run_id, run_id, number))
        return number

    def decide(self, revision_id: int, *, accept: bool, by: str, note: str | None) -> RevisionRecord:
        """Accept or reject a proposed revision; an accepted one has the axis' history restated.

        Raises
        ------
        UnknownRecordError, AlreadyDecidedError, AxisGoneError
        """
        decided = decide(self._workshop, revision_id, accept=accept, by=by, note=note)
        if accept:
            self._restate(decided.axis)
        return decided

    def progress(self) -> tuple[int, str] | None:
        """The run that is being computed and what is done, None at rest."""
        with self._changed:
            return None if self._doing is None else (self._doing.run_id, self._told)

    def wait_idle(self, timeout: float | None = None) -> bool:
        """Wait until everything that was given is done; False when that took longer than ``timeout`` [s]."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._tasks and self._doing is None, timeout)

    def _order_verdict(self, run: RunRecord) -> None:
        """Queue a run's verdict; where there is nothing to fit to, that is the verdict."""
        repository = self._workshop.repository
        try:
            train = training_runs(repository, self._workshop.captures, run)
        except NothingToExplain as error:
            number = self._order(run, (), "background")
            self._end(number, "cannot_tell", str(error))
            return
        number = self._order(run, train, "background")
        self._put(Task(Rank.VERDICT, -run.id, run.id, number))
        self._skip_oldest()

    def _order(self, run: RunRecord, train: Sequence[RunRecord], kind: ExplanationKind) -> int:
        ids = tuple(one.id for one in train)
        order = ExplanationOrder(run.id, ids, kind, self._workshop.wall_time())
        return self._workshop.repository.models.order(order)

    def _end(self, number: int, state: str, detail: str) -> None:
        end = ExplanationEnd(number, state, self._workshop.wall_time(), detail)  # type: ignore[arg-type]
        self._workshop.repository.models.finish(end)

    def _skip_oldest(self) -> None:
        with self._changed:
            waiting = sorted(task for task in self._tasks if task.rank is Rank.VERDICT)
            late = waiting[MOST_WAITING:]
            self._tasks = [task for task in self._tasks if task not in late]
        for task in late:
            assert task.explanation is not None
            self._end(
                task.explanation,
                "skipped",
                f"{MOST_WAITING} newer runs waited for their verdicts, which matter more; ask for an explanation of "
                f"run {task.run_id} if it matters",
            )

    def _restate(self, axis: str) -> None:
        for run_id in to_restate(self._workshop, axis):
            self._put(Task(Rank.OLD_VALUE, -run_id, run_id))

    def _put(self, task: Task) -> None:
        with self._changed:
            if task not in self._tasks:
                self._tasks.append(task)
            self._changed.notify_all()

    def _work(self) -> None:
        while (task := self._next()) is not None:
            try:
                self._do(task)
            except Exception:
                # The thread must outlive whatever one run does to it.
                log.exception("run %d: a fault of the program in %s", task.run_id, task.rank.name)
                self._give_up(task)
            finally:
                with self._changed:
                    self._doing = None
                    self._changed.notify_all()

    def _next(self) -> Task | None:
        """Wait for the first task while the machine is at rest; None when the bench is left."""
        with self._changed:
            while not self._leaving:
                if self._tasks and not self._is_busy():
                    self._doing, self._told = min(self._tasks), "begins"
                    self._tasks.remove(self._doing)
                    return self._doing
                self._changed.wait(LOOK_EVERY if self._tasks else None)
        return None

    def _do(self, task: Task) -> None:
        if task.explanation is None:
            self._tell("the value with the revised model")
            restate(self._workshop, task.run_id)
            return
        for axis in explain_run(self._workshop, task.explanation, self._policy, self._tell):
            self._restate(axis)

    def _give_up(self, task: Task) -> None:
        if task.explanation is None:
            return
        self._end(
            task.explanation,
            "failed",
            "the program failed while it worked on this; the journal holds the trace. Please report it",
        )

    def _tell(self, text: str) -> None:
        with self._changed:
            self._told = text
