"""Composition root: builds the whole service from its settings; importing it builds nothing.

    with house(settings) as flankwatch:
        flankwatch.box.request("X1")

The parts are opened in the order in which they need one another and closed in reverse: store, analysis
process, motion process, refinement, box of runs, scheduler.
"""

from __future__ import annotations

import importlib.metadata
import logging
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial

from fastapi import FastAPI

from service.api.ports import Masses, WebSettings
from service.api.web import create_web_app
from service.backlash.figure import step_picture
from service.captures import CaptureError, read_capture
from service.captures.report import read_predictions
from service.config import Settings
from service.motion.client import MotionClient
from service.motion.machine import open_machine
from service.motion.process import MachineOpener
from service.recording import Recording
from service.report.page import report_page
from service.runs.analysis import Analysis
from service.runs.box import Box
from service.runs.diagnostic_run import Workshop
from service.runs.pairs import NothingToExplain, known_capture
from service.runs.refinement import Refinement
from service.runs.scheduler import Scheduler
from service.runs.workbench import Workbench
from service.store.database import open_database
from service.store.model_records import ExplanationRecord
from service.store.records import AxisRecord, RunRecord
from service.store.repository import Repository

log = logging.getLogger(__name__)

ROOM_NEEDED = 200 * 2**20
"""Free space below which no run is begun [bytes]; chosen: a year of captures of one gantry."""


@dataclass(frozen=True)
class House:
    """The running service."""

    settings: Settings
    repository: Repository
    box: Box
    workshop: Workshop
    refinement: Refinement
    workbench: Workbench

    def missing(self) -> Sequence[str]:
        """What keeps the service from measuring, in sentences; empty when nothing does."""
        free = shutil.disk_usage(self.settings.storage.directory).free
        if free < ROOM_NEEDED:
            return (f"only {free / 2**20:.0f} MiB are free under {self.settings.storage.directory}",)
        return ()

    def web(self) -> FastAPI:
        """The REST API and the technician's page."""
        web = WebSettings(
            version=importlib.metadata.version("flankwatch"),
            captures_folder=self.settings.storage.captures,
            token_sha256=self.settings.api.token_sha256,
            diagnostic_positions={
                axis.name: axis.diagnostic_positions_m
                for axis in self.settings.axis
                if axis.diagnostic_positions_m
            },
            moved_masses=_masses(self.settings),
        )
        picture = partial(draw_step, self.workshop)
        return create_web_app(
            self.repository,
            self.box,
            self.workbench,
            web,
            picture=picture,
            report=partial(report_on, self.workshop),
            missing=self.missing,
        )


@contextmanager
def house(
    settings: Settings,
    machine: MachineOpener = open_machine,
    *,
    refine: bool = True,
    analysis: Callable[[], Analysis] = Analysis,
) -> Iterator[House]:
    """Open the whole service; ``machine`` opens what is behind the buses, another one in the demo.

    Without ``refine`` the immediate values stand: for who does not stay long enough to wait for better ones.
    ``analysis`` builds the numerics, others in tests.

    Raises
    ------
    StoreError : the store is damaged, in use, or gone; nothing was started.
    """
    settings.storage.captures.mkdir(parents=True, exist_ok=True)
    database = open_database(settings.storage.database)
    try:
        repository = Repository(database)
        repository.declare_axes(_axis_records(settings))
        for run_id in repository.fail_interrupted(_now()):
            log.warning("run %d was interrupted by the end of the service before", run_id)
        repository.models.give_up_unfinished(_now())
        with analysis() as numerics, MotionClient(settings, machine) as motion:
            workshop = Workshop(motion, numerics, repository, settings.storage.captures, _now)
            refinement = Refinement(workshop, then=lambda run_id: workbench.submit(run_id))
            workbench = Workbench(
                workshop,
                is_busy=lambda: refinement.is_busy() or repository.unfinished_run() is not None,
                explain=settings.model.explain,
                policy=settings.model.policy,
            )
            box = Box(
                settings,
                workshop,
                abort=motion.abort,
                refine=refinement.submit if refine else _leave,
                explain=workbench.submit if refine else _leave,
            )
            with workbench, refinement, box, Scheduler(settings, workshop, box):
                yield House(settings, repository, box, workshop, refinement, workbench)
    finally:
        database.close()


def _leave(run_id: int) -> None:
    """Leave a finished run as it is."""


def draw_step(workshop: Workshop, run: RunRecord, axis: str, step: int) -> str | None:
    """Picture of one step of a stored run as SVG, with t1 and t2 of the reported method where it has steps.

    None where the capture or the step is not there.
    """
    if run.capture is None:
        return None
    outcomes = sorted(
        (value.outcome for value in workshop.repository.outcomes(run.id)), key=lambda one: not one.reported
    )
    results = (outcome.result for outcome in outcomes)
    result = next((r for r in results if r.axis == axis and step < len(r.steps)), None)
    if result is None:
        return None
    try:
        recording = read_capture(workshop.captures / run.capture.path, run.capture.sha256)
    except CaptureError:
        log.exception("run %d: its capture cannot be drawn", run.id)
        return None
    return step_picture(recording, axis, step, result)


def report_on(workshop: Workshop, explanation: ExplanationRecord) -> str | None:
    """The page about an explanation; None while it has no finding. Without its files it has no pictures."""
    if explanation.found is None:
        return None
    run = workshop.repository.run(explanation.run_id)
    trains = ", ".join(f"run {number}" for number in explanation.train_run_ids)
    about = [
        f"Judged on run {run.id} of {run.group}, {run.finished_at:%Y-%m-%d %H:%M} UTC; fitted to {trains}."
    ]
    try:
        recording = known_capture(workshop.captures, run).read()
        predictions = read_predictions(workshop.captures / (explanation.predictions_path or "none"))
    except (CaptureError, NothingToExplain, OSError) as error:
        about.append(f"Without pictures: {error}")
        recording, predictions = Recording(machine="", axes=(), traces={}), {}
    return report_page(f"Model check of run {run.id}", about, explanation.found, predictions, recording)


def _masses(settings: Settings) -> dict[str, Masses]:
    return {
        axis: Masses(settings.axis_named(axis).moved_mass_kg, settings.axis_named(axes[0]).moved_mass_kg)
        for axes in settings.groups.values()
        for axis in axes
    }


def _axis_records(settings: Settings) -> list[AxisRecord]:
    return [
        AxisRecord(
            name=axis.name,
            group=settings.group_of(axis.name) or axis.name,
            reference=None if axis.reference_um is None else axis.reference_um / 1e6,
            tolerance=axis.tolerance_um / 1e6,
        )
        for axis in settings.axis
    ]


def _now() -> datetime:
    return datetime.now(UTC)
