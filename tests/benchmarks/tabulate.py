"""Records of the accuracy benchmark as its tables: errors, coverage, refusals, time; faults; ratio of the medians."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from service.backlash.results import OF_THE_METHOD
from service.recording import FloatArray
from tests.benchmarks.measuring import Record

HEADINGS = (
    ("row", 14), ("method", 21), ("n", 4), ("ref.", 5), ("median", 8), ("p95", 8), ("worst", 8), ("worst", 7),
    ("goal", 7), ("stretch", 8), ("covered", 8), ("half", 7), ("CPU", 7), ("most", 7), ("peak", 6),
)  # fmt: skip
UNITS = ("", "", "", "", "µm", "µm", "µm", "%", "%", "%", "%", "µm", "s", "s", "MB")


def limits(record: Record) -> tuple[float, float]:
    """Largest errors [m] that count as within the goal and within the stretch, by the issue's table."""
    b = record["true_m"]
    if record["row"].startswith("impure"):
        return max(1e-6, 0.02 * b), float("nan")
    if record["axes"] == 1:
        return max(0.3e-6, 0.005 * b), max(0.2e-6, 0.003 * b)
    return max(1e-6, 0.02 * b), max(0.5e-6, 0.01 * b)


def error(record: Record) -> float:
    """|estimated − true| [m]."""
    return abs(float(record["backlash_m"]) - float(record["true_m"]))


def half_width(record: Record) -> float:
    """Half of the 95 % interval [m]."""
    low, high = record["interval_95_m"]
    return 0.5 * float(high - low)


def covers(record: Record) -> bool:
    """Whether the 95 % interval holds the truth."""
    low, high = record["interval_95_m"]
    return bool(low <= record["true_m"] <= high)


def answered(records: Iterable[Record]) -> list[Record]:
    """Those with a value."""
    return [record for record in records if record["verdict"] == "ok"]


def service(records: Sequence[Record]) -> list[Record]:
    """What the product reports of each axis: the fit, or the paper's value beside a refusal of the fit alone."""
    plain = {_axis(r): r for r in records if r["method"] == "paper"}
    fits = {_axis(r): r for r in records if r["method"] == "model_fit"}
    both = [plain[a] if fits[a]["reason"] in OF_THE_METHOD else fits[a] for a in fits if a in plain]
    return [record | {"method": "service"} for record in both]


def print_tables(records: Sequence[Record]) -> None:
    """Everything there is to say about the records."""
    every = [*records, *service(records)]
    sound = [r for r in every if r["row"] != "faults"]
    _print_accuracy(sound)
    _print_ratio(sound)
    _print_refusals(sound)
    _print_faults([r for r in every if r["row"] == "faults"])


def line(row: str, method: str, records: Sequence[Record]) -> str:
    """One line of the table; lengths in µm."""
    found = answered(records)
    start = [row, method, str(len(records)), str(len(records) - len(found))]
    if not found:
        return _columns([*start, *("–",) * 8, *_cost(records)])
    errors = np.array([error(r) for r in found])
    relative = errors / np.array([r["true_m"] for r in found])
    goal, stretch = np.array([limits(r) for r in found]).T
    cells = [
        f"{1e6 * np.median(errors):.3f}",
        f"{1e6 * np.quantile(errors, 0.95):.2f}",
        f"{1e6 * errors.max():.2f}",
        f"{100 * relative.max():.1f}",
        _share(errors <= goal),
        "–"
        if np.all(np.isnan(stretch))
        else _share(errors[~np.isnan(stretch)] <= stretch[~np.isnan(stretch)]),
        _share(np.array([covers(r) for r in found])),
        f"{1e6 * np.median([half_width(r) for r in found]):.2f}",
    ]
    return _columns([*start, *cells, *_cost(records)])


def _cost(records: Sequence[Record]) -> list[str]:
    """CPU time of a capture, median and most, and the highest peak of memory; a service's is that of its fit."""
    times = {r["capture"]: r["cpu_s"] for r in records}.values()
    if not times:
        return ["–"] * 3
    peak = max(r["peak_mb"] for r in records)
    return [f"{np.median(list(times)):.2f}", f"{max(times):.2f}", f"{peak:.0f}"]


