"""The nightly run is due exactly once per local date, also when the clocks change."""

import itertools
from datetime import UTC, date, datetime, time, timedelta
from zoneinfo import ZoneInfo

import pytest

from service.runs.schedule import due_instant, latest_missed_date, local_date_due, nights_without

BERLIN = ZoneInfo("Europe/Berlin")
LATE = timedelta(hours=3)


def fired(start: datetime, end: datetime, at: time, zone: ZoneInfo) -> list[date]:
    """What a loop that looks every minute, and keeps a set of dates done, would start."""
    done: list[date] = []
    now = start
    while now < end:
        day = local_date_due(now, at, zone, LATE)
        if day is not None and day not in done:
            done.append(day)
        now += timedelta(minutes=1)
    return done


@pytest.mark.parametrize(
    ("start", "changes"),
    [(datetime(2026, 3, 27, 12, tzinfo=UTC), "spring"), (datetime(2026, 10, 23, 12, tzinfo=UTC), "autumn")],
)
@pytest.mark.parametrize("at", [time(0, 0), time(2, 0), time(2, 30), time(3, 0), time(23, 59)])
def test_one_run_per_local_date_through_the_clock_change(start: datetime, changes: str, at: time) -> None:
    days = fired(start, start + timedelta(days=4), at, BERLIN)
    assert len(days) == 4
    assert [later - earlier for earlier, later in itertools.pairwise(days)] == [timedelta(days=1)] * 3


def test_the_repeated_hour_means_its_first_occurrence() -> None:
    assert due_instant(date(2026, 10, 25), time(2, 30), BERLIN) == datetime(2026, 10, 25, 0, 30, tzinfo=UTC)


def test_the_hour_that_does_not_occur_is_made_up_one_hour_later() -> None:
    assert due_instant(date(2026, 3, 29), time(2, 30), BERLIN) == datetime(2026, 3, 29, 1, 30, tzinfo=UTC)


def test_nothing_is_due_before_its_time_nor_after_its_window() -> None:
    day = date(2026, 7, 1)
    due = due_instant(day, time(2, 30), BERLIN)
    assert local_date_due(due - timedelta(seconds=1), time(2, 30), BERLIN, LATE) is None
    assert local_date_due(due, time(2, 30), BERLIN, LATE) == day
    assert local_date_due(due + LATE - timedelta(seconds=1), time(2, 30), BERLIN, LATE) == day
    assert local_date_due(due + LATE, time(2, 30), BERLIN, LATE) is None


def test_a_window_across_midnight_belongs_to_the_day_it_began() -> None:
    due = due_instant(date(2026, 7, 1), time(23, 30), BERLIN)
    assert local_date_due(due + timedelta(hours=2), time(23, 30), BERLIN, LATE) == date(2026, 7, 1)


def test_a_missed_date_is_named_once_its_window_has_closed() -> None:
    due = due_instant(date(2026, 7, 1), time(2, 30), BERLIN)
    assert latest_missed_date(due + LATE, time(2, 30), BERLIN, LATE) == date(2026, 7, 1)
    assert latest_missed_date(due + LATE - timedelta(seconds=1), time(2, 30), BERLIN, LATE) == date(
        2026, 6, 30
    )


def test_nights_without_a_value_are_counted_only_once_they_have_closed() -> None:
    at = time(2, 30)
    value = due_instant(date(2026, 7, 1), at, BERLIN) + timedelta(minutes=5)
    for nights in (0, 1, 2, 7):
        closed = due_instant(date(2026, 7, 1) + timedelta(days=nights), at, BERLIN) + LATE
        assert nights_without(value, closed, at, BERLIN, LATE) == nights
    assert nights_without(value, value + timedelta(days=60), at, BERLIN, LATE) == 10
