"""When an axis' alarm is raised, cleared and acknowledged.

Words of OPC UA Part 9 and ISA-18.2: an alarm is *active* while its condition holds and *acknowledged* once a
person has said to have seen it; it is *retained* (shown) while it is active or not acknowledged:

====================  ======  ============  ========
ISA-18.2 state        active  acknowledged  retained
====================  ======  ============  ========
normal                no      yes           no
unacknowledged        yes     no            yes
acknowledged          yes     yes           yes
returned, unacked     no      no            yes
====================  ======  ============  ========

Chosen, and why:

* The *trend* is judged, not a value: the level (median of nine, see ``trend``) must lie outside
  reference ± tolerance.
* **Minimum** of five values under a level, so that three must agree before anything is said.
* **On-delay** two: the levels after two values in a row must lie outside. **Off-delay** three, and
  **hysteresis** a tenth of the tolerance: it is cleared when three levels in a row lie inside the band
  shrunk by it. Together: a step that leaves the band is seen after six values, and a trend that rests on the
  limit does not chatter.
* The decision depends on accepted values only. A refused, failed or missing run adds none, so that nothing
  but measured values can clear an alarm. Their absence is an alarm of its own kind, RUN_MISSING: raised after
  two scheduled nights in a row without an accepted value (one refusal is ordinary), cleared by the next
  value.
* What it costs, in 400 simulated axis-years (tests/service/monitoring/test_alarm_rates.py): with a tolerance
  of three standard deviations of one value no false alarm, neither with independent values nor with AR(1)
  0.6; with two, none with independent values and one in 13 % of the years with AR(1) 0.6. So a tolerance
  should be at least three times the scatter of the values.
"""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from service.monitoring.trend import WINDOW, Trend, levels, trend

Array = NDArray[np.float64]


class AlarmKind(StrEnum):
    """What an alarm is about."""

    BACKLASH_HIGH = "backlash_high"
    BACKLASH_LOW = "backlash_low"
    RUN_MISSING = "run_missing"


class AlarmEvent(StrEnum):
    """What can happen to an alarm."""

    RAISED = "raised"
    CLEARED = "cleared"
    ACKNOWLEDGED = "acknowledged"
    REMARKED = "remarked"


@dataclass(frozen=True)
class AlarmState:
    """Where an alarm stands; the default is ISA-18.2's normal."""

    active: bool = False
    acknowledged: bool = True

    @property
    def retained(self) -> bool:
        """Whether it is still to be shown."""
        return self.active or not self.acknowledged


@dataclass(frozen=True)
class Change:
    """A decision about one alarm; ``detail`` says what was seen, in a sentence."""

    kind: AlarmKind
    event: AlarmEvent
    detail: str


@dataclass(frozen=True)
class Band:
    """Reference value and tolerance [m]: the trend is to stay within reference ± tolerance."""

    reference: float
    tolerance: float

    def __post_init__(self) -> None:
        if not (self.reference >= 0 and self.tolerance > 0):
            raise ValueError(f"a band needs a reference >= 0 and a tolerance > 0, got {self}")


@dataclass(frozen=True)
class AlarmRule:
    """The constants of the decision, counted in values; reasons in the module's docstring."""

    window: int = WINDOW
    minimum: int = 5
    on_delay: int = 2
    off_delay: int = 3
    hysteresis: float = 0.1
    missed_nights: int = 2


@dataclass(frozen=True)
class Judgement:
    """What a history says now: its trend (None while empty) and the changes of its alarms."""

    trend: Trend | None
    changes: tuple[Change, ...]


def transition(state: AlarmState, event: AlarmEvent) -> AlarmState:
    """Return the state after an event; an event that says nothing new leaves it as it is.

    A repeated raise does not take an acknowledgement back; a raise after a return does. A remark is a line in
    the journal and no more.
    """
    if event is AlarmEvent.REMARKED:
        return state
    if event is AlarmEvent.RAISED:
        return state if state.active else AlarmState(active=True, acknowledged=False)
    if event is AlarmEvent.CLEARED:
        return AlarmState(active=False, acknowledged=state.acknowledged)
    return AlarmState(active=state.active, acknowledged=True)


def outside(level: Array, band: Band, kind: AlarmKind) -> NDArray[np.bool_]:
    """Where levels [m] (n,) lie beyond the band on the side of ``kind``."""
    excess = _excess(level, band, kind)
    return excess > 0


