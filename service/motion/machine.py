"""The diagnostic steps on a real bus: connect, verify, enable, step, record, disable.

The buses are opened for a run and closed after it: between runs Flankwatch sends nothing, and a bus that was
down at night is tried afresh the next one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace

from drivers.accelerometer import Accelerometer, AccelerometerConfig
from drivers.bus import Bus, BusConfig
from drivers.busload import frame_bits
from drivers.buslog import blf
from drivers.drive import Drive, DriveConfig
from drivers.errors import DriverError
from drivers.trace import Frames, Recorder
from drivers.trace import Trace as BusTrace
from service.config import HEARTBEAT_PERIOD, AxisSettings, BusSettings, Settings
from service.motion.messages import Progress, Recorded, Steps
from service.motion.moving import Station, carry_out
from service.motion.plan import Plan, plan_map, plan_steps
from service.recording import AxisDescription, Move, Recording, Trace


@contextmanager
def open_machine(settings: Settings) -> Iterator[BusMachine]:
    """The machine of the configuration; nothing is opened before a run."""
    yield BusMachine(settings)


class BusMachine:
    """Executes diagnostic runs on the buses of a configuration."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._logs: list[Recorder] = []

    def execute(
        self,
        group: str,
        guard: Callable[[], None],
        on_progress: Callable[[Progress], None],
        steps: Steps | None = None,
    ) -> Recorded:
        """Make the steps of one group, the configured ones or others.

        ``guard`` is called while waiting and raises to stop the run.

        Raises
        ------
        DriverError : drive, sensor or bus failed; whatever was enabled is disabled again.
        NotPermitted : the axes have no room for the steps.
        """
        axes = [self._settings.axis_named(name) for name in self._settings.groups[group]]
        self._logs = []
        with ExitStack() as stack:
            buses = self._open_buses(stack, axes)
            self._logs = [stack.enter_context(bus.recording()) for bus in buses.values()]
            stations = self._connect(stack, buses, axes)
            plan = self._plan(axes, steps, {s.settings.name: s.position() for s in stations})
            recorders = {name: stack.enter_context(bus.recording()) for name, bus in buses.items()}
            moves = carry_out(stations, plan, guard, on_progress)
            _await_recorders(buses, recorders, moves[-1].end)
            frames = {name: recorder.frames() for name, recorder in recorders.items()}
            return self._decode(stations, plan, moves, frames)

    def _plan(
        self, axes: Sequence[AxisSettings], steps: Steps | None, positions: Mapping[str, float]
    ) -> Plan:
        """The configured steps at the group's places, or others where it stands."""
        configured = self._settings.excitation
        if steps is not None:
            changed = {"step_length_m": steps.length, "jerk_m_s3": steps.jerk}
            other = configured.model_copy(update=changed)
            if steps.places:
                return plan_map(axes, other, self._settings.travel, positions, steps.places, steps.direction)
            return plan_steps(axes, other, positions, steps.direction)
        if places := axes[0].diagnostic_positions_m:
            return plan_map(axes, configured, self._settings.travel, positions, places)
        return plan_steps(axes, configured, positions)

    def bus_log(self) -> bytes:
        """All frames of the last run as BLF, from the connection on, one channel per bus; of a failed run too."""
        return blf(self._logs) if any(len(log) for log in self._logs) else b""

    def _open_buses(self, stack: ExitStack, axes: Sequence[AxisSettings]) -> dict[str, Bus]:
        needed = {name for axis in axes for name in (axis.bus, axis.accelerometer.bus)}
        return {
            bus.name: stack.enter_context(Bus(_bus_config(bus)))
            for bus in self._settings.bus
            if bus.name in needed
        }

    def _connect(
        self, stack: ExitStack, buses: Mapping[str, Bus], axes: Sequence[AxisSettings]
    ) -> list[Station]:
        """Connect the group's drives, and the drive that produces SYNC on their bus, which need not move."""
        drives: dict[str, Drive] = {}

        def stop_all(_: Drive) -> None:
            for drive in drives.values():
                with suppress(DriverError):  # a drive that cannot be reached must not keep the others moving
                    drive.command_quick_stop()

        producers = [axis for axis in self._settings.axis if axis.bus == axes[0].bus and axis.sync_producer]
        for axis in [*axes, *(axis for axis in producers if axis not in axes)]:
            config = _drive_config(axis, self._bus_settings(axis.bus))
            drives[axis.name] = stack.enter_context(Drive(buses[axis.bus], config, stop_all))
        stations = []
        for axis in axes:
            sensor = Accelerometer(
                buses[axis.accelerometer.bus],
                _accelerometer_config(axis, self._bus_settings(axis.accelerometer.bus)),
            )
            stack.callback(sensor.close)
            sensor.wait_alive()
            stations.append(Station(axis, drives[axis.name], sensor))
        return stations

    def _bus_settings(self, name: str) -> BusSettings:
        return next(bus for bus in self._settings.bus if bus.name == name)

    def _decode(
        self, stations: Sequence[Station], plan: Plan, moves: Sequence[Move], frames: Mapping[str, Frames]
    ) -> Recorded:
        """Cut by the moves' times, never by the moment the recorders began; place samples and moves by counters."""
        received, over = moves[0].start - plan.rest, moves[-1].end + plan.rest
        frames = {bus: all_frames.between(received, over) for bus, all_frames in frames.items()}
        motors = [station.drive.traces(frames[station.settings.bus]) for station in stations]
        moves = [replace(move, start=motors[0].sampled(move.start)) for move in moves]
        start, end = moves[0].start - plan.rest, moves[-1].end + plan.rest
        traces: dict[tuple[str, str], Trace] = {}
        warnings: list[str] = []
        for station, motor in zip(stations, motors, strict=True):
            axis = station.settings
            warnings += station.drive.remarks()
            load = station.accelerometer.record(frames[axis.accelerometer.bus])
            warnings += load.warnings
            for channel, trace in (
                ("motor_speed", motor.speed),
                ("motor_torque", motor.torque),
                ("acceleration", load.acceleration),
            ):
                traces[axis.name, channel] = _cut(trace, start, end)
        recording = Recording(
            machine=self._settings.machine.name,
            axes=tuple(self._describe(station.settings) for station in stations),
            traces=traces,
            moves=tuple(replace(move, start=move.start - start) for move in moves),
            gantry=((plan.axes[0], plan.axes[1]),) if len(plan.axes) == 2 else (),
            note="; ".join(warnings) or None,
        )
        return Recorded(recording, tuple(warnings))

    def _describe(self, axis: AxisSettings) -> AxisDescription:
        drive_rate = 1e6 / self._bus_settings(axis.bus).sync_period_us
        return AxisDescription(
            name=axis.name,
            transmission=axis.transmission,
            pinion_diameter=axis.pinion_diameter_m,
            gear_ratio=axis.gear_ratio,
            rates={
                "motor_speed": drive_rate,
                "motor_torque": drive_rate,
                "acceleration": axis.accelerometer.nominal_rate_hz,
            },
        )


