"""Settings of one machine, checked in one go: the whole file, or every fault in it by its key and its remedy."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Any, Self

from pydantic import Field, ValidationError, model_validator
from pydantic_settings import BaseSettings, PydanticBaseSettingsSource, SettingsConfigDict

from service.config import checks
from service.config.sections import (
    AccelerometerSettings,
    ApiSettings,
    AxisSettings,
    BusSettings,
    ExcitationSettings,
    GantrySettings,
    MachineSettings,
    ModelSettings,
    ScheduleSettings,
    StorageSettings,
    TravelSettings,
)


class ConfigError(ValueError):
    """The configuration cannot be used; the message names file, key, what is wrong and what to do."""


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
    travel: TravelSettings = TravelSettings()
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
        checks.check_names(self)
        checks.check_buses(self)
        for axis in self.axis:
            checks.check_excitation(axis, self.excitation)
        checks.check_places(self)
        for bus in self.bus:
            checks.check_load(self, bus)
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
        AxisSettings, GantrySettings, ExcitationSettings, TravelSettings, ScheduleSettings, ModelSettings,
    )  # fmt: skip
    return {key for section in sections for key in section.model_fields}
