"""Accuracy of every method on a folder of captures with truth: the table of the estimator's goals.

    python tests/benchmarks/accuracy.py FOLDER [--every N] [--first K] [--methods paper,contact_regression,model_fit]

FOLDER holds captures (*.parquet) and beside each STEM-truth.json with {"backlash_m": {"X1": …}}. Printed per
method: how many axes, how many were refused, median, 95th percentile and worst error, the share within the goal,
coverage and median half width of the 95 % interval, CPU time per capture, peak memory.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from service.backlash.contact_regression import contact_regression
from service.backlash.model_fit import model_fit_axes
from service.backlash.paper import paper
from service.backlash.results import AxisResult
from service.captures import read_capture
from service.recording import Recording

Method = Callable[[Recording], Mapping[str, AxisResult]]


def each_axis(method: Callable[[Recording, str], AxisResult]) -> Method:
    """A method of one axis for all axes of a recording."""
    return lambda recording: {axis.name: method(recording, axis.name) for axis in recording.axes}


METHODS: Mapping[str, Method] = {
    "paper": each_axis(paper),
    "contact_regression": each_axis(contact_regression),
    "model_fit": lambda recording: model_fit_axes(recording, recording.axes[0].name),
}


def goal(axes: int, b: float) -> float:
    """Largest error that counts as within the goal [m]."""
    return max(0.3e-6, 0.005 * b) if axes == 1 else max(1e-6, 0.02 * b)


def measure(method: Method, path: Path) -> tuple[list[tuple[float, float, float]], int, float]:
    """Errors, half widths and goals [m] of one capture's axes, number refused, CPU time [s]."""
    truth = json.loads(path.with_name(path.stem + "-truth.json").read_text())["backlash_m"]
    recording = read_capture(path)
    start = time.process_time()
    results = method(recording)
    spent = time.process_time() - start
    rows, refused = [], 0
    for axis, result in results.items():
        if result.backlash is None or result.interval_95 is None:
            refused += 1
            continue
        half = 0.5 * (result.interval_95[1] - result.interval_95[0])
        rows.append((result.backlash - truth[axis], half, goal(len(results), truth[axis])))
    return rows, refused, spent


def report(name: str, rows: list[tuple[float, float, float]], refused: int, times: list[float]) -> None:
    """One line of the table; lengths in µm."""
    if not rows:
        print(f"{name:20s} no value, {refused} refused")
        return
    error, half, limit = np.abs(np.array(rows)).T * 1e6
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{name:20s} n {len(rows):4d} refused {refused:3d} | median {np.median(error):7.3f} "
        f"p95 {np.quantile(error, 0.95):7.3f} worst {error.max():8.3f} µm | within goal "
        f"{np.mean(error <= limit):5.1%} | covered {np.mean(error <= half):5.1%} half {np.median(half):6.3f} µm | "
        f"{np.median(times):5.2f} s (most {max(times):5.2f}) | {peak:4.0f} MB",
        flush=True,
    )


def main() -> None:
    """Run the benchmark on one folder."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--methods", default=",".join(METHODS))
    options = parser.parse_args()
    known = [
        p for p in sorted(options.folder.glob("*.parquet")) if p.with_name(p.stem + "-truth.json").exists()
    ]
    paths = known[options.first :: options.every]
    for name in options.methods.split(","):
        rows, refused, times = [], 0, []
        for path in paths:
            found, lost, spent = measure(METHODS[name], path)
            rows += found
            refused += lost
            times.append(spent)
        report(name, rows, refused, times)


if __name__ == "__main__":
    main()