def _await_recorders(buses: Mapping[str, Bus], recorders: Mapping[str, Recorder], end: float) -> None:
    """Wait until every recorder is past the last move; the cut is by the move's time, not by now."""
    for name, bus in buses.items():
        bus.wait_until(lambda recorder=recorders[name]: recorder.latest > end, 2.0)  # type: ignore[misc]


def _cut(trace: BusTrace, start: float, end: float) -> Trace:
    inside = trace.between(start, end)
    return Trace(inside.time - start, inside.value)


def _bus_config(bus: BusSettings) -> BusConfig:
    return BusConfig(
        interface=bus.interface,
        channel=bus.channel,
        bitrate=bus.bitrate,
        machine_time=bus.interface == "virtual",
        heartbeat_period=HEARTBEAT_PERIOD,
    )


def _drive_config(axis: AxisSettings, bus: BusSettings) -> DriveConfig:
    low, high = sorted(limit / axis.transmission for limit in (axis.travel_min_m, axis.travel_max_m))
    return DriveConfig(
        name=axis.name,
        node_id=axis.node_id,
        direction=-1 if axis.invert else 1,
        counts_per_rev=axis.counts_per_rev,
        speed_lsb_rad_s=axis.speed_lsb_rad_s,
        acceleration_lsb_rad_s2=axis.acceleration_lsb_rad_s2,
        jerk_lsb_rad_s3=axis.jerk_lsb_rad_s3,
        software_limits=(low, high),
        quick_stop_deceleration=axis.acceleration_limit_m_s2 / axis.transmission,
        heartbeat_period=HEARTBEAT_PERIOD,
        sync_producer=axis.sync_producer,
        sync_period=bus.sync_period_us * 1e-6,
    )


def _accelerometer_config(axis: AxisSettings, bus: BusSettings) -> AccelerometerConfig:
    """The sensor; its delay is what the data sheet says, half a sample, and the frame's time on the wire."""
    sensor = axis.accelerometer
    return AccelerometerConfig(
        name=f"{axis.name}'s accelerometer",
        data_id=sensor.data_id,
        time_id=sensor.time_id,
        nominal_rate=sensor.nominal_rate_hz,
        direction=sensor.sign,
        delay=sensor.latency_us * 1e-6 + 0.5 / sensor.nominal_rate_hz + frame_bits(8) / bus.bitrate,
        dbc=sensor.dbc,
    )
