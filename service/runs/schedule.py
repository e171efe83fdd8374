"""When the nightly run of each group is due: once per local date, through both clock changes.

Pure functions of the given instant. The store's unique key (group, local date) is what makes "exactly
once" true across restarts; this module only says what is due now.
"""

from __future__ import annotations

from datetime import UTC, date, datetime, time, timedelta
from zoneinfo import ZoneInfo


def due_instant(day: date, at: time, zone: ZoneInfo) -> datetime:
    """The UTC instant at which the run of a local date is due.

    A local time that occurs twice (autumn) means the first; one that does not occur (spring) means the
    instant that lies as far after midnight as the clock would have shown, one hour later on the wall.
    """
    return datetime.combine(day, at, tzinfo=zone).astimezone(UTC)


def local_date_due(now: datetime, at: time, zone: ZoneInfo, late: timedelta) -> date | None:
    """The local date whose run may start at ``now`` (UTC), None when none may.

    A run may start from its instant until ``late`` after it: a PC that was off at night makes it up, but
    not in the middle of the morning's production.
    """
    today = now.astimezone(zone).date()
    for day in (today, today - timedelta(days=1)):
        if timedelta(0) <= now - due_instant(day, at, zone) < late:
            return day
    return None


def latest_missed_date(now: datetime, at: time, zone: ZoneInfo, late: timedelta) -> date:
    """The newest local date whose window has closed before ``now`` (UTC)."""
    day = now.astimezone(zone).date()
    while due_instant(day, at, zone) + late > now:
        day -= timedelta(days=1)
    return day


def nights_without(since: datetime, now: datetime, at: time, zone: ZoneInfo, late: timedelta) -> int:
    """How many nights fell due after ``since`` (UTC) and have closed before ``now`` (UTC); at most ten."""
    day = latest_missed_date(now, at, zone, late)
    missed = 0
    while missed < 10 and due_instant(day, at, zone) > since:
        missed += 1
        day -= timedelta(days=1)
    return missed
