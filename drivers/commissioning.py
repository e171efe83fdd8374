"""What is written into a drive before anything moves; every object is read back.

The order follows CiA 301: a PDO is switched off while its mapping changes; the SYNC counter can only be set
while no SYNC is produced. The drive is pre-operational meanwhile.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Literal

from drivers.errors import (
    JerkProfileRefused,
    MappingRefused,
    ObjectRefused,
    ProtectionNotConfirmed,
    WrongDevice,
)
from drivers.objects import Objects

SYNC_ID = 0x80
SYNC_OVERFLOW = 240
TPDO_MAPPING = (0x606C_0020, 0x6077_0010, 0x6041_0010)
RPDO_MAPPING = (0x6040_0010, 0x607A_0020)

_PROFILE_POSITION = 1
_JERK_LIMITED = 2
_CIA_402 = 402
_PDO_OFF = 1 << 31
_NO_RTR = 1 << 30
_PRODUCES_SYNC = 1 << 30
_EVERY_SYNC = 1
_AT_ONCE = 255


@dataclass(frozen=True)
class DriveConfig:
    """One drive: its address, its units, its protections.

    Attributes
    ----------
    direction : +1 where the drive's positive counts are the axis' positive travel, else -1
    counts_per_rev : increments of 0x6064 and 0x607A per motor revolution
    speed_lsb_rad_s : [rad/s] per count of 0x606C and 0x6081; default 0.05 rpm
    acceleration_lsb_rad_s2 : [rad/s²] per count of 0x6083 to 0x6085
    jerk_lsb_rad_s3 : [rad/s³] per count of 0x60A4
    software_limits : 0x607D [rad at the motor], None leaves the drive's own
    quick_stop_deceleration : 0x6085 [rad/s²]
    quick_stop_option : 0x605A; 2 = decelerate by 0x6085, then switch on disabled
    abort_option : 0x6007, reaction to a lost master; 3 = quick stop
    heartbeat_period : of the drive, 0x1017 [s]
    heartbeat_patience : the drive counts as silent without one for so long [s]
    master_node_id, master_timeout : whose heartbeat the drive watches, and how long it waits [s], 0x1016
    sync_producer : exactly one drive of a bus is
    sync_period : 0x1006 [s]
    vendor_id, product_code : compared with 0x1018 where given
    standstill_speed : below it the axis is at rest [rad/s]
    standstill_time : for so long [s]
    eds : object dictionary of the drive, None for the generic one
    """

    name: str
    node_id: int
    direction: Literal[1, -1] = 1
    counts_per_rev: float = 65536.0
    speed_lsb_rad_s: float = 0.05 * 2 * pi / 60
    acceleration_lsb_rad_s2: float = 0.1
    jerk_lsb_rad_s3: float = 1.0
    software_limits: tuple[float, float] | None = None
    quick_stop_deceleration: float = 3000.0
    quick_stop_option: int = 2
    abort_option: int = 3
    heartbeat_period: float = 0.1
    heartbeat_patience: float = 0.5
    master_node_id: int = 127
    master_timeout: float = 0.3
    sync_producer: bool = True
    sync_period: float = 0.001
    vendor_id: int | None = None
    product_code: int | None = None
    standstill_speed: float = 0.2
    standstill_time: float = 0.02
    eds: Path | None = None

    @property
    def position_lsb_rad(self) -> float:
        """Motor angle per count [rad], signed by the direction."""
        return self.direction * 2 * pi / self.counts_per_rev


@dataclass(frozen=True)
class DriveMove:
    """A jerk-limited profile position move, at the motor shaft.

    Attributes
    ----------
    target : way to go (relative) or position to go to (absolute) [rad]
    speed, acceleration : limits [rad/s], [rad/s²]; the excitation of the method must not reach them
    jerk : j_lim [rad/s³]
    duration : nominal duration [s]; the move is not taken for finished before
    timeout : added to it before the move counts as stuck [s]
    """

    target: float
    speed: float
    acceleration: float
    jerk: float
    duration: float
    relative: bool = True
    timeout: float = 3.0


def identify(objects: Objects, config: DriveConfig) -> None:
    """Raise WrongDevice unless the node is the configured CiA 402 drive and has profile position mode."""
    device_type = objects.read(0x1000)
    if device_type & 0xFFFF != _CIA_402:
        raise WrongDevice(f"{objects.name}: device type 0x{device_type:08X} is no CiA 402 drive")
    for sub, wanted, label in ((1, config.vendor_id, "vendor"), (2, config.product_code, "product")):
        if wanted is not None and (found := objects.read(0x1018, sub)) != wanted:
            raise WrongDevice(f"{objects.name}: {label} 0x{found:08X}, configured 0x{wanted:08X}")
    if not objects.read(0x6502) & (1 << (_PROFILE_POSITION - 1)):
        raise WrongDevice(f"{objects.name}: 0x6502 lacks profile position mode")


def set_protections(objects: Objects, config: DriveConfig) -> None:
    """Its own reaction to a lost master, and its limits; ProtectionNotConfirmed unless all read back."""
    refused = ProtectionNotConfirmed
    consumer = (config.master_node_id << 16) | _milliseconds(config.master_timeout)
    deceleration = round(config.quick_stop_deceleration / config.acceleration_lsb_rad_s2)
    objects.confirm(0x1017, 0, _milliseconds(config.heartbeat_period), refused)
    objects.confirm(0x1016, 1, consumer, refused)
    objects.confirm(0x6007, 0, config.abort_option, refused)
    objects.confirm(0x605A, 0, config.quick_stop_option, refused)
    objects.confirm(0x6085, 0, deceleration, refused)
    if config.software_limits is not None:
        low, high = sorted(round(limit / config.position_lsb_rad) for limit in config.software_limits)
        objects.confirm(0x607D, 1, low, refused)
        objects.confirm(0x607D, 2, high, refused)


def set_sync(objects: Objects, config: DriveConfig) -> None:
    """Make the drive the producer of SYNC with counter, or a consumer of it."""
    objects.confirm(0x1005, 0, SYNC_ID)
    objects.confirm(0x1006, 0, 0)
    objects.confirm(0x1019, 0, SYNC_OVERFLOW, MappingRefused)
    if config.sync_producer:
        objects.confirm(0x1006, 0, round(config.sync_period * 1e6), MappingRefused)
        objects.confirm(0x1005, 0, SYNC_ID | _PRODUCES_SYNC, MappingRefused)


def release(objects: Objects) -> None:
    """Leave the drive to its usual master: no SYNC, no watch over ours, the profile's objects as they were.

    A drive that went on watching our heartbeat would stand in a fault the next morning.
    """
    objects.confirm(0x1005, 0, SYNC_ID)
    objects.confirm(0x1016, 1, 0)
    objects.restore()


def map_process_data(objects: Objects, config: DriveConfig) -> None:
    """TPDO1 = speed, torque, statusword at every SYNC; RPDO1 = controlword and target at once."""
    _map(objects, 0x1800, 0x1A00, _NO_RTR | (0x180 + config.node_id), _EVERY_SYNC, TPDO_MAPPING)
    _map(objects, 0x1400, 0x1600, 0x200 + config.node_id, _AT_ONCE, RPDO_MAPPING)


def _map(
    objects: Objects, parameters: int, mapping: int, cob_id: int, transmission: int, entries: tuple[int, ...]
) -> None:
    objects.write(parameters, 1, cob_id | _PDO_OFF, MappingRefused)
    objects.write(mapping, 0, 0, MappingRefused)
    for sub, entry in enumerate(entries, 1):
        objects.confirm(mapping, sub, entry, MappingRefused)
    objects.confirm(mapping, 0, len(entries), MappingRefused)
    objects.confirm(parameters, 2, transmission, MappingRefused)
    objects.confirm(parameters, 1, cob_id, MappingRefused)


def set_jerk_limited_position_mode(objects: Objects) -> None:
    """Profile position with the jerk-limited profile; JerkProfileRefused where the drive lacks it."""
    objects.confirm(0x6060, 0, _PROFILE_POSITION)
    objects.confirm(0x6086, 0, _JERK_LIMITED, JerkProfileRefused)
    # Drives with one jerk value have 0x60A4 without 0x60A3; whether the jerk can be written decides.
    with contextlib.suppress(ObjectRefused):
        objects.confirm(0x60A3, 0, 1)
    present = objects.read(0x60A4, 1, JerkProfileRefused)
    objects.confirm(0x60A4, 1, present or 1, JerkProfileRefused)


def read_rated_torque(objects: Objects) -> float:
    """Rated torque of the motor [N·m], 0x6076, the unit of 0x6077."""
    rated = objects.read(0x6076) / 1000
    if rated <= 0:
        raise ObjectRefused(f"{objects.name}: rated torque 0x6076 reads {rated} N·m")
    return rated


def set_profile(objects: Objects, config: DriveConfig, move: DriveMove) -> None:
    """The limits of one move; JerkProfileRefused where the jerk does not read back."""
    objects.confirm(0x60A4, 1, round(move.jerk / config.jerk_lsb_rad_s3), JerkProfileRefused)
    objects.confirm(0x6081, 0, round(move.speed / config.speed_lsb_rad_s))
    for index in (0x6083, 0x6084):
        objects.confirm(index, 0, round(move.acceleration / config.acceleration_lsb_rad_s2))


def _milliseconds(seconds: float) -> int:
    return round(seconds * 1000)
