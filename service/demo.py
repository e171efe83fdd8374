"""The simulated machine for people to try and for tests: a gantry and a single axis on virtual CAN buses.

The drives, the sensors and the mechanics are simulated on the other side of the wire; the drivers, the run,
the store and the API are the product's own. ``TRUTH`` is what the mechanics really have.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.sim.accelerometer_node import AccelerometerConfig, AccelerometerFaults
from drivers.sim.drive_config import DriveConfig, DriveFaults
from drivers.sim.machine import SimulatedMachine
from service.backlash.results import AxisResult
from service.config import AxisSettings, Settings
from service.dynamics.assembly import Effects, Setpoint
from service.dynamics.effects.effect import Measured
from service.dynamics.parameters import AxisParameters, Friction, GantryParameters, Machine
from service.dynamics.simulation import Plant
from service.motion.machine import BusMachine
from service.store.records import RunRecord

if TYPE_CHECKING:
    from service.app import House

TRUTH: Mapping[str, float] = {"X1": 62e-6, "X2": 48e-6, "Y": 85e-6}
"""Backlash of the simulated axes [m]."""

MACHINE = Machine(
    axes={
        "X1": AxisParameters(b=TRUTH["X1"], M=330.0, UL=20e-6),
        "X2": AxisParameters(b=TRUTH["X2"], M=300.0, UL=35e-6, friction_mas=Friction(150.0, 380.0)),
        "Y": AxisParameters(b=TRUTH["Y"], M=240.0, friction_mas=Friction(90.0, 220.0)),
    },
    gantries=(GantryParameters("X1", "X2", k=1.5e7, d=2.0e4),),
)
"""A laser cutter: bridge on two racks, cutting head on a third; chosen, plausible, of no real make."""


SEED = 1
"""Of noise, jitter and losses; any other does as well."""

FRAME_LOSS = 0.0005
"""Share of the accelerometers' frames that are lost on the way."""


BRAKE_S = 0.04
"""How long the motors' holding brakes take to close, as data sheets of servo motors of that size say."""

SENSOR_LATENCY_US = 200.0
"""Filter and processing of the simulated accelerometers, as their data sheet would say."""


@contextmanager
def open_demo(
    settings: Settings,
    *,
    paced: bool = False,
    seed: int = SEED,
    machine: Machine = MACHINE,
    effects: Effects | None = None,
    from_run: int = 1,
    drive_faults: Mapping[str, DriveFaults] | None = None,
    sensor_faults: Mapping[str, AccelerometerFaults] | None = None,
) -> Iterator[BusMachine]:
    """Switch the simulated machine on, beside the drivers that talk to it, in the motion process.

    Parameters
    ----------
    paced : machine time passes as wall time, for a person who watches
    effects : by axis, what the mechanics have and the paper's model lacks, from the ``from_run``-th run on
    drive_faults, sensor_faults : by axis, what is wrong with a drive or an accelerometer
    """
    ordinary = AccelerometerFaults(loss=FRAME_LOSS)
    drives = [
        _drive(axis, settings, (drive_faults or {}).get(axis.name, DriveFaults())) for axis in settings.axis
    ]
    sensors = [
        _accelerometer(axis, settings, (sensor_faults or {}).get(axis.name, ordinary))
        for axis in settings.axis
    ]
    channels = [bus.channel for bus in settings.bus]
    plant = ChangingPlant(machine, effects or {}, from_run)
    with SimulatedMachine(channels, drives, sensors, plant, seed=seed, paced=paced):
        yield BusMachine(settings)


class ChangingPlant:
    """A plant that gains its effects when its drives are enabled for the n-th time: a machine that changes."""

    def __init__(self, machine: Machine, effects: Effects, from_run: int) -> None:
        self._plant = Plant(machine)
        self.axes, self.dt = self._plant.axes, self._plant.dt
        self._effects, self._from_run = effects, from_run
        self._runs, self._enabled = 0, False

    def advance(self, duration: float, setpoints: Sequence[Setpoint]) -> list[Measured]:
        """Move on by ``duration`` [s] under one set-point per axis."""
        enabled = any(setpoint.enabled for setpoint in setpoints)
        if enabled and not self._enabled:
            self._runs += 1
            if self._runs == self._from_run and self._effects:
                self._plant.switch_effects(self._effects)
        self._enabled = enabled
        return self._plant.advance(duration, setpoints)


@dataclass(frozen=True)
class ComparedAxis:
    """An axis' result beside its simulated ``truth`` [m]; ``error`` [m] is None when it was refused."""

    result: AxisResult
    truth: float

    @property
    def error(self) -> float | None:
        """Estimated less true backlash [m]."""
        return None if self.result.backlash is None else self.result.backlash - self.truth


