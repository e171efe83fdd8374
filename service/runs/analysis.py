"""The numerics of a run, in processes of their own, so that neither the API nor the motion waits for them.

The immediate estimate has a worker that stays; a refinement, which takes seconds to tens of seconds, has a
process for itself, which gives its memory back and can be ended at any moment.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager
from multiprocessing.connection import Connection
from pathlib import Path

from service.backlash.estimate import immediate, refined
from service.backlash.results import AxisResult
from service.captures import CaptureError, read_capture
from service.recording import Recording

Results = tuple[AxisResult, ...]


class AnalysisError(RuntimeError):
    """The analysis process died; the capture is kept, and `flankwatch analyze` reads it again."""


class Analysis(AbstractContextManager["Analysis"]):
    """Estimates captures whose checksum is known; each call waits for its answer, from any thread."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None
        self._stop = threading.Event()

    def __exit__(self, *exc: object) -> None:
        self.stop()
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None

    def stop(self) -> None:
        """End the refinements that are under way, and let none begin."""
        self._stop.set()

    def immediate(self, path: Path, sha256: str) -> Results:
        """The plain estimate of every axis. Raises AnalysisError, CaptureError."""
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(max_workers=1, mp_context=context)
        try:
            return self._pool.submit(_estimate, immediate, path, sha256).result()
        except BrokenProcessPool as error:
            self._pool = None
            raise _died(path) from error

    def refined(self, path: Path, sha256: str) -> Results:
        """The model fit of every axis. Raises AnalysisError, also when stopped, and CaptureError."""
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe(duplex=False)
        process = context.Process(target=_refine, args=(theirs, path, sha256), name="flankwatch-analysis")
        process.start()
        theirs.close()
        try:
            return self._await(ours, path)
        finally:
            process.kill()
            process.join()
            process.close()
            ours.close()

    def _await(self, connection: Connection, path: Path) -> Results:
        while not connection.poll(0.2):
            if self._stop.is_set():
                raise AnalysisError(f"the service ended; flankwatch analyze {path} refines the value")
        try:
            answer = connection.recv()
        except EOFError as error:
            raise _died(path) from error
        if isinstance(answer, CaptureError):
            raise answer
        return tuple(answer)


def _estimate(method: Callable[[Recording], Sequence[AxisResult]], path: Path, sha256: str) -> Results:
    return tuple(method(read_capture(path, expected_sha256=sha256)))


def _refine(connection: Connection, path: Path, sha256: str) -> None:
    """Body of a refinement's process."""
    with contextlib.closing(connection):
        try:
            connection.send(_estimate(refined, path, sha256))
        except CaptureError as error:
            connection.send(error)


def _died(path: Path) -> AnalysisError:
    return AnalysisError(
        "the analysis process ended in mid-work, likely for lack of memory or by a fault of the program, which "
        f"the journal then holds; the capture is kept: flankwatch analyze {path} reads it again"
    )
