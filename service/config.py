"""Settings of one machine: a TOML file, checked in one go, with the unit in every key.

Unknown keys are errors; environment variables ``FLANKWATCH_API__PORT`` and the like override the file.
What cannot work on the machine (a bus load above 70 %, a step longer than the axis, an excitation that
reaches the axis' limits) is refused here, before anything moves.
"""

from __future__ import annotations

import difflib
import tomllib
from datetime import time
from pathlib import Path
from typing import Annotated, Any, Literal, Self
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator
from pydantic_settings import BaseSettings, PydanticBaseSettingsSource, SettingsConfigDict

from drivers.busload import CyclicFrame, accelerometer_frames, drive_frames, require_bus_load
from drivers.errors import BusOverloaded
from service.dynamics.trajectory import jerk_limited_step

HEARTBEAT_PERIOD = 0.1
"""Of the master and of every drive [s]; chosen: a third of the 0.3 s after which a drive stops by itself."""

_NO_LIMIT = 1e6
"""Acceleration and speed that no axis reaches: the step is limited by its jerk alone."""

NodeId = Annotated[int, Field(ge=1, le=126)]
CanId = Annotated[int, Field(ge=1, le=0x7FF)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,31}$")]


class ConfigError(ValueError):
    """The configuration cannot be used; the message names file, key, what is wrong and what to do."""


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class MachineSettings(_Section):
    name: str = Field(min_length=1)
    timezone: str = "UTC"

    @field_validator("timezone")
    @classmethod
    def _known_zone(cls, value: str) -> str:
        try:
            ZoneInfo(value)
        except (ZoneInfoNotFoundError, ValueError) as error:
            raise ValueError(f"no time zone {value!r}; use an IANA name such as Europe/Berlin") from error
        return value


class StorageSettings(_Section):
    directory: Path = Path("var")

    @property
    def database(self) -> Path:
        return self.directory / "flankwatch.sqlite"

    @property
    def backups(self) -> Path:
        return self.directory / "backups"

    @property
    def captures(self) -> Path:
        return self.directory / "captures"


class ApiSettings(_Section):
    host: str = "127.0.0.1"
    port: int = Field(default=8470, ge=0, le=65535)
    token_sha256: str | None = Field(default=None, pattern=r"^[0-9a-f]{64}$")

    @model_validator(mode="after")
    def _token_beyond_loopback(self) -> Self:
        if self.host not in ("127.0.0.1", "::1", "localhost") and self.token_sha256 is None:
            raise ValueError(
                f"host {self.host} is reachable from the network, and anyone there could move the machine: "
                "set token_sha256 (printf %s TOKEN | sha256sum) or keep host = 127.0.0.1"
            )
        return self


class BusSettings(_Section):
    name: Name
    interface: Literal["socketcan", "virtual"] = "socketcan"
    channel: str
    bitrate: int = Field(default=1_000_000, ge=10_000, le=1_000_000)
    sync_period_us: Literal[1000, 2000] = 1000


class AccelerometerSettings(_Section):
    bus: Name
    data_id: CanId
    time_id: CanId
    nominal_rate_hz: float = Field(default=4000.0, ge=500.0, le=20_000.0)
    sign: Literal[1, -1] = 1
    latency_us: float = Field(default=0.0, ge=0.0, le=10_000.0)
    dbc: Path | None = None


class AxisSettings(_Section):
    name: Name
    bus: Name
    node_id: NodeId
    sync_producer: bool = False
    pinion_diameter_m: Positive
    gear_ratio: Positive
    travel_min_m: float
    travel_max_m: float
    velocity_limit_m_s: Positive
    acceleration_limit_m_s2: Positive
    invert: bool = False
    counts_per_rev: int = Field(default=65536, ge=1)
    speed_lsb_rad_s: Positive = 0.05 * 2 * 3.141592653589793 / 60
    acceleration_lsb_rad_s2: Positive = 0.1
    jerk_lsb_rad_s3: Positive = 1.0
    reference_um: Positive | None = None
    tolerance_um: Positive = 20.0
    accelerometer: AccelerometerSettings

    @property
    def transmission(self) -> float:
        """Output per radian of motor, D_p / (2 i) [m/rad]."""
        return self.pinion_diameter_m / (2 * self.gear_ratio)


class GantrySettings(_Section):
    name: Name
    axes: tuple[Name, Name]


class ExcitationSettings(_Section):
    """The diagnostic step, paper section III: SL, j_lim, ten steps, a rest before each."""

    step_length_m: Positive = 0.004
    jerk_m_s3: Positive = 200.0
    steps: int = Field(default=10, ge=4, le=40)
    rest_s: float = Field(default=0.35, ge=0.1, le=5.0)


class ScheduleSettings(_Section):
    nightly: bool = True
    at: time = time(2, 30)
    late_by_at_most_min: int = Field(default=180, ge=1, le=720)


class ModelSettings(_Section):
    """What is done with what the declared model lacks: is it looked for, and who accepts a model revision."""

    explain: bool = True
    policy: Literal["ask", "accept_when_clear"] = "ask"