def judge(
    t: Array,
    b: Array,
    band: Band | None,
    active: AbstractSet[AlarmKind] = frozenset(),
    rule: AlarmRule | None = None,
) -> Judgement:
    """Judge an axis' history after a value was added, or again at any time: the answer is the same.

    Parameters
    ----------
    t : (n,) array
        Times of the accepted values, ascending [s].
    b : (n,) array
        Accepted values of one method and one series, oldest first [m].
    band : Band or None
        Reference and tolerance; None for an axis that has none yet, whose trend is stated without alarms.
    active : set of AlarmKind
        The alarms of the axis that are active now.
    rule : AlarmRule, optional
        Delays and hysteresis.
    """
    rule = rule or AlarmRule()
    now = trend(t, b, rule.window)
    if band is None:
        return Judgement(now, ())
    judged = _judged_levels(b, rule)
    found = (
        _decide(judged, band, k, k in active, rule) for k in (AlarmKind.BACKLASH_HIGH, AlarmKind.BACKLASH_LOW)
    )
    return Judgement(now, tuple(change for change in found if change is not None))


def judge_nights(
    has_value: NDArray[np.bool_], active: AbstractSet[AlarmKind] = frozenset(), rule: AlarmRule | None = None
) -> tuple[Change, ...]:
    """Judge whether scheduled nights brought a value.

    Parameters
    ----------
    has_value : (n,) bool array
        For each scheduled night, oldest first: whether the axis has an accepted value from it. A run on
        demand since the last scheduled night counts as a further entry.
    active : set of AlarmKind
        The alarms of the axis that are active now.
    rule : AlarmRule, optional
        Number of nights that may be missed.
    """
    rule = rule or AlarmRule()
    if has_value.size == 0:
        return ()
    if has_value[-1]:
        cleared = Change(AlarmKind.RUN_MISSING, AlarmEvent.CLEARED, "an accepted value has arrived")
        return (cleared,) if AlarmKind.RUN_MISSING in active else ()
    missed = _trailing_false(has_value)
    if missed < rule.missed_nights or AlarmKind.RUN_MISSING in active:
        return ()
    return (Change(AlarmKind.RUN_MISSING, AlarmEvent.RAISED, _missing_detail(missed)),)


def _excess(level: Array, band: Band, kind: AlarmKind) -> Array:
    """How far [m] levels lie beyond the limit of one side; negative inside."""
    sign = 1.0 if kind is AlarmKind.BACKLASH_HIGH else -1.0
    return sign * (level - band.reference) - band.tolerance


def _judged_levels(b: Array, rule: AlarmRule) -> Array:
    """The latest levels [m] that rest on the minimum of values, as many as the longer delay needs."""
    depth = max(rule.on_delay, rule.off_delay)
    tail = b[-(rule.window + depth - 1) :]
    first = max(rule.minimum - 1, tail.size - depth)
    return levels(tail, rule.window)[first:]


def _decide(judged: Array, band: Band, kind: AlarmKind, active: bool, rule: AlarmRule) -> Change | None:
    excess = _excess(judged, band, kind)
    if not active and excess.size >= rule.on_delay and bool((excess[-rule.on_delay :] > 0).all()):
        return Change(kind, AlarmEvent.RAISED, _band_detail(float(judged[-1]), band, "outside"))
    inside = excess[-rule.off_delay :] <= -rule.hysteresis * band.tolerance
    if active and excess.size >= rule.off_delay and bool(inside.all()):
        return Change(kind, AlarmEvent.CLEARED, _band_detail(float(judged[-1]), band, "back inside"))
    return None


def _band_detail(level: float, band: Band, where: str) -> str:
    return (
        f"the trend stands at {level * 1e6:.1f} µm, {where} "
        f"{band.reference * 1e6:.1f} ± {band.tolerance * 1e6:.1f} µm"
    )


def _missing_detail(missed: int) -> str:
    return (
        f"{missed} scheduled nights in a row brought no accepted value: the machine was off, busy or not "
        f"ready, "
        "or its runs were refused; see the list of runs for the reasons"
    )


def _trailing_false(has_value: NDArray[np.bool_]) -> int:
    return int(np.argmax(has_value[::-1])) if bool(has_value.any()) else int(has_value.size)
