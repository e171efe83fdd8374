"""What goes into the store and comes out of it: frozen dataclasses, SI units, aware UTC times."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date, datetime
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from service.backlash.results import AxisResult, ByProduct
from service.monitoring.alarm import AlarmEvent, AlarmKind, AlarmState, Change
from service.monitoring.trend import Trend

RunKind = Literal["on_demand", "nightly"]
RunState = Literal["queued", "running", "ok", "refused", "failed"]
FinalState = Literal["ok", "refused", "failed"]

DECLARED = "declared"
"""The series of values that were computed with the model declared in the configuration."""


@dataclass(frozen=True)
class AxisRecord:
    """An axis: its group (the axes that move together), reference and tolerance [m], None until they are set.

    ``series`` names the series whose values are the axis' current ones; ``configured`` is False for an axis
    that the configuration no longer names: its history stays.
    """

    name: str
    group: str
    reference: float | None = None
    tolerance: float | None = None
    series: str = DECLARED
    configured: bool = True


@dataclass(frozen=True)
class StepParameters:
    """Steps other than the configured ones, to tell two candidates apart: SL [m], j_lim [m/s³], first direction ±1.

    ``places`` [m] are the middles of the steps along the rack; empty: where the axis stands.
    """

    length: float
    jerk: float
    direction: int = 1
    places: tuple[float, ...] = ()


@dataclass(frozen=True)
class RunOrder:
    """A run to be put into the box: ``target`` is what was asked for, an axis' or a group's name.

    ``local_date`` is given for a nightly run and only there; the store holds one per group and date.
    ``steps`` is None for the configured steps. A run of other steps is no measurement of the axis' backlash:
    what it finds is not reported.
    """

    kind: RunKind
    target: str
    group: str
    axes: tuple[str, ...]
    requested_at: datetime
    local_date: date | None = None
    idempotency_key: str | None = None
    steps: StepParameters | None = None


@dataclass(frozen=True)
class Queued:
    """The run is in the box; ``replayed`` when its Idempotency-Key had put it there before."""

    run_id: int
    replayed: bool = False


@dataclass(frozen=True)
class Busy:
    """Refused: the run ``run_id`` is queued or running, and there is one machine."""

    run_id: int


@dataclass(frozen=True)
class KeyReused:
    """Refused: the Idempotency-Key belongs to run ``run_id``, which was for something else."""

    run_id: int


@dataclass(frozen=True)
class AlreadyRun:
    """Refused: the group's nightly run of that local date is run ``run_id``."""

    run_id: int


QueueAnswer = Queued | Busy | KeyReused | AlreadyRun


@dataclass(frozen=True)
class UnknownTarget:
    """Refused: no axis and no group is called that; ``known`` names those that are."""

    known: tuple[str, ...]


@dataclass(frozen=True)
class BeyondLimits:
    """Refused: the steps are more than an axis may do; ``detail`` says which limit, and what to do."""

    detail: str


@dataclass(frozen=True)
class Unavailable:
    """Refused: the machine cannot move now; ``detail`` says what is wrong and what to do."""

    detail: str


CheckAnswer = Queued | Busy | KeyReused | UnknownTarget | Unavailable
StepsAnswer = CheckAnswer | BeyondLimits


@dataclass(frozen=True)
class Progress:
    """Where the run in the box stands: ``phase`` in a technician's words, ``done`` of ``total`` steps."""

    run_id: int
    target: str
    phase: str
    done: int
    total: int


@dataclass(frozen=True)
class CaptureFile:
    """A capture on disk: path relative to the captures' folder, and its SHA-256 in hexadecimal."""

    path: str
    sha256: str


@dataclass(frozen=True)
class RunRecord:
    """One run. ``reason`` and ``detail`` are None unless it was refused or failed.

    ``remarks`` are what was noticed and ended nothing: warnings of drives and sensors, in sentences.
    """

    id: int
    kind: RunKind
    state: RunState
    target: str
    group: str
    axes: tuple[str, ...]
    requested_at: datetime
    started_at: datetime | None = None
    finished_at: datetime | None = None
    local_date: date | None = None
    reason: str | None = None
    detail: str | None = None
    capture: CaptureFile | None = None
    idempotency_key: str | None = None
    steps: StepParameters | None = None
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class AxisOutcome:
    """One method's answer for one axis of a run.

    ``reported`` marks the answer that is the axis' value, one per run, axis and series; ``trend`` is the
    trend with this value in it (None when refused, or when the trend is not of this method).
    """

    result: AxisResult
    reported: bool = True
    series: str = DECLARED
    trend: Trend | None = None
    model_revision: int | None = None


@dataclass(frozen=True)
class AlarmChange:
    """A decision of ``service.monitoring.alarm`` about one axis."""

    axis: str
    change: Change


@dataclass(frozen=True)
class RunEnd:
    """How a run ended. A refused or failed run has a reason; an ok one has none."""

    run_id: int
    state: FinalState
    finished_at: datetime
    reason: str | None = None
    detail: str | None = None
    capture: CaptureFile | None = None
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Withdrawal:
    """What a run that ended ok is once a closer look has refused values of it: still ok where another axis has one.

    ``detail`` tells all of it: which values were shown until then, and why they are none.
    """

    state: FinalState
    reason: str | None
    detail: str


@dataclass(frozen=True)
class ValueRecord:
    """One stored answer: the outcome with its place."""

    id: int
    run_id: int
    measured_at: datetime
    outcome: AxisOutcome


@dataclass(frozen=True)
class ByProductRecord:
    """A by-product of the value of one run."""

    run_id: int
    measured_at: datetime
    product: ByProduct


@dataclass(frozen=True)
class History:
    """The accepted, reported values of one axis and series: times t [s since 1970 UTC] (n,), b [m] (n,)."""

    t: NDArray[np.float64]
    b: NDArray[np.float64]

    def with_value(self, t: float, b: float | None) -> History:
        """Append a value, or nothing where the run gave none."""
        return self if b is None else History(np.append(self.t, t), np.append(self.b, b))


@dataclass(frozen=True)
class AlarmRecord:
    """One occurrence of an alarm, from being raised until it is cleared and acknowledged."""

    id: int
    axis: str
    kind: AlarmKind
    state: AlarmState
    raised_at: datetime
    detail: str
    cleared_at: datetime | None = None
    acknowledged_at: datetime | None = None
    acknowledged_by: str | None = None


@dataclass(frozen=True)
class AlarmEventRecord:
    """One line of an alarm's journal, which is only ever added to."""

    event: AlarmEvent
    at: datetime
    detail: str
    by: str | None = None
    run_id: int | None = None
