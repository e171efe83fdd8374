"""Settings of one machine: a TOML file, checked in one go, with the unit in every key.

Unknown keys are errors; environment variables ``FLANKWATCH_API__PORT`` and the like override the file.
"""

from service.config.checks import HEARTBEAT_PERIOD, check_excitation, check_room, frames_on
from service.config.sections import (
    AxisSettings,
    BusSettings,
    ExcitationSettings,
    TravelSettings,
)
from service.config.settings import ConfigError, Settings, load_settings

__all__ = [
    "HEARTBEAT_PERIOD",
    "AxisSettings",
    "BusSettings",
    "ConfigError",
    "ExcitationSettings",
    "Settings",
    "TravelSettings",
    "check_excitation",
    "check_room",
    "frames_on",
    "load_settings",
]
