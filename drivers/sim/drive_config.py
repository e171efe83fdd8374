"""How one simulated drive is built, and in which ways it may be a bad drive."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi


@dataclass(frozen=True)
class DriveFaults:
    """What is wrong with the drive; nothing by default.

    Attributes
    ----------
    refuses_jerk_limit : aborts 0x6086 = 2 and every write of 0x60A4
    ignored_writes : indices whose writes are acknowledged and forgotten
    trip_in_move : number of the move, from 0, in which the drive trips by itself
    trip_after_s : into that move
    trip_code : the EMCY error code of that trip; 0x2310 is continuous over-current
    warns_in_move : number of the move, from 0, in which the drive sends an EMCY, sets bit 7 and goes on
    warning_code : the EMCY error code of that warning; 0x4310 is a drive that grows hot
    tpdo_loss : probability that a TPDO is not sent
    silent_from_move : number of the move, from 0, from whose start no TPDO is sent any more
    heartbeat_stops_at_s : machine time from which no heartbeat is produced
    """

    refuses_jerk_limit: bool = False
    ignored_writes: frozenset[int] = frozenset()
    trip_in_move: int | None = None
    trip_after_s: float = 0.04
    trip_code: int = 0x2310
    warns_in_move: int | None = None
    warning_code: int = 0x4310
    tpdo_loss: float = 0.0
    silent_from_move: int | None = None
    heartbeat_stops_at_s: float | None = None


@dataclass(frozen=True)
class DriveConfig:
    """One drive: where it is wired, its units, and what the EDS does not say about it.

    Attributes
    ----------
    axis : name of the axis in the physics that its motor moves
    speed_noise_rad_s : standard deviation of the measured speed, before quantisation; chosen small, since
        an encoder of 16 bit leaves less than the speed's own unit
    send_delay_s, send_jitter_s : from the SYNC to the TPDO's readiness, and its random part (uniform)
    position_window_rad, position_window_s : target reached (bit 10) within this, for this long
    following_error_rad, following_error_s : fault 0x8611 beyond this, for this long
    brake_s : how long the motor's holding brake takes to close; None: it has none
    """

    axis: str
    node_id: int
    bus: str
    counts_per_rev: int = 65536
    speed_lsb_rad_s: float = 0.05 * 2 * pi / 60
    acceleration_lsb_rad_s2: float = 0.1
    jerk_lsb_rad_s3: float = 1.0
    speed_noise_rad_s: float = 0.002
    send_delay_s: float = 100e-6
    send_jitter_s: float = 40e-6
    position_window_rad: float = 0.02
    position_window_s: float = 0.01
    following_error_rad: float = 6.0
    following_error_s: float = 0.02
    brake_s: float | None = None
    faults: DriveFaults = field(default_factory=DriveFaults)

    @property
    def count_rad(self) -> float:
        """One increment of the position [rad]."""
        return 2 * pi / self.counts_per_rev
