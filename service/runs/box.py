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
from dataclasses import dataclass
from datetime import date

from service.config import Settings
from service.motion.messages import Progress
from service.runs.diagnostic_run import Workshop, diagnostic_run
from service.store.errors import StoreError
from service.store.records import Queued, QueueAnswer, RunEnd, RunKind, RunOrder

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Unknown:
    """Refused: no axis and no group of the configuration has this name."""

    target: str


@dataclass(frozen=True)
class Status:
    """What the box holds now; ``progress`` is None while nothing moves."""

    run_id: int | None
    progress: Progress | None


class Box(AbstractContextManager["Box"]):
    """Takes one run at a time and carries it out in its worker thread."""

    def __init__(self, settings: Settings, workshop: Workshop, abort: Callable[[], None]) -> None:
        self._settings = settings
        self._workshop = workshop
        self._abort = abort
        self._orders: queue.Queue[int | None] = queue.Queue()
        self._status = Status(None, None)
        self._finished = threading.Condition()
        self._ends: dict[int, RunEnd | None] = {}
        self._thread = threading.Thread(target=self._work, name="runs")

    def __enter__(self) -> Box:
        self._thread.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self._abort()
        self._orders.put(None)
        self._thread.join()

    def request(
        self,
        target: str,
        *,
        kind: RunKind = "on_demand",
        local_date: date | None = None,
        idempotency_key: str | None = None,
    ) -> QueueAnswer | Unknown:
        """Put a run on the group that ``target`` names, or that holds the axis it names, into the box."""
        group = self._settings.group_of(target)
        if group is None:
            return Unknown(target)
        order = RunOrder(
            kind=kind,
            target=target,
            group=group,
            axes=self._settings.groups[group],
            requested_at=self._workshop.wall_time(),
            local_date=local_date,
            idempotency_key=idempotency_key,
        )
        answer = self._workshop.repository.queue_run(order)
        if isinstance(answer, Queued) and not answer.replayed:
            self._orders.put(answer.run_id)
        return answer

    def status(self) -> Status:
        """What is being done."""
        return self._status

    def wait(self, run_id: int, timeout: float) -> RunEnd | None:
        """Wait up to ``timeout`` [s] for a run that this box carries out; None when it has not ended."""
        with self._finished:
            self._finished.wait_for(lambda: run_id in self._ends, timeout)
            return self._ends.get(run_id)

    def _work(self) -> None:
        while (run_id := self._orders.get()) is not None:
            end: RunEnd | None = None
            try:
                run = self._workshop.repository.run(run_id)
                self._status = Status(run_id, None)
                end = diagnostic_run(self._workshop, run, self._note)
            except StoreError:
                log.exception("run %d: the store refuses", run_id)
            except Exception:
                # The worker must outlive whatever a run does; the run itself stays visible as interrupted.
                log.exception("run %d ended by a fault of the program", run_id)
                self._give_up(run_id)
            finally:
                self._status = Status(None, None)
                with self._finished:
                    self._ends[run_id] = end
                    self._finished.notify_all()

    def _note(self, progress: Progress) -> None:
        self._status = Status(self._status.run_id, progress)

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
