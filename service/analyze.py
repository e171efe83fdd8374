"""Many captures at once for the command line: one process per core, answers in the order of the files."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from service.backlash.estimate import estimate, immediate
from service.backlash.results import AxisResult
from service.captures import CaptureError, read_capture


@dataclass(frozen=True)
class Answer:
    """What one file gave: results per axis, or why it could not be read."""

    path: Path
    results: tuple[AxisResult, ...] = ()
    error: str | None = None


def analysed(files: Sequence[Path], quick: bool = False) -> Iterator[Answer]:
    """Analyse the files by the best method, or with ``quick`` by the paper's alone."""
    one = partial(_analyse, quick=quick)
    if quick or len(files) == 1:
        yield from map(one, files)
        return
    workers = min(len(files), os.cpu_count() or 1)
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(one, files)


def _analyse(path: Path, quick: bool) -> Answer:
    try:
        recording = read_capture(path)
    except CaptureError as error:
        return Answer(path, error=str(error))
    try:
        return Answer(path, immediate(recording) if quick else estimate(recording))
    except Exception as error:  # one recording that nobody foresaw must not take the others with it
        fault = f"{type(error).__name__}: {error}"
        return Answer(
            path, error=f"{path}: the analysis failed by a fault of the program ({fault}); please report it"
        )
