"""Prometheus' text format 0.0.4: gauges of each axis, alarms and runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from service.monitoring.alarm import AlarmKind
from service.store.records import AxisRecord, ValueRecord
from service.store.repository import Repository

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"

Labels = tuple[tuple[str, str], ...]
Sample = tuple[Labels, float]


@dataclass(frozen=True)
class Family:
    """All samples of one name."""

    name: str
    help: str
    samples: Sequence[Sample]
    kind: str = "gauge"


def render(families: Sequence[Family]) -> str:
    """Write families in the text format."""
    return "".join(line + "\n" for family in families for line in _lines(family))


def collect(repository: Repository, version: str, missing: Sequence[str], busy: bool) -> list[Family]:
    """Read all that there is to say from the store."""
    axes = repository.axes()
    measured = [
        (axis, value) for axis in axes for value in repository.values(axis.name, limit=1, accepted=True)
    ]
    return [
        Family("flankwatch_info", "Flankwatch's version.", [((("version", version),), 1.0)]),
        Family("flankwatch_ready", "1 when the service can measure.", [((), float(not missing))]),
        Family("flankwatch_busy", "1 while a check waits or moves.", [((), float(busy))]),
        *_axis_families(axes),
        *_value_families(measured),
        _by_products(repository, axes),
        _alarms(repository, axes),
        Family(
            "flankwatch_runs_total", "Finished runs by how they ended.", _runs(repository), kind="counter"
        ),
    ]


def _axis_families(axes: Sequence[AxisRecord]) -> Iterator[Family]:
    references = [(_axis(axis), axis.reference) for axis in axes if axis.reference is not None]
    tolerances = [(_axis(axis), axis.tolerance) for axis in axes if axis.tolerance is not None]
    yield Family("flankwatch_reference_metres", "Backlash that the axis is meant to have.", references)
    yield Family("flankwatch_tolerance_metres", "How far the trend may be from the reference.", tolerances)


def _value_families(measured: Sequence[tuple[AxisRecord, ValueRecord]]) -> Iterator[Family]:
    values = [(_axis(axis), value.outcome.result) for axis, value in measured]
    trends = [(_axis(axis), value.outcome.trend) for axis, value in measured]
    backlash = [(axis, result.backlash) for axis, result in values if result.backlash is not None]
    yield Family("flankwatch_backlash_metres", "The latest accepted value.", backlash)
    for end, name in enumerate(("low", "high")):
        ends = [(axis, result.interval_95[end]) for axis, result in values if result.interval_95]
        yield Family(f"flankwatch_backlash_{name}_metres", f"The {name} end of its 95 % interval.", ends)
    levels = [(axis, trend.level) for axis, trend in trends if trend is not None]
    yield Family("flankwatch_trend_metres", "Median of the last accepted values.", levels)
    at = [(_axis(axis), value.measured_at.timestamp()) for axis, value in measured]
    yield Family("flankwatch_measured_timestamp_seconds", "When the latest accepted value was measured.", at)


def _by_products(repository: Repository, axes: Sequence[AxisRecord]) -> Family:
    """The latest of each; the unit is a label, since each name has its own."""
    samples: list[Sample] = []
    for axis in axes:
        for record in repository.parts.by_products(axis.name, limit=1):
            labels = (*_axis(axis), ("name", record.product.name), ("unit", record.product.unit))
            samples.append((labels, record.product.value))
    return Family("flankwatch_by_product", "Stiffness, friction, skew of the latest accepted value.", samples)


def _alarms(repository: Repository, axes: Sequence[AxisRecord]) -> Family:
    """Every axis and kind has its two samples at all times: an absent series would clear a rule."""
    samples: list[Sample] = []
    for axis in axes:
        states = {alarm.kind: alarm.state for alarm in repository.alarms(axis=axis.name)}
        for kind in AlarmKind:
            state = states.get(kind)
            labels = (*_axis(axis), ("kind", kind.value))
            samples.append(((*labels, ("is", "active")), float(state is not None and state.active)))
            samples.append(
                ((*labels, ("is", "unacknowledged")), float(state is not None and not state.acknowledged))
            )
    return Family(
        "flankwatch_alarm", "1 while an alarm is active, and while it is not acknowledged.", samples
    )


def _runs(repository: Repository) -> list[Sample]:
    counts = repository.run_counts()
    return [((("state", state),), float(counts.get(state, 0))) for state in ("ok", "refused", "failed")]


def _axis(axis: AxisRecord) -> Labels:
    return (("axis", axis.name), ("group", axis.group))


def _lines(family: Family) -> Iterator[str]:
    yield f"# HELP {family.name} {family.help}"
    yield f"# TYPE {family.name} {family.kind}"
    for labels, value in family.samples:
        yield f"{family.name}{_labels(labels)} {value!r}"


def _labels(labels: Labels) -> str:
    if not labels:
        return ""
    return "{" + ",".join(f'{name}="{_escape(value)}"' for name, value in labels) + "}"


def _escape(value: str) -> str:
    return value.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")