def _print_accuracy(records: Sequence[Record]) -> None:
    print(_columns([name for name, _ in HEADINGS]))
    print(_columns(UNITS))
    rows = list(dict.fromkeys(r["row"] for r in records))
    methods = list(dict.fromkeys(r["method"] for r in records))
    for row in rows:
        for method in methods:
            of = [r for r in records if (r["row"], r["method"]) == (row, method)]
            if of:
                print(line(row, method, of))
    if len(rows) > 1:
        for method in methods:
            print(line("all", method, [r for r in records if r["method"] == method]))


def _print_ratio(records: Sequence[Record]) -> None:
    """Median error of the paper's thresholds over the fit's, on the axes that both answered."""
    for row in dict.fromkeys(r["row"] for r in records):
        plain, fit = (
            {_axis(r): error(r) for r in answered(records) if (r["row"], r["method"]) == (row, method)}
            for method in ("paper", "model_fit")
        )
        both = sorted(set(plain) & set(fit))
        if both:
            medians = [float(np.median([errors[a] for a in both])) for errors in (plain, fit)]
            print(
                f"{row}: median error paper {medians[0] * 1e6:.3f} µm, model_fit {medians[1] * 1e6:.3f} µm on the "
                f"same {len(both)} axes: ratio {medians[0] / medians[1]:.1f}"
            )


def _print_refusals(records: Sequence[Record]) -> None:
    """Why sound machines were refused, by the methods that the product reports."""
    for record in records:
        if record["verdict"] == "refused" and record["method"] in ("service", "model_fit"):
            way = "" if record["both_ways"] else " (crosses one way only, by the truth)"
            print(
                f"refused by {record['method']}: {record['capture']} {record['axis']}{way}: {record['detail']}"
            )
    for method in ("model_fit", "service"):
        # On a gantry a gap that is crossed one way only is not to be told from the zeros' distance: no sound run.
        sound = [r for r in records if r["method"] == method and r["both_ways"]]
        refused = [r for r in sound if r["verdict"] == "refused"]
        if sound:
            captures, lost = ({(r["row"], r["capture"]) for r in those} for those in (sound, refused))
            print(
                f"refused by {method} of what crosses its gap both ways: {len(refused)} of {len(sound)} axes "
                f"({len(refused) / len(sound):.1%}), {len(lost)} of {len(captures)} runs"
            )


def _print_faults(records: Sequence[Record]) -> None:
    """Share of each fault's captures that were refused, and by which reason; an accepted one is named."""
    if not records:
        return
    faults = list(dict.fromkeys(_fault(r) for r in records))
    print(f"\n{'fault':14}{'method':22}{'refused':>12}  reasons")
    for fault in faults:
        for method in dict.fromkeys(r["method"] for r in records):
            of = [r for r in records if (_fault(r), r["method"]) == (fault, method)]
            refused = [r for r in of if r["verdict"] == "refused"]
            reasons = ", ".join(dict.fromkeys(str(r["reason"]) for r in refused))
            print(f"{fault:14}{method:22}{f'{len(refused)} of {len(of)}':>12}  {reasons}")
    for record in answered(records):
        if record["method"] == "service":
            print(f"accepted: {record['capture']} {record['axis']} by {record['answered_by']}")


def _fault(record: Record) -> str:
    return str(record["capture"]).removeprefix("fault-").rpartition("-")[0]


def _axis(record: Record) -> tuple[str, str, str]:
    return record["row"], record["capture"], record["axis"]


def _share(true: FloatArray) -> str:
    return f"{100 * np.mean(true):.1f}"


def _columns(cells: Sequence[str]) -> str:
    out = []
    for k, (cell, (_, width)) in enumerate(zip(cells, HEADINGS, strict=True)):
        out.append(f"{cell:<{width}}" if k < 2 else f"{cell:>{width}}")
    return " ".join(out)