@dataclass(frozen=True)
class Comparison:
    """What the demo's runs found, axis by axis, and the runs that gave nothing."""

    axes: tuple[ComparedAxis, ...]
    failed: tuple[RunRecord, ...]

    def as_json(self) -> dict[str, Any]:
        """One JSON object, SI units."""
        return {
            "axes": [_compared_json(axis) for axis in self.axes],
            "failed": [
                {"group": run.group, "reason": run.reason, "detail": run.detail} for run in self.failed
            ],
        }


def compare(house: House, runs: Sequence[RunRecord]) -> Comparison:
    """Set what the store holds of the runs beside the simulated truth."""
    found = [value.outcome for run in runs for value in house.repository.outcomes(run.id)]
    axes = tuple(
        ComparedAxis(outcome.result, TRUTH[outcome.result.axis]) for outcome in found if outcome.reported
    )
    return Comparison(axes, tuple(run for run in runs if run.state == "failed"))


def _compared_json(axis: ComparedAxis) -> dict[str, Any]:
    result = axis.result
    return {
        "axis": result.axis,
        "verdict": result.verdict,
        "reason": None if result.reason is None else result.reason.value,
        "backlash_m": result.backlash,
        "interval_95_m": None if result.interval_95 is None else list(result.interval_95),
        "method": result.method,
        "true_backlash_m": axis.truth,
        "error_m": axis.error,
        "relative_error": None if axis.error is None else axis.error / axis.truth,
    }


PLACES: Mapping[str, tuple[float, ...]] = {"Y": (-0.1, 0.1)}
"""Where the demo steps along the rack [m], for those who want to see a map."""


def demo_settings(
    directory: Path, port: int = 8470, places: Mapping[str, tuple[float, ...]] | None = None
) -> Settings:
    """Configuration of the simulated machine; its data lie under ``directory``, its API on loopback.

    ``places`` are diagnostic positions by axis [m]; without them every axis steps where it stands.
    """
    axes = [_axis("X1", 1, sync_producer=True), _axis("X2", 2), _axis("Y", 3)]
    for axis in axes:
        axis["diagnostic_positions_m"] = (places or {}).get(str(axis["name"]), ())
    return Settings.model_validate(
        {
            "machine": {"name": "simulated laser cutter", "timezone": "UTC"},
            "storage": {"directory": directory},
            "api": {"port": port},
            "bus": [
                {"name": "drives", "interface": "virtual", "channel": "flankwatch-drives"},
                {"name": "sensors", "interface": "virtual", "channel": "flankwatch-sensors"},
            ],
            "axis": axes,
            "gantry": [{"name": "X", "axes": ["X1", "X2"]}],
            "schedule": {"nightly": False},
        }
    )


def _axis(name: str, node_id: int, sync_producer: bool = False) -> dict[str, object]:
    parameters = MACHINE.axes[name]
    return {
        "name": name,
        "bus": "drives",
        "node_id": node_id,
        "sync_producer": sync_producer,
        "pinion_diameter_m": parameters.D_p,
        "gear_ratio": parameters.i,
        "travel_min_m": -0.5,
        "travel_max_m": 0.5,
        "velocity_limit_m_s": 1.5,
        "acceleration_limit_m_s2": 10.0,
        "reference_um": round(TRUTH[name] * 1e6),
        "tolerance_um": 20.0,
        "moved_mass_kg": parameters.M,
        "accelerometer": {
            "bus": "sensors",
            "data_id": 0x300 + node_id,
            "time_id": 0x310 + node_id,
            "latency_us": SENSOR_LATENCY_US,
        },
    }


def _drive(axis: AxisSettings, settings: Settings, faults: DriveFaults) -> DriveConfig:
    return DriveConfig(
        axis=axis.name,
        node_id=axis.node_id,
        bus=_channel(settings, axis.bus),
        brake_s=BRAKE_S,
        faults=faults,
    )


def _accelerometer(
    axis: AxisSettings, settings: Settings, faults: AccelerometerFaults
) -> AccelerometerConfig:
    sensor = axis.accelerometer
    return AccelerometerConfig(
        axis=axis.name,
        bus=_channel(settings, sensor.bus),
        data_id=sensor.data_id,
        time_id=sensor.time_id,
        faults=faults,
    )


def _channel(settings: Settings, bus: str) -> str:
    return next(entry.channel for entry in settings.bus if entry.name == bus)
