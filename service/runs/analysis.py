"""The numerics of a run, in processes of their own, so that neither the API nor the motion waits for them.

The immediate estimate has a worker that stays. What takes seconds to minutes (a refinement, an explanation, a
value with a revised model) has a process for itself, which gives its memory back and can be ended at any
moment; explanations yield the processor to everything else.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from service.backlash.estimate import immediate, refined
from service.backlash.results import AxisResult
from service.captures import CaptureError, read_capture
from service.identification.explain import NOTHING, explain
from service.identification.explanation import Accepted, CannotExplain, Explanation
from service.recording import Recording
from service.runs.revised import Effects, Explainer, Reviser, by_refitting

Results = tuple[AxisResult, ...]
Tell = Callable[[str], None]

LONGEST = 1800.0
"""An explanation or a revised value that takes longer is given up [s]; chosen: ten times what a gantry may take."""
LOWEST = 19
"""Niceness of what nobody waits for: the refined value of the next run comes first."""


class AnalysisError(RuntimeError):
    """The analysis process died; the capture is kept, and `flankwatch analyze` reads it again."""


class AnalysisStopped(AnalysisError):
    """The service ended before the answer was there."""


@dataclass(frozen=True)
class KnownCapture:
    """A capture on disk and the SHA-256 that it had when it was written."""

    path: Path
    sha256: str

    def read(self) -> Recording:
        """Read it; CaptureError when it is gone, damaged or changed."""
        return read_capture(self.path, expected_sha256=self.sha256)


@dataclass(frozen=True)
class _Told:
    """A line of progress from the analysis process."""

    text: str


class Analysis(AbstractContextManager["Analysis"]):
    """Estimates captures whose checksum is known; each call waits for its answer, from any thread.

    ``explainer`` and ``reviser`` are called in a spawned process and must be importable by name.
    """

    def __init__(self, explainer: Explainer = explain, reviser: Reviser = by_refitting) -> None:
        self._explainer, self._reviser = explainer, reviser
        self._pool: ProcessPoolExecutor | None = None
        self._stop = threading.Event()

    def __exit__(self, *exc: object) -> None:
        self.stop()
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None

    def stop(self) -> None:
        """End what is under way beside the immediate estimates, and let nothing of it begin."""
        self._stop.set()

    def immediate(self, path: Path, sha256: str) -> Results:
        """The plain estimate of every axis. Raises AnalysisError, CaptureError."""
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(max_workers=1, mp_context=context)
        try:
            return self._pool.submit(_estimate, immediate, KnownCapture(path, sha256)).result()
        except BrokenProcessPool as error:
            self._pool = None
            raise _died(path) from error

    def refined(self, path: Path, sha256: str) -> Results:
        """The model fit of every axis. Raises AnalysisError, also when stopped, and CaptureError."""
        job = partial(_refine, KnownCapture(path, sha256))
        return tuple(self._apart(job, path))

    def explain(
        self,
        train: Sequence[KnownCapture],
        validate: KnownCapture,
        tell: Tell = lambda _: None,
        accepted: Mapping[str, Accepted] = NOTHING,
    ) -> Explanation:
        """What the declared model lacks, or the accepted one. Raises AnalysisError, CaptureError, CannotExplain."""
        job = partial(_explain, self._explainer, tuple(train), validate, dict(accepted))
        found: Explanation = self._apart(job, validate.path, tell, LOWEST)
        return found

    def revised(
        self, capture: KnownCapture, effects: Effects, others: Sequence[KnownCapture] = ()
    ) -> Results:
        """The value of every axis in ``effects`` with these effects in its model, named by axis.

        Raises AnalysisError, CaptureError, CannotExplain.
        """
        job = partial(_revise, self._reviser, capture, dict(effects), tuple(others))
        return tuple(self._apart(job, capture.path, niceness=LOWEST))

    def _apart(
        self, job: Callable[[Tell], Any], path: Path, tell: Tell = lambda _: None, niceness: int = 0
    ) -> Any:
        """Do a job in a process of its own."""
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe(duplex=False)
        process = context.Process(
            target=_perform, args=(theirs, job, niceness), name="flankwatch-analysis", daemon=True
        )
        process.start()
        theirs.close()
        try:
            return self._await(ours, path, tell)
        finally:
            process.kill()
            process.join()
            process.close()
            ours.close()

    def _await(self, connection: Connection, path: Path, tell: Tell) -> Any:
        until = time.monotonic() + LONGEST
        while True:
            if not connection.poll(0.2):
                self._may_go_on(until, path)
                continue
            try:
                answer = connection.recv()
            except EOFError as error:
                raise _died(path) from error
            if isinstance(answer, _Told):
                tell(answer.text)
            elif isinstance(answer, Exception):
                raise answer
            else:
                return answer

    def _may_go_on(self, until: float, path: Path) -> None:
        if self._stop.is_set():
            raise AnalysisStopped(f"the service ended; flankwatch analyze {path} reads the capture again")
        if time.monotonic() > until:
            raise AnalysisError(f"no answer within {LONGEST / 60:.0f} min; the capture is kept: {path}")


def _estimate(method: Callable[[Recording], Sequence[AxisResult]], capture: KnownCapture) -> Results:
    return tuple(method(capture.read()))


def _refine(capture: KnownCapture, tell: Tell) -> Results:
    return _estimate(refined, capture)


def _explain(
    explainer: Explainer,
    train: Sequence[KnownCapture],
    validate: KnownCapture,
    accepted: Mapping[str, Accepted],
    tell: Tell,
) -> Explanation:
    return explainer([capture.read() for capture in train], validate.read(), tell, accepted)


def _revise(
    reviser: Reviser,
    capture: KnownCapture,
    effects: Mapping[str, tuple[str, ...]],
    others: Sequence[KnownCapture],
    tell: Tell,
) -> Results:
    return tuple(reviser(capture.read(), effects, [other.read() for other in others]))


def _perform(connection: Connection, job: Callable[[Tell], Any], niceness: int) -> None:
    """Body of a process: send lines of progress, then the answer or what forbids one."""
    os.nice(niceness)
    with contextlib.closing(connection):
        try:
            connection.send(job(lambda text: connection.send(_Told(text))))
        except (CaptureError, CannotExplain) as error:
            connection.send(error)


def _died(path: Path) -> AnalysisError:
    return AnalysisError(
        "the analysis process ended in mid-work, likely for lack of memory or by a fault of the program, which "
        f"the journal then holds; the capture is kept: flankwatch analyze {path} reads it again"
    )
