"""The numerics of a run, in a process of their own, so that neither the API nor the motion waits for them."""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager
from pathlib import Path

from service.backlash.estimate import estimate
from service.backlash.results import AxisResult
from service.captures import read_capture


class AnalysisError(RuntimeError):
    """The analysis process died; the capture is kept, and `flankwatch analyze` reads it again."""


def analyse_capture(path: Path, sha256: str) -> tuple[AxisResult, ...]:
    """Read a capture whose checksum is known and estimate the backlash of each of its axes."""
    return tuple(estimate(read_capture(path, expected_sha256=sha256)))


class AnalysisProcess(AbstractContextManager["AnalysisProcess"]):
    """One worker process, started with the first capture, and anew after it died."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None

    def __exit__(self, *exc: object) -> None:
        self.close()

    def __call__(self, path: Path, sha256: str) -> Sequence[AxisResult]:
        """Analyse one capture and wait for it. Raises AnalysisError, or what reading the capture raised."""
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(max_workers=1, mp_context=context)
        try:
            return self._pool.submit(analyse_capture, path, sha256).result()
        except BrokenProcessPool as error:
            self.close()
            raise AnalysisError(
                "the analysis process ended in mid-work, likely for lack of memory; the capture is kept: "
                f"flankwatch analyze {path} reads it again"
            ) from error

    def close(self) -> None:
        """End the process; harmless when there is none."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None
