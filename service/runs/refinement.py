"""The refined values: first the immediate one is stored and shown, then the model fit's takes its place.

Works off finished runs one after the other in a thread, which waits for the analysis process; the plain value
stays in the store beside the refined one. Where the fit refuses the run itself, its refusal takes that place: the run
ends refused, and tells which value it has shown until then. Only an axis whose values come from an accepted revision is
not refused for what the declared model lacks.
"""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager

from service.backlash.estimate import stands
from service.backlash.results import AxisResult
from service.captures import CaptureError
from service.runs.analysis import AnalysisError
from service.runs.diagnostic_run import Workshop
from service.runs.judging import beside, is_measurement, judge_result
from service.store.records import DECLARED, AlarmChange, AxisOutcome, RunRecord, Withdrawal
from service.store.repository import Repository

log = logging.getLogger(__name__)


class Refinement(AbstractContextManager["Refinement"]):
    """Refines what is handed to ``submit`` until it is left; what is under way then is given up.

    ``then`` is told each run whose values are as good as they get, refined or not.
    """

    def __init__(self, workshop: Workshop, then: Callable[[int], None] = lambda _run: None) -> None:
        self._workshop = workshop
        self._then = then
        self._waiting: queue.Queue[int | None] = queue.Queue()
        self._thread = threading.Thread(target=self._work, name="refinement")

    def __enter__(self) -> Refinement:
        self._thread.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self._workshop.analysis.stop()
        self._waiting.put(None)
        self._thread.join()

    def submit(self, run_id: int) -> None:
        """Have a finished run refined."""
        self._waiting.put(run_id)

    def is_busy(self) -> bool:
        """Whether anything waits or is being refined."""
        return self._waiting.unfinished_tasks > 0

    def wait_idle(self) -> None:
        """Wait until everything that was submitted is done."""
        self._waiting.join()

    def _work(self) -> None:
        while (run_id := self._waiting.get()) is not None:
            try:
                self._refine(run_id)
                self._then(run_id)
            except Exception:
                # The thread must outlive one bad run; its immediate values stand.
                log.exception("run %d could not be refined", run_id)
            finally:
                self._waiting.task_done()

    def _refine(self, run_id: int) -> None:
        try:
            refine(self._workshop, run_id)
        except (AnalysisError, CaptureError) as error:
            log.warning("run %d keeps its immediate values: %s", run_id, error)


def refine(workshop: Workshop, run_id: int) -> None:
    """Fit the model to the capture of a finished run and store what it says beside the immediate values."""
    run = workshop.repository.run(run_id)
    if run.capture is None:
        return
    results = workshop.analysis.refined(workshop.captures / run.capture.path, run.capture.sha256)
    _store(workshop, run, results)


def _store(workshop: Workshop, run: RunRecord, results: Sequence[AxisResult]) -> None:
    """A value becomes the axis' reported one and is judged; a refusal of the run takes that place, too, and the run
    says so; a refusal that speaks of the fit alone stands beside the immediate value."""
    repository = workshop.repository
    measured_at = run.finished_at or workshop.wall_time()
    outcomes: list[AxisOutcome] = []
    changes: list[AlarmChange] = []
    for result in results:
        if stands(result) or not is_measurement(run):
            outcomes.append(beside(result))
            continue
        outcome, found = judge_result(repository, repository.axis(result.axis), result, measured_at)
        outcomes.append(outcome)
        changes += found
    withdrawal = _withdrawal(run, _shown(repository, run), outcomes)
    repository.add_outcomes(run.id, outcomes, withdrawal)
    if changes:
        repository.change_alarms(changes, workshop.wall_time())


def _shown(repository: Repository, run: RunRecord) -> dict[str, float]:
    """The declared model's values that the run shows as those of its axes, by axis [m]."""
    outcomes = [value.outcome for value in repository.outcomes(run.id)]
    return {
        one.result.axis: one.result.backlash
        for one in outcomes
        if one.reported
        and one.series == repository.axis(one.result.axis).series == DECLARED
        and one.result.backlash is not None
    }


def _withdrawal(
    run: RunRecord, shown: Mapping[str, float], outcomes: Sequence[AxisOutcome]
) -> Withdrawal | None:
    """How the run ends when values that it has shown are refused; None when none is."""
    refused = {
        one.result.axis: one.result for one in outcomes if one.reported and one.result.verdict == "refused"
    }
    gone = [axis for axis in shown if axis in refused]
    if not gone:
        return None
    said = [
        f"{axis}: the immediate value of {shown[axis] * 1e6:.1f} µm is withdrawn, since the fit of the whole model "
        f"refuses the run: {refused[axis].detail or refused[axis].reason}"
        for axis in gone
    ]
    detail = "; ".join([*([run.detail] if run.detail else []), *said])
    if len(gone) < len(shown):
        return Withdrawal("ok", None, detail)
    return Withdrawal("refused", str(refused[gone[0]].reason), detail)
