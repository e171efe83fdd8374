"""The nightly runs and the daily backup: looks at the clock, puts what is due into the box, says what was missed."""

from __future__ import annotations

import logging
import threading
from contextlib import AbstractContextManager
from datetime import UTC, date, datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np

from service.config import Settings
from service.monitoring.alarm import judge_nights
from service.runs.box import Box
from service.runs.diagnostic_run import Workshop
from service.runs.schedule import local_date_due, nights_without
from service.store.database import backups
from service.store.records import AlarmChange

log = logging.getLogger(__name__)

LOOK_EVERY = 20.0
"""Period of the scheduler's look at the wall clock [s]; chosen: a stepped clock is noticed at the next look."""


class Scheduler(AbstractContextManager["Scheduler"]):
    """Runs beside the box until it is left; holds no state of its own, the store knows what was run."""

    def __init__(self, settings: Settings, workshop: Workshop, box: Box) -> None:
        self._settings = settings
        self._workshop = workshop
        self._box = box
        self._began = workshop.wall_time()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name="scheduler")

    def __enter__(self) -> Scheduler:
        self._thread.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self._stop.set()
        self._thread.join()

    def look(self) -> None:
        """Start what is due now, if the box is free; note the nights that were missed; back up once a day."""
        now = self._workshop.wall_time()
        if self._settings.schedule.nightly:
            self._look_at_nights(now)
        self._back_up_daily(now)

    def _look_at_nights(self, now: datetime) -> None:
        schedule = self._settings.schedule
        zone = ZoneInfo(self._settings.machine.timezone)
        late = timedelta(minutes=schedule.late_by_at_most_min)
        day = local_date_due(now, schedule.at, zone, late)
        if day is not None:
            self._start_next(day)
        for axis in self._workshop.repository.axes():
            missed = nights_without(self._last_value(axis.name), now, schedule.at, zone, late)
            self._judge_nights(axis.name, missed, now)

    def _start_next(self, day: date) -> None:
        """Put the first group that has no run of this local date yet into the box; the others follow."""
        for group in self._settings.groups:
            if day not in self._workshop.repository.nightly_runs(group, day):
                self._box.request_nightly(group, day)
                return

    def _last_value(self, axis: str) -> datetime:
        """When the axis last gave a value; before its first one, when it was first tried or the service began.

        A series that an accepted model revision has just begun counts from the decision.
        """
        repository = self._workshop.repository
        revision = repository.models.in_force(axis)
        decided = [] if revision is None or revision.decided_at is None else [revision.decided_at]
        if values := repository.values(axis, limit=1, accepted=True):
            return max([values[0].measured_at, *decided])
        if decided:
            return decided[0]
        runs = repository.runs(axis=axis)
        return min([self._began, *(run.requested_at for run in runs)])

    def _judge_nights(self, axis: str, missed: int, now: datetime) -> None:
        repository = self._workshop.repository
        nights = np.array([True] + [False] * missed)
        changes = judge_nights(nights, repository.active_alarms(axis))
        if changes:
            repository.change_alarms([AlarmChange(axis, change) for change in changes], now)

    def _back_up_daily(self, now: datetime) -> None:
        """One verified backup of the store a day, at its first look."""
        folder, stem = self._settings.storage.backups, self._settings.storage.database.stem
        newest = next(iter(backups(folder, stem)), None)
        if newest is None or newest.stem < f"{stem}-{now.astimezone(UTC):%Y%m%d}":
            log.info("store backed up to %s", self._workshop.repository.backup(folder, now))

    def _work(self) -> None:
        while not self._stop.wait(LOOK_EVERY):
            try:
                self.look()
            except Exception:
                # A night must not be lost because the last look failed, whatever it was.
                log.exception("the scheduler's look failed; it looks again")
