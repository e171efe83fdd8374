"""Effects of the measurement: the motion is as it was, the sensors say something else."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from service.dynamics.effects.effect import Effect, Measured, quantity


@dataclass(frozen=True)
class SensorLatency(Effect):
    """The accelerometer's samples are stamped ``latency`` too late against the motor's.

    Between sub-steps the acceleration is taken as a straight line.
    """

    name: ClassVar[str] = "sensor_latency"
    latency: float = quantity("s", 0.0, 0.05)

    @property
    def memory(self) -> float:
        return self.latency

    def measure(self, measured: Measured, dt: float) -> Measured:
        a = measured.load_acceleration
        sample = np.arange(len(a), dtype=np.float64)
        return replace(measured, load_acceleration=np.interp(sample - self.latency / dt, sample, a))
