"""What no table of a configuration can check alone: names, buses and identifiers, the step, the bus load.

What cannot work on the machine is refused here, before anything moves. Each check raises ValueError, which says
what is wrong and what to do.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol

from drivers.busload import CyclicFrame, accelerometer_frames, drive_frames, require_bus_load
from drivers.errors import BusOverloaded
from service.config.sections import AxisSettings, BusSettings, ExcitationSettings, GantrySettings
from service.dynamics.trajectory import jerk_limited_step

HEARTBEAT_PERIOD = 0.1
"""Of the master and of every drive [s]; chosen: a third of the 0.3 s after which a drive stops by itself."""

_NO_LIMIT = 1e6
"""Acceleration and speed that no axis reaches: the step is limited by its jerk alone."""


class Declared(Protocol):
    """A machine as the configuration declares it."""

    @property
    def bus(self) -> Sequence[BusSettings]: ...

    @property
    def axis(self) -> Sequence[AxisSettings]: ...

    @property
    def gantry(self) -> Sequence[GantrySettings]: ...

    @property
    def excitation(self) -> ExcitationSettings: ...


def check_names(machine: Declared) -> None:
    """Names that are told apart, and gantries of declared axes."""
    for kind, names in (
        ("bus", [bus.name for bus in machine.bus]),
        ("axis", [axis.name for axis in machine.axis]),
        ("group", [gantry.name for gantry in machine.gantry]),
    ):
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise ValueError(f"{kind} names must differ: {sorted(twice)} stand twice")
    known = {axis.name for axis in machine.axis}
    members = [name for gantry in machine.gantry for name in gantry.axes]
    for name in members:
        if name not in known:
            raise ValueError(f"gantry axis {name} is not declared as [[axis]]; declared: {sorted(known)}")
        if members.count(name) > 1:
            raise ValueError(f"axis {name} belongs to more than one gantry, or twice to one")
    if clash := known & {gantry.name for gantry in machine.gantry}:
        raise ValueError(f"a gantry must not be named like an axis: {sorted(clash)}")


def check_buses(machine: Declared) -> None:
    """Buses that are declared, with one SYNC producer each, and identifiers that do not clash."""
    for bus in machine.bus:
        axes = [axis for axis in machine.axis if axis.bus == bus.name]
        nodes = [axis.node_id for axis in axes]
        if len(set(nodes)) != len(nodes):
            raise ValueError(f"bus {bus.name}: two drives share a node id: {sorted(nodes)}")
        producers = [axis.name for axis in axes if axis.sync_producer]
        if axes and len(producers) != 1:
            raise ValueError(
                f"bus {bus.name}: exactly one drive must have sync_producer = true, found {producers}; its "
                "quartz times the samples of all"
            )
        _check_can_ids(machine, bus.name, nodes)
    names = {bus.name for bus in machine.bus}
    for axis in machine.axis:
        for user, name in ((axis.name, axis.bus), (f"{axis.name}'s accelerometer", axis.accelerometer.bus)):
            if name not in names:
                raise ValueError(
                    f"{user} is on bus {name!r}, which is not declared; declared: {sorted(names)}"
                )
    for gantry in machine.gantry:
        if len({_axis(machine, name).bus for name in gantry.axes}) > 1:
            raise ValueError(f"gantry {gantry.name}: both drives must be on one bus, to share one SYNC")


def _check_can_ids(machine: Declared, bus: str, nodes: list[int]) -> None:
    reserved = {0x000, 0x080} | {
        base + node for node in nodes for base in (0x080, 0x180, 0x200, 0x580, 0x600, 0x700)
    }
    sensors = [axis.accelerometer for axis in machine.axis if axis.accelerometer.bus == bus]
    ids = [number for sensor in sensors for number in (sensor.data_id, sensor.time_id)]
    for number in ids:
        if number in reserved or ids.count(number) > 1:
            raise ValueError(f"bus {bus}: CAN id 0x{number:03X} of an accelerometer is taken already")


def check_excitation(axis: AxisSettings, excitation: ExcitationSettings) -> None:
    """Raise ValueError, saying what is exceeded, when a step is more than the axis may do."""
    travel = axis.travel_max_m - axis.travel_min_m
    if excitation.step_length_m > travel:
        raise ValueError(
            f"axis {axis.name}: the step of {excitation.step_length_m * 1e3:g} mm is longer than its travel of "
            f"{travel * 1e3:g} mm; shorten step_length_m or correct travel_min_m and travel_max_m"
        )
    step = jerk_limited_step(excitation.step_length_m, excitation.jerk_m_s3, _NO_LIMIT, _NO_LIMIT)
    for what, reached, limit, unit in (
        ("v_max", step.v_max, axis.velocity_limit_m_s, "m/s"),
        ("a_max", step.a_max, axis.acceleration_limit_m_s2, "m/s²"),
    ):
        if reached >= limit:
            raise ValueError(
                f"axis {axis.name}: the step reaches {what} = {reached:.3g} {unit}, the axis' limit is "
                f"{limit:.3g}; the acceleration would not change its sign at one clear time: shorten the step "
                "or lower jerk_m_s3"
            )


def check_places(machine: Declared) -> None:
    """Diagnostic positions with room for their steps, and the same ones for both sides of a bridge."""
    for axis in machine.axis:
        check_room(axis, axis.diagnostic_positions_m, machine.excitation.step_length_m)
    for gantry in machine.gantry:
        first, second = (_axis(machine, name).diagnostic_positions_m for name in gantry.axes)
        if first != second:
            raise ValueError(
                f"gantry {gantry.name}: its axes move one bridge, but {gantry.axes[0]} has diagnostic_positions_m = "
                f"{list(first)} and {gantry.axes[1]} has {list(second)}; give both the same"
            )


def check_room(axis: AxisSettings, places: Sequence[float], length: float) -> None:
    """Raise ValueError unless every place has room for steps of this length [m] around it, and is one of its own."""
    low, high = axis.travel_min_m + length / 2, axis.travel_max_m - length / 2
    for place in places:
        if not low <= place <= high:
            raise ValueError(
                f"axis {axis.name}: diagnostic position {place:g} m leaves no room for a step around it; within its "
                f"travel and half a step's length from its ends are {low:g} to {high:g} m"
            )
    if any(b - a <= length for a, b in pairwise(sorted(places))):
        raise ValueError(
            f"axis {axis.name}: two diagnostic positions are nearer than a step's length of {1e3 * length:g} mm, "
            "which is one place; leave one of them out"
        )


def _axis(machine: Declared, name: str) -> AxisSettings:
    return next(axis for axis in machine.axis if axis.name == name)


def check_load(machine: Declared, bus: BusSettings) -> None:
    """A bus that carries its cyclic frames."""
    try:
        require_bus_load(frames_on(machine, bus), bus.bitrate)
    except BusOverloaded as error:
        raise ValueError(
            f"bus {bus.name}: {error.what}: raise the bitrate, set sync_period_us = 2000, lower nominal_rate_hz, "
            "or give the accelerometers a bus of their own"
        ) from error


def frames_on(machine: Declared, bus: BusSettings) -> list[CyclicFrame]:
    """Every cyclic frame that the configuration puts on one bus."""
    frames = [CyclicFrame("master heartbeat", 1 / HEARTBEAT_PERIOD, 1)]
    for axis in machine.axis:
        if axis.bus == bus.name:
            frames += drive_frames(
                axis.name,
                sync_period=bus.sync_period_us * 1e-6,
                sync_producer=axis.sync_producer,
                heartbeat_period=HEARTBEAT_PERIOD,
            )
        if axis.accelerometer.bus == bus.name:
            frames += accelerometer_frames(axis.name, sample_rate=axis.accelerometer.nominal_rate_hz)
    return frames
