"""The tables of a configuration file, with the unit in every key; each checks what it can check by itself."""

from __future__ import annotations

from datetime import time
from pathlib import Path
from typing import Annotated, Literal, Self
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

NodeId = Annotated[int, Field(ge=1, le=126)]
CanId = Annotated[int, Field(ge=1, le=0x7FF)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,31}$")]


class Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class MachineSettings(Section):
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


class StorageSettings(Section):
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


class ApiSettings(Section):
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


class BusSettings(Section):
    name: Name
    interface: Literal["socketcan", "virtual"] = "socketcan"
    channel: str
    bitrate: int = Field(default=1_000_000, ge=10_000, le=1_000_000)
    sync_period_us: Literal[1000, 2000] = 1000


class AccelerometerSettings(Section):
    bus: Name
    data_id: CanId
    time_id: CanId
    nominal_rate_hz: float = Field(default=4000.0, ge=500.0, le=20_000.0)
    sign: Literal[1, -1] = 1
    latency_us: float = Field(default=0.0, ge=0.0, le=10_000.0)
    dbc: Path | None = None


class AxisSettings(Section):
    """One axis, positions in the coordinates of the drive: travel, limits, and what it is measured against.

    ``diagnostic_positions_m`` are the middles of the steps; empty: the axis steps where it stands.
    ``moved_mass_kg`` serves to show stiffness and friction, which are found per kilogram; of a gantry its half.
    """

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
    moved_mass_kg: Positive | None = None
    diagnostic_positions_m: tuple[Finite, ...] = Field(default=(), max_length=50)
    accelerometer: AccelerometerSettings

    @property
    def transmission(self) -> float:
        """Output per radian of motor, D_p / (2 i) [m/rad]."""
        return self.pinion_diameter_m / (2 * self.gear_ratio)


class GantrySettings(Section):
    name: Name
    axes: tuple[Name, Name]


class ExcitationSettings(Section):
    """The diagnostic step, paper section III: SL, j_lim, ten steps, a rest before each."""

    step_length_m: Positive = 0.004
    jerk_m_s3: Positive = 200.0
    steps: int = Field(default=10, ge=4, le=40)
    rest_s: float = Field(default=0.35, ge=0.1, le=5.0)


class TravelSettings(Section):
    """How an axis travels between its diagnostic positions, jerk-limited; never faster than the axis may.

    Chosen: 0.25 m/s is what machine safety calls reduced speed (ISO 10218-1, IEC 60204-1); the rest is gentle.
    """

    velocity_m_s: Positive = 0.25
    acceleration_m_s2: Positive = 1.0
    jerk_m_s3: Positive = 20.0


class ScheduleSettings(Section):
    nightly: bool = True
    at: time = time(2, 30)
    late_by_at_most_min: int = Field(default=180, ge=1, le=720)


class ModelSettings(Section):
    """What is done with what the declared model lacks: is it looked for, and who accepts a model revision."""

    explain: bool = True
    policy: Literal["ask", "accept_when_clear"] = "ask"
