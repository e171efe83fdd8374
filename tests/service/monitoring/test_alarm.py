"""The alarm's decisions and its states."""

from __future__ import annotations

import numpy as np
import pytest

from service.monitoring.alarm import (
    AlarmEvent,
    AlarmKind,
    AlarmState,
    Band,
    Judgement,
    judge,
    judge_nights,
    transition,
)

BAND = Band(reference=50e-6, tolerance=10e-6)
HIGH = frozenset({AlarmKind.BACKLASH_HIGH})


def judged(values_um: list[float], active: frozenset[AlarmKind] = frozenset()) -> Judgement:
    b = np.array(values_um) * 1e-6
    return judge(np.arange(b.size) * 86_400.0, b, BAND, active)


def events(values_um: list[float], active: frozenset[AlarmKind] = frozenset()) -> list[tuple[str, str]]:
    return [(change.kind.value, change.event.value) for change in judged(values_um, active).changes]


def test_one_value_outside_raises_nothing_however_far_it_is() -> None:
    assert events([50.0] * 9 + [500.0]) == []


def test_four_values_outside_of_nine_raise_nothing_the_sixth_does() -> None:
    assert events([50.0] * 9 + [70.0] * 4) == []
    assert events([50.0] * 9 + [70.0] * 5) == []
    assert events([50.0] * 9 + [70.0] * 6) == [("backlash_high", "raised")]


def test_a_young_history_says_nothing_before_six_values() -> None:
    assert events([70.0] * 5) == []
    assert events([70.0] * 6) == [("backlash_high", "raised")]


def test_too_small_a_backlash_is_an_alarm_of_its_own() -> None:
    assert events([50.0] * 9 + [30.0] * 6) == [("backlash_low", "raised")]


def test_an_active_alarm_is_not_raised_again() -> None:
    assert events([70.0] * 9, HIGH) == []


def test_it_is_cleared_only_well_inside_and_after_three_levels() -> None:
    home = [70.0] * 9 + [50.0] * 6
    assert events(home, HIGH) == []
    assert events([*home, 50.0], HIGH) == [("backlash_high", "cleared")]
    # 59.5 µm is inside the band of 60, not inside the hysteresis of 59.
    assert events([70.0] * 9 + [59.5] * 20, HIGH) == []


def test_judging_the_same_history_again_after_a_missing_run_changes_nothing() -> None:
    values = [50.0] * 9 + [70.0] * 6
    first = judged(values)
    assert [change.event for change in first.changes] == [AlarmEvent.RAISED]
    assert judged(values, HIGH) == Judgement(first.trend, ())


def test_an_axis_without_a_reference_has_a_trend_and_no_alarm() -> None:
    found = judge(np.arange(9.0), np.full(9, 900e-6), None)
    assert found.changes == ()
    assert found.trend is not None


def test_the_detail_says_level_and_band_in_micrometres() -> None:
    detail = judged([50.0] * 9 + [71.26] * 6).changes[0].detail
    assert "71.3 µm" in detail
    assert "50.0 ± 10.0 µm" in detail


@pytest.mark.parametrize(("reference", "tolerance"), [(50e-6, 0.0), (-1e-6, 1e-6), (float("nan"), 1e-6)])
def test_a_band_that_is_none_is_refused(reference: float, tolerance: float) -> None:
    with pytest.raises(ValueError, match="band"):
        Band(reference, tolerance)


def nights(*has_value: bool) -> np.ndarray:
    return np.array(has_value, dtype=np.bool_)


def test_one_missed_night_is_ordinary_two_are_an_alarm() -> None:
    assert judge_nights(nights(True, True, False)) == ()
    (change,) = judge_nights(nights(True, False, False))
    assert (change.kind, change.event) == (AlarmKind.RUN_MISSING, AlarmEvent.RAISED)
    assert "2 scheduled nights" in change.detail


def test_nights_that_never_had_a_value_are_missing_too() -> None:
    (change,) = judge_nights(nights(False, False, False))
    assert change.event is AlarmEvent.RAISED


def test_only_a_value_ends_the_missing_of_runs() -> None:
    active = frozenset({AlarmKind.RUN_MISSING})
    assert judge_nights(nights(True, False, False, False), active) == ()
    (change,) = judge_nights(nights(False, False, True), active)
    assert change.event is AlarmEvent.CLEARED
    assert judge_nights(nights(False, False, True)) == ()
    assert judge_nights(nights()) == ()


NORMAL = AlarmState()
UNACKNOWLEDGED = AlarmState(active=True, acknowledged=False)
ACKNOWLEDGED = AlarmState(active=True, acknowledged=True)
RETURNED = AlarmState(active=False, acknowledged=False)


@pytest.mark.parametrize(
    ("state", "event", "after"),
    [
        (NORMAL, AlarmEvent.RAISED, UNACKNOWLEDGED),
        (NORMAL, AlarmEvent.CLEARED, NORMAL),
        (NORMAL, AlarmEvent.ACKNOWLEDGED, NORMAL),
        (UNACKNOWLEDGED, AlarmEvent.RAISED, UNACKNOWLEDGED),
        (UNACKNOWLEDGED, AlarmEvent.CLEARED, RETURNED),
        (UNACKNOWLEDGED, AlarmEvent.ACKNOWLEDGED, ACKNOWLEDGED),
        (ACKNOWLEDGED, AlarmEvent.RAISED, ACKNOWLEDGED),
        (ACKNOWLEDGED, AlarmEvent.CLEARED, NORMAL),
        (ACKNOWLEDGED, AlarmEvent.ACKNOWLEDGED, ACKNOWLEDGED),
        (RETURNED, AlarmEvent.RAISED, UNACKNOWLEDGED),
        (RETURNED, AlarmEvent.CLEARED, RETURNED),
        (RETURNED, AlarmEvent.ACKNOWLEDGED, NORMAL),
    ],
)
def test_states_follow_isa_18_2(state: AlarmState, event: AlarmEvent, after: AlarmState) -> None:
    assert transition(state, event) == after
    assert after.retained == (after is not NORMAL)
