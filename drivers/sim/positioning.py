"""Profile position mode of one simulated drive: set-point handshake, profiles, braking, coasting.

Between blocks only: a command takes effect at the start of a block, as in a drive with that cycle time.
Not done: blending into a new target in mid-move; "change at once" brakes first and then goes there.
"""

from __future__ import annotations

from math import inf

import numpy as np

from drivers.sim.dictionary import Dictionary
from drivers.sim.drive_config import DriveConfig
from drivers.sim.physics import FloatArray, PhysicsBlock, Setpoint
from drivers.sim.trajectory import Profile, point_to_point, stop_ramp

NEW_SETPOINT = 1 << 4
CHANGE_AT_ONCE = 1 << 5
RELATIVE = 1 << 6
HALT = 1 << 8

COASTED_OUT = 1.0
"""Below this speed of the motor [rad/s] a coasting axis counts as standing; chosen: 3 mm/s at 3 mm/rad."""


class ParameterMissing(Exception):
    """A move was commanded with a speed, acceleration or jerk of zero."""


class Positioning:
    """What the drive asks of its motor, block after block.

    ``moves`` counts the set-points begun, ``moving`` is true while the set-point or a coasting axis moves.
    """

    def __init__(self, config: DriveConfig, dictionary: Dictionary, dt: float) -> None:
        self._config, self._dictionary, self._dt = config, dictionary, dt
        self.powered = False
        self.acknowledged = self.limited = False
        self.moves = 0
        self.actual = self.actual_speed = 0.0
        self._profile: Profile | None = None
        self._substeps = 0
        self._hold = self._hold_speed = 0.0
        self._target = 0
        self._queued: int | None = None

    @property
    def moving(self) -> bool:
        coasting = not self.powered and abs(self.actual_speed) > COASTED_OUT
        return self._profile is not None or coasting

    @property
    def driven(self) -> bool:
        """Whether a set-point moves, and not an axis without torque."""
        return self._profile is not None

    @property
    def elapsed(self) -> float:
        """Time since the profile's start [s]."""
        return self._substeps * self._dt

    def power_on(self) -> None:
        self.powered, self.limited = True, False
        self._rest_at(self.actual)
        self._target = round(self.actual / self._config.count_rad)

    def power_off(self) -> None:
        """Take the torque away: the axis coasts."""
        self.powered = self.acknowledged = False
        self._profile = self._queued = None

    def brake(self, deceleration_counts: int) -> None:
        """Ramp from the present set-point to rest; without a ramp (0) stop dead."""
        self._queued = None
        deceleration = deceleration_counts * self._config.acceleration_lsb_rad_s2
        if self._profile is not None and deceleration > 0:
            self._begin(stop_ramp(self._hold, self._hold_speed, deceleration))
        else:
            self._rest_at(self._hold)

    def controlword(self, previous: int, value: int) -> None:
        """Bits 4, 5, 6 and 8 in Operation enabled. Raises ParameterMissing."""
        if value & HALT and not previous & HALT:
            self.brake(self._dictionary.values[0x6084, 0])
        if value & NEW_SETPOINT and not previous & NEW_SETPOINT and not value & HALT:
            self._accept(value)
        elif not value & NEW_SETPOINT and self._queued is None:
            self.acknowledged = False

    def _accept(self, value: int) -> None:
        if self._queued is not None:
            return  # the one place of the queue is taken: not acknowledged anew
        counts = self._dictionary.values[0x607A, 0] + (self._target if value & RELATIVE else 0)
        self.acknowledged = True
        if self._profile is None:
            self._go_to(counts)
            return
        if value & CHANGE_AT_ONCE:
            self.brake(self._dictionary.values[0x6084, 0])
        self._queued = counts

    def _go_to(self, counts: int) -> None:
        values, config = self._dictionary.values, self._config
        allowed = min(max(counts, values[0x607D, 1]), values[0x607D, 2])
        self._target, self.limited = allowed, allowed != counts
        limits = (
            min(values[0x6081, 0], values[0x607F, 0]) * config.speed_lsb_rad_s,
            values[0x6083, 0] * config.acceleration_lsb_rad_s2,
            values[0x6084, 0] * config.acceleration_lsb_rad_s2,
            values[0x60A4, 1] * config.jerk_lsb_rad_s3 if values[0x6086, 0] == 2 else inf,
        )
        if min(limits) <= 0:
            raise ParameterMissing
        self.moves += 1
        self._begin(point_to_point(self._hold, allowed * config.count_rad, *limits))

    def _begin(self, profile: Profile) -> None:
        self._profile, self._substeps = profile, 0

    def _rest_at(self, position: float) -> None:
        self._profile, self._hold, self._hold_speed = None, position, 0.0

    def setpoint(self, n: int) -> Setpoint:
        """The set-points of the next block of ``n`` sub-steps. Raises ParameterMissing."""
        if self._profile is None and self._queued is not None:
            counts, self._queued = self._queued, None
            self._go_to(counts)
        if self._profile is None:
            nothing = np.zeros(n)
            return Setpoint(self.powered, np.full(n, self._hold), nothing, nothing)
        x, v, a = self._profile.at(np.arange(self._substeps + 1.0, self._substeps + n + 1.0) * self._dt)
        self._substeps += n
        self._hold, self._hold_speed = float(x[-1]), float(v[-1])
        if self.elapsed >= self._profile.duration:
            self._rest_at(self._profile.end)
        return Setpoint(True, x, v, a)

    def observe(self, block: PhysicsBlock) -> None:
        self.actual = float(block.motor_position[-1])
        self.actual_speed = float(block.motor_speed[-1])

    def at_target(self, setpoint: Setpoint, block: PhysicsBlock, samples: slice) -> FloatArray:
        """At each sampled sub-step 1 where the set-point rests and the motor is within the window, else 0."""
        error = self._target * self._config.count_rad - block.motor_position[samples]
        inside = np.abs(error) <= self._config.position_window_rad
        return np.where(inside & (setpoint.speed[samples] == 0) & self.powered & (not self.limited), 1.0, 0.0)
