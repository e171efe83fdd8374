"""A plan carried out by connected drives: travel, rest, step, rest; all axes of the group together.

A step is over before software could stop it. A travel lasts seconds: while it does, every drive of the group and
the client are watched, and whatever is amiss with one stops all at once, so that a bridge is not skewed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass

from drivers.accelerometer import Accelerometer
from drivers.bus import Bus
from drivers.drive import Drive, DriveMove, start_together
from drivers.errors import DriverError
from service.config import AxisSettings
from service.motion.messages import Progress
from service.motion.plan import Plan, PlannedStep, Travel
from service.recording import Move

PROFILE_MARGIN = 1.5
"""The drive's limits of a step over what the step reaches: a step that meets them is not the planned one."""

Guard = Callable[[], None]
"""Called while waiting; raises to stop the run."""

Tell = Callable[[Progress], None]


@dataclass(frozen=True)
class Station:
    """One axis of the group, connected."""

    settings: AxisSettings
    drive: Drive
    accelerometer: Accelerometer

    def position(self) -> float:
        """Where the axis stands [m]."""
        return self.drive.position() * self.settings.transmission


@dataclass(frozen=True)
class _Run:
    """What a run of a plan needs everywhere."""

    stations: Sequence[Station]
    plan: Plan
    guard: Guard
    tell: Tell

    @property
    def bus(self) -> Bus:
        return self.stations[0].drive.bus

    def note(self, done: int, text: str) -> None:
        self.tell(Progress(done, len(self.plan.steps), text))


def carry_out(stations: Sequence[Station], plan: Plan, guard: Guard, tell: Tell) -> list[Move]:
    """Enable, visit every place and step there, travel back, disable; the moves with their start on bus time [s]."""
    run = _Run(stations, plan, guard, tell)
    moves: list[Move] = []
    with ExitStack() as enabled:
        for station in stations:
            enabled.enter_context(station.drive.enabled())
        for number, visit in enumerate(plan.visits, 1):
            if visit.travel is not None:
                where = f"travel to {visit.travel.goal:.3f} m, place {number} of {len(plan.visits)}"
                run.note(len(moves), where)
                _travel(run, visit.travel, where)
            moves += _step(run, visit.steps, len(moves))
        if plan.way_back is not None:
            where = f"travel back to {plan.way_back.goal:.3f} m"
            run.note(len(moves), where)
            _travel(run, plan.way_back, where)
    return moves


def _step(run: _Run, steps: Sequence[PlannedStep], done: int) -> list[Move]:
    """Make the steps of one place, each after a rest, and rest after the last; ``done`` were made before."""
    moves = []
    standing_since = run.bus.time
    for index, step in enumerate(steps, done):
        run.note(index, f"step {index + 1} of {len(run.plan.steps)}")
        position = run.stations[0].position()
        _rest(run, standing_since)
        orders = [(s.drive, _step_of_drive(s.settings, run.plan, step)) for s in run.stations]
        started = start_together(orders)
        standing_since = max([station.drive.wait_standstill() for station in run.stations])
        for station in run.stations:
            station.accelerometer.check()
        moves.append(Move(started, step.direction, step.length, run.plan.jerk, run.plan.duration, position))
    run.note(done + len(steps), "the axis rests")
    _rest(run, standing_since)
    return moves


def _travel(run: _Run, travel: Travel, where: str) -> None:
    """Go a way with all axes; whatever happens to one on it, or a guard's word, stops all at once."""
    try:
        start_together([(s.drive, _way_of_drive(s.settings, travel)) for s in run.stations])
        for station in run.stations:
            station.drive.wait_standstill(lambda: _watch(run))
    except BaseException as error:
        for station in run.stations:
            with suppress(DriverError):  # a drive that cannot be reached must not keep the others moving
                station.drive.command_quick_stop()
        if isinstance(error, DriverError):
            names = " and ".join(station.settings.name for station in run.stations)
            error.what = (
                f"{where}: {error.what}; {names} stopped on the way and will not go back by themselves"
            )
        raise


def _watch(run: _Run) -> None:
    """Raise what is wrong with the client or with any drive of the group."""
    run.guard()
    for station in run.stations:
        station.drive.check_moving()


def _rest(run: _Run, standing_since: float) -> None:
    """Let the axis stand until it has rested since the bus time ``standing_since`` [s]."""
    until = standing_since + run.plan.rest

    def over() -> bool:
        run.guard()
        return run.bus.time >= until

    run.bus.wait_until(over, 10 * max(0.0, until - run.bus.time) + 1.0)


def _step_of_drive(axis: AxisSettings, plan: Plan, step: PlannedStep) -> DriveMove:
    ratio = axis.transmission
    return DriveMove(
        target=step.direction * step.length / ratio,
        speed=min(PROFILE_MARGIN * plan.v_max, axis.velocity_limit_m_s) / ratio,
        acceleration=min(PROFILE_MARGIN * plan.a_max, axis.acceleration_limit_m_s2) / ratio,
        jerk=plan.jerk / ratio,
        duration=plan.duration,
    )


def _way_of_drive(axis: AxisSettings, travel: Travel) -> DriveMove:
    """A travel as the drive makes it: here the limits are what is wanted, and both axes meet them alike."""
    ratio = axis.transmission
    return DriveMove(
        target=travel.distance / ratio,
        speed=travel.v_max / ratio,
        acceleration=travel.a_max / ratio,
        jerk=travel.jerk / ratio,
        duration=travel.duration,
    )