class Settings(BaseSettings):
    """Everything that the service needs to know about its machine."""

    model_config = SettingsConfigDict(
        extra="forbid", frozen=True, env_prefix="FLANKWATCH_", env_nested_delimiter="__"
    )

    machine: MachineSettings
    storage: StorageSettings = StorageSettings()
    api: ApiSettings = ApiSettings()
    bus: tuple[BusSettings, ...] = Field(min_length=1)
    axis: tuple[AxisSettings, ...] = Field(min_length=1)
    gantry: tuple[GantrySettings, ...] = ()
    excitation: ExcitationSettings = ExcitationSettings()
    schedule: ScheduleSettings = ScheduleSettings()
    model: ModelSettings = ModelSettings()

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        return (env_settings, init_settings)

    @model_validator(mode="after")
    def _whole_machine(self) -> Self:
        _check_names(self)
        _check_buses(self)
        for axis in self.axis:
            check_excitation(axis, self.excitation)
        for bus in self.bus:
            _check_load(self, bus)
        return self

    def axis_named(self, name: str) -> AxisSettings:
        return next(axis for axis in self.axis if axis.name == name)

    @property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """What moves together, by group name: a gantry pair, or an axis on its own."""
        paired = {name for gantry in self.gantry for name in gantry.axes}
        groups: dict[str, tuple[str, ...]] = {gantry.name: gantry.axes for gantry in self.gantry}
        groups.update({axis.name: (axis.name,) for axis in self.axis if axis.name not in paired})
        return groups

    def group_of(self, name: str) -> str | None:
        """The group called ``name``, or the group that holds the axis called ``name``; None if neither."""
        if name in self.groups:
            return name
        return next((group for group, axes in self.groups.items() if name in axes), None)


def load_settings(path: Path) -> Settings:
    """Read and check a TOML file. Raises ConfigError that names file, key, fault and remedy."""
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: is not TOML: {error}") from error
    try:
        return Settings(**content)
    except ValidationError as error:
        lines = "\n".join(f"  {_describe(fault)}" for fault in error.errors())
        raise ConfigError(f"{path}: cannot be used:\n{lines}") from error


def _describe(fault: Any) -> str:
    where = ".".join(str(part) for part in fault["loc"]) or "machine"
    if fault["type"] == "extra_forbidden":
        near = difflib.get_close_matches(str(fault["loc"][-1]), _known_keys(), n=1)
        return f"{where}: unknown key" + (f"; is {near[0]} meant?" if near else "")
    return f"{where}: {fault['msg'].removeprefix('Value error, ')}"


def _known_keys() -> set[str]:
    sections = (
        Settings, MachineSettings, StorageSettings, ApiSettings, BusSettings, AccelerometerSettings,
        AxisSettings, GantrySettings, ExcitationSettings, ScheduleSettings, ModelSettings,
    )  # fmt: skip
    return {key for section in sections for key in section.model_fields}


def _check_names(settings: Settings) -> None:
    for kind, names in (
        ("bus", [bus.name for bus in settings.bus]),
        ("axis", [axis.name for axis in settings.axis]),
        ("group", [gantry.name for gantry in settings.gantry]),
    ):
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise ValueError(f"{kind} names must differ: {sorted(twice)} stand twice")
    known = {axis.name for axis in settings.axis}
    members = [name for gantry in settings.gantry for name in gantry.axes]
    for name in members:
        if name not in known:
            raise ValueError(f"gantry axis {name} is not declared as [[axis]]; declared: {sorted(known)}")
        if members.count(name) > 1:
            raise ValueError(f"axis {name} belongs to more than one gantry, or twice to one")
    if clash := known & {gantry.name for gantry in settings.gantry}:
        raise ValueError(f"a gantry must not be named like an axis: {sorted(clash)}")


def _check_buses(settings: Settings) -> None:
    for bus in settings.bus:
        axes = [axis for axis in settings.axis if axis.bus == bus.name]
        nodes = [axis.node_id for axis in axes]
        if len(set(nodes)) != len(nodes):
            raise ValueError(f"bus {bus.name}: two drives share a node id: {sorted(nodes)}")
        producers = [axis.name for axis in axes if axis.sync_producer]
        if axes and len(producers) != 1:
            raise ValueError(
                f"bus {bus.name}: exactly one drive must have sync_producer = true, found {producers}; its "
                "quartz times the samples of all"
            )
        _check_can_ids(settings, bus.name, nodes)
    names = {bus.name for bus in settings.bus}
    for axis in settings.axis:
        for user, name in ((axis.name, axis.bus), (f"{axis.name}'s accelerometer", axis.accelerometer.bus)):
            if name not in names:
                raise ValueError(
                    f"{user} is on bus {name!r}, which is not declared; declared: {sorted(names)}"
                )
    for gantry in settings.gantry:
        if len({settings.axis_named(name).bus for name in gantry.axes}) > 1:
            raise ValueError(f"gantry {gantry.name}: both drives must be on one bus, to share one SYNC")


def _check_can_ids(settings: Settings, bus: str, nodes: list[int]) -> None:
    reserved = {0x000, 0x080} | {
        base + node for node in nodes for base in (0x080, 0x180, 0x200, 0x580, 0x600, 0x700)
    }
    sensors = [axis.accelerometer for axis in settings.axis if axis.accelerometer.bus == bus]
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


def _check_load(settings: Settings, bus: BusSettings) -> None:
    try:
        require_bus_load(frames_on(settings, bus), bus.bitrate)
    except BusOverloaded as error:
        raise ValueError(
            f"bus {bus.name}: {error.what}: raise the bitrate, set sync_period_us = 2000, lower nominal_rate_hz, "
            "or give the accelerometers a bus of their own"
        ) from error


def frames_on(settings: Settings, bus: BusSettings) -> list[CyclicFrame]:
    """Every cyclic frame that the configuration puts on one bus."""
    frames = [CyclicFrame("master heartbeat", 1 / HEARTBEAT_PERIOD, 1)]
    for axis in settings.axis:
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
