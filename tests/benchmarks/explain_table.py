"""Planted against answered: run the whole loop over a folder of NAME-train / -validate / -truth and print a table.

    python tests/benchmarks/explain_table.py FOLDER [--jobs 1] [--limit N]

FOLDER is searched recursively. The truth's ``effect`` is what was planted, ``none`` on a clean machine, and
``outside`` (or a name that the library does not have) where the right answer is ``unknown``.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter, defaultdict
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from service.captures import read_capture
from service.dynamics.effects.driven_library import DRIVEN
from service.identification.explain import explain
from service.identification.explanation import CannotExplain


def answer(truth_file: Path) -> dict[str, object]:
    """Planted and answered of one pair, with errors and the time taken."""
    truth = json.loads(truth_file.read_text())
    stem = truth_file.name.removesuffix("-truth.json")
    pair = [read_capture(truth_file.with_name(f"{stem}-{part}.parquet")) for part in ("train", "validate")]
    start = time.monotonic()
    row: dict[str, object] = {"name": stem, "planted": truth.get("effect") or "none"}
    try:
        axes = explain(pair[:1], pair[1]).axes
    except CannotExplain as refusal:
        return {**row, "answer": "refused", "why": str(refusal), "seconds": time.monotonic() - start}
    first = axes[0]
    named = " + ".join(first.effects) if first.finding == "effect" else first.finding
    # A gap that changes along the rack is reported where the moves that were fitted crossed it.
    planted = truth.get("backlash_by_recording_m", {}).get("train", truth["backlash_m"])
    errors = [
        (abs((a.before.backlash or 0.0) - planted[a.axis]), abs((a.after.backlash or 0.0) - planted[a.axis]))
        for a in axes
    ]
    return {
        **row,
        "answer": named,
        "first": first.effects[0] if first.finding == "effect" else first.finding,
        "rivals": [sorted(group) for group in first.indistinguishable],
        "noise": first.noise_rms,
        "ratio_before": first.before.validation_rms / first.noise_rms,
        "ratio_after": max(a.after.validation_rms / a.noise_rms for a in axes),
        "before_um": 1e6 * max(e[0] for e in errors),
        "after_um": 1e6 * max(e[1] for e in errors),
        "seconds": time.monotonic() - start,
    }


def right(row: dict[str, object], library: set[str]) -> bool:
    """Whether the answer names what was planted, alone or as one of a pair that it calls indistinguishable."""
    expected = row["planted"] if row["planted"] in library or row["planted"] == "none" else "unknown"
    named = [group for group in row.get("rivals", []) if expected in group]  # type: ignore[attr-defined]
    return row.get("first") == expected or bool(named)


def show(row: dict[str, object]) -> None:
    if "first" not in row:
        print(f"{row['name']:38s} {row['planted']:28s} {row['answer']}: {row.get('why', '')}", flush=True)
        return
    print(
        f"{row['name']:38s} {row['planted']:28s} {row['answer']:48s} "
        f"RMS/noise {row['ratio_before']:7.2f} -> {row['ratio_after']:5.2f}  "
        f"backlash error {row['before_um']:7.2f} -> {row['after_um']:6.2f} um  {row['seconds']:4.0f} s",
        flush=True,
    )


def main() -> None:
    """Run, print each pair as it is done, then the table by planted effect."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--limit", type=int, default=None)
    options = parser.parse_args()
    files = [f for f in sorted(options.folder.rglob("*-truth.json")) if _complete(f)][: options.limit]
    rows = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for row in pool.map(answer, files):
            show(row)
            rows.append(row)
    library = set(DRIVEN)
    table: dict[object, list[dict[str, object]]] = defaultdict(list)
    for row in rows:
        table[row["planted"]].append(row)
    print(f"\n{'planted':30s} {'right':>9s}  answered")
    for planted, group in table.items():
        score = f"{sum(right(row, library) for row in group)}/{len(group)}"
        answers = Counter(str(row["answer"]) for row in group)
        print(f"{planted!s:30s} {score:>9s}  " + ", ".join(f"{n} {a}" for a, n in answers.most_common()))


def _complete(truth: Path) -> bool:
    stem = truth.name.removesuffix("-truth.json")
    return all(truth.with_name(f"{stem}-{part}.parquet").exists() for part in ("train", "validate"))


if __name__ == "__main__":
    main()
