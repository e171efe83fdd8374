"""One method on one capture: errors against the truth, CPU time and peak memory, as plain records.

A record is a flat JSON object per axis. It carries a fingerprint of the numerics that gave it, so that a resumed
campaign never mixes the answers of two versions.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import hashlib
import json
import resource
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from service.backlash.contact_regression import contact_regression
from service.backlash.estimate import immediate, refined
from service.backlash.paper import paper
from service.backlash.results import AxisResult
from service.captures import read_capture
from service.recording import Recording
from tests.benchmarks.baselines import BASELINES

Method = Callable[[Recording], Sequence[AxisResult]]
Record = dict[str, Any]

ROOT = Path(__file__).parents[2]


def each_axis(method: Callable[[Recording, str], AxisResult]) -> Method:
    """A method of one axis for all axes of a recording."""
    return lambda recording: [method(recording, axis.name) for axis in recording.axes]


METHODS: Mapping[str, Method] = {
    **{name: each_axis(method) for name, method in BASELINES.items()},
    "paper": each_axis(paper),
    "contact_regression": each_axis(contact_regression),
    "immediate": immediate,
    "model_fit": refined,
}
"""By name; `model_fit` is the service's refined value with the gate before it."""


@dataclass(frozen=True)
class Task:
    """One method on one capture of one row of the table."""

    row: str
    path: str
    method: str
    source: str

    @property
    def key(self) -> tuple[str, str, str]:
        """What a record of it is found by; the folder of a capture is that of its seed."""
        return self.row, self.path, self.method


def fingerprint(*folders: str) -> str:
    """Short hash of the Python files in folders of the checkout."""
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def warm_up(tasks: Sequence[Task]) -> None:
    """Run some tasks unmeasured, once per process: compiled code is loaded and caches are filled."""
    for task in tasks:
        METHODS[task.method](read_capture(Path(task.path)))


def measured(task: Task) -> list[Record]:
    """Run a task: one record per axis."""
    path, method = Path(task.path), METHODS[task.method]
    recording = read_capture(path)
    truth = json.loads(path.with_name(path.stem + "-truth.json").read_text())
    forget_peak()
    start = time.process_time()
    results = method(recording)
    spent = time.process_time() - start
    peak = peak_mb()
    shared = {"row": task.row, "path": task.path, "capture": path.name}
    shared |= {"method": task.method, "source": task.source}
    shared |= {"axes": len(recording.axes), "cpu_s": round(spent, 4), "peak_mb": round(peak, 1)}
    ways = crossed_both_ways(truth, len(recording.moves))
    return [
        shared | {"both_ways": ways[result.axis]} | _answer(result, truth["backlash_m"][result.axis])
        for result in results
    ]


def crossed_both_ways(truth: Mapping[str, Any], moves: int) -> dict[str, bool]:
    """Per axis whether the gap is crossed in more moves than go one way; where the truth does not say, it is."""
    counted = truth.get("moves_that_cross", {})
    return {axis: counted.get(axis, moves) > moves / 2 for axis in truth["backlash_m"]}


def _answer(result: AxisResult, truth: float) -> Record:
    return {
        "axis": result.axis,
        "true_m": truth,
        "verdict": result.verdict,
        "answered_by": result.method,
        "reason": None if result.reason is None else result.reason.value,
        "detail": result.detail,
        "backlash_m": result.backlash,
        "interval_95_m": None if result.interval_95 is None else list(result.interval_95),
    }


def forget_peak() -> None:
    """Start the kernel's record of this process' peak memory anew, where it lets one, and first give back what earlier
    tasks left behind: the product has a process for every fit."""
    gc.collect()
    with contextlib.suppress(OSError, AttributeError):  # not every C library can
        ctypes.CDLL(None).malloc_trim(0)
    with contextlib.suppress(OSError):  # else the peak is that of all captures so far, an upper bound
        Path("/proc/self/clear_refs").write_text("5")


def peak_mb() -> float:
    """Peak resident memory [MB] of this process since `forget_peak`."""
    try:
        status = Path("/proc/self/status").read_text()
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    line = next((text for text in status.splitlines() if text.startswith("VmHWM")), None)
    return (
        float(line.split()[1]) / 1024 if line else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    )
