"""Errors of the paper's method on the declared captures.

    python tests/benchmarks/accuracy_paper.py [FOLDER]

FOLDER holds NAME.parquet beside NAME-truth.json; by default ../shared/captures of the checkout.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from service.backlash.paper import paper
from service.backlash.results import AxisResult
from service.captures import read_capture

COLUMNS = "{:22} {:4} {:>7} {:>7} {:>17} {:>7} {:>7} {:>6} {:>6}"
HEADING = COLUMNS.format(
    "capture", "axis", "true", "paper", "95 % interval", "error", "error", "steps", "time"
)
UNITS = COLUMNS.format("", "", "µm", "µm", "µm", "µm", "%", "", "s")


def main(folder: Path) -> None:
    """Print one line per axis and the medians of singles and gantries."""
    files = sorted(folder.glob("declared-*.parquet"))
    if not files:
        print(f"no declared captures in {folder}: nothing measured")
        return
    print(HEADING)
    print(UNITS)
    errors: dict[str, list[float]] = {"single": [], "gantry": []}
    covered = []
    for file in files:
        truth = json.loads(file.with_name(f"{file.stem}-truth.json").read_text())["backlash_m"]
        recording = read_capture(file)
        for axis in recording.axes:
            start = time.perf_counter()
            result = paper(recording, axis.name)
            taken = time.perf_counter() - start
            print(line(file.stem, result, truth[axis.name], taken))
            if result.backlash is not None and result.interval_95 is not None:
                errors["gantry" if recording.gantry else "single"].append(
                    result.backlash / truth[axis.name] - 1.0
                )
                covered.append(result.interval_95[0] <= truth[axis.name] <= result.interval_95[1])
    for kind, found in errors.items():
        if found:
            sizes = np.abs(found)
            print(
                f"{kind}: median |error| {np.median(sizes):.1%}, worst {np.max(sizes):.1%}, {len(found)} values"
            )
    print(f"interval covers {sum(covered)} of {len(covered)}")


def line(name: str, result: AxisResult, true: float, taken: float) -> str:
    """One axis: what was estimated beside what is true."""
    used = f"{sum(step.verdict == 'ok' for step in result.steps)}/{len(result.steps)}"
    start = f"{name:22} {result.axis:4} {true * 1e6:7.2f}"
    if result.backlash is None or result.interval_95 is None:
        return f"{start} refused: {result.reason} {used} {taken:.2f}"
    interval = f"{result.interval_95[0] * 1e6:.2f} … {result.interval_95[1] * 1e6:.2f}"
    error = result.backlash - true
    return (
        f"{start} {result.backlash * 1e6:7.2f} {interval:>17} {error * 1e6:+7.2f} {error / true * 100:+7.1f} "
        f"{used:>6} {taken:6.2f}"
    )


if __name__ == "__main__":
    default = (Path(__file__).parents[2] / ".." / "shared" / "captures").resolve()
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else default)
