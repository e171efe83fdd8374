"""A MEMS accelerometer on CAN from the device's side: its own clock and all that is wrong with its values.

A sample is the mean of the physics over the sample's own interval, ``latency_s`` earlier (the filter in the
chip). A frame leaves after its third sample, late by a random time; what goes wrong is in the frames.
Packed by hand from the description of the frames, sharing nothing with the real driver.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import ceil, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from drivers.sim.physics import FloatArray
from drivers.sim.wire import Frame

STANDARD_GRAVITY = 9.80665
ACCEL_LSB_M_S2 = 0.002394
ACCEL_RANGE_M_S2 = 8 * STANDARD_GRAVITY
CLIPPED, INVALID = 0x7FFF, -0x8000
TIME_FRAME_PERIOD_S = 0.1

_DRIFT_PERIOD_S = 120.0
"""Period of the slow change of the sample clock; chosen: a chip that warms and cools with its axis."""


@dataclass(frozen=True)
class AccelerometerFaults:
    """What is wrong with the sensor; nothing by default.

    Attributes
    ----------
    loss : probability that a data frame is not sent
    burst_rate, burst_length : probability per frame that this many in a row are lost from it on
    lost_between_s : machine times [s] between which no data frame is sent
    silent : sends nothing at all
    blocked : sends the same value for ever
    inverted : mounted the wrong way round
    across : mounted across the axis: noise, bias and 2 % of the motion
    invalid : probability that a sample is marked invalid
    self_test_failed : says so in its time frames
    """

    loss: float = 0.0
    burst_rate: float = 0.0
    burst_length: int = 8
    lost_between_s: tuple[float, float] | None = None
    silent: bool = False
    blocked: bool = False
    inverted: bool = False
    across: bool = False
    invalid: float = 0.0
    self_test_failed: bool = False

    @property
    def gain(self) -> float:
        """What the faults make of the sensitivity."""
        return (-1.0 if self.inverted else 1.0) * (0.02 if self.across else 1.0)


@dataclass(frozen=True)
class AccelerometerConfig:
    """One sensor: where it is mounted and wired, and how good it is. Defaults: an ordinary MEMS chip.

    Attributes
    ----------
    axis : whose load it rides on
    rate_error, rate_drift : constant error of the sample clock and amplitude of its slow change [1]
    clock_error : of the quartz behind the device time in the time frames [1]
    latency_s : age of a sample's interval when the sample is taken [s]
    send_delay_s, send_jitter_s : from a frame's last sample to its readiness, and the mean of the random part
        (exponential, as of a controller that is sometimes busy)
    noise_ug_sqrt_hz : noise density [µg/√Hz], white up to half the sample rate
    sensitivity_error : [1]
    """

    axis: str
    bus: str
    data_id: int
    time_id: int
    nominal_rate_hz: float = 4000.0
    rate_error: float = 0.021
    rate_drift: float = 2e-5
    clock_error: float = 30e-6
    latency_s: float = 0.1e-3
    send_delay_s: float = 0.1e-3
    send_jitter_s: float = 0.15e-3
    noise_ug_sqrt_hz: float = 75.0
    bias_m_s2: float = 0.06
    sensitivity_error: float = 0.004
    range_m_s2: float = ACCEL_RANGE_M_S2
    temperature_deg_c: float = 31.0
    faults: AccelerometerFaults = field(default_factory=AccelerometerFaults)

    @property
    def noise_m_s2(self) -> float:
        """Standard deviation of one sample's noise [m/s²]."""
        return self.noise_ug_sqrt_hz * 1e-6 * STANDARD_GRAVITY * sqrt(self.nominal_rate_hz / 2)


class SampleClock:
    """When the device takes its samples, on the machine's clock.

    ``m(t) = f (1 + rate_error) t + f·rate_drift·P/2π·(1 − cos 2πt/P)``: sample m is taken where m(t) = m.
    """

    def __init__(self, config: AccelerometerConfig) -> None:
        self._rate = config.nominal_rate_hz * (1 + config.rate_error)
        self._swing = config.nominal_rate_hz * config.rate_drift * _DRIFT_PERIOD_S / (2 * pi)

    def samples_until(self, time: float) -> int:
        """How many samples were taken up to ``time`` [s]: the first one is sample 0."""
        return int(self._rate * time + self._swing * (1 - np.cos(2 * pi * time / _DRIFT_PERIOD_S))) + 1

    def times(self, samples: NDArray[np.int64]) -> FloatArray:
        """Machine time [s] of each sample (n,); three steps of a fixed point that contracts by ``rate_drift``."""
        t = samples / self._rate
        for _ in range(3):
            t = (samples - self._swing * (1 - np.cos(2 * pi * t / _DRIFT_PERIOD_S))) / self._rate
        return t


class IntervalMeans:
    """Exact means over arbitrary intervals of a signal that is linear between the points of the fine grid."""

    def __init__(self, dt: float, reach: float) -> None:
        self._dt = dt
        self._keep = ceil(reach / dt) + 2
        self._first = 0  # grid index of the first point kept
        self._value = np.zeros(1)
        self._integral = np.zeros(1)

    def append(self, values: FloatArray) -> None:
        """Add the next points (n,) of the grid; what lies further back than ``reach`` [s] is dropped."""
        drop = max(0, len(self._value) - self._keep)
        self._first += drop
        value = np.concatenate((self._value[drop:], values))
        steps = (value[len(self._value) - drop - 1 : -1] + values) * (self._dt / 2)
        self._integral = np.concatenate((self._integral[drop:], self._integral[-1] + np.cumsum(steps)))
        self._value = value

    def between(self, edges: FloatArray) -> FloatArray:
        """Means between neighbouring ``edges`` (n + 1,) [s], shape (n,); before time zero the signal is zero."""
        integral = self._antiderivative(edges)
        return (integral[1:] - integral[:-1]) / (edges[1:] - edges[:-1])

    def _antiderivative(self, t: FloatArray) -> FloatArray:
        at = np.maximum(t / self._dt - self._first, 0.0)
        k = np.minimum(at.astype(np.intp), len(self._value) - 2)
        u = at - k
        a, rise = self._value[k], self._value[k + 1] - self._value[k]
        integral: FloatArray = self._integral[k] + self._dt * u * (a + u * rise / 2)
        return integral


class AccelerometerNode:
    """One sensor. ``observe`` takes the load's acceleration block after block and gives the frames."""

    def __init__(self, config: AccelerometerConfig, dt: float, seed: int) -> None:
        self.config = config
        self._clock = SampleClock(config)
        self._means = IntervalMeans(dt, reach=config.latency_s + 2 * 3 / config.nominal_rate_hz + 2 * dt)
        self._streams = [np.random.default_rng([seed, config.data_id, k]) for k in range(5)]
        self._next = 0  # sample with which the next data frame begins
        self._next_time_frame = 0.0
        self._burst_left = 0
        self._free_at = 0.0
        self._over_range = False

    def observe(self, load_acceleration: FloatArray, until: float) -> list[Frame]:
        """Frames that were completed by machine time ``until`` [s], at which the block ends."""
        self._means.append(load_acceleration)
        if self.config.faults.silent:
            return []
        frames = (self._clock.samples_until(until) - self._next) // 3
        first, self._next = self._next, self._next + 3 * max(0, frames)
        sent = self._data_frames(first, frames) if frames > 0 else []
        return sent + self._time_frames(until)

    def _data_frames(self, first: int, count: int) -> list[Frame]:
        samples = np.arange(first - 1, first + 3 * count)
        times = self._clock.times(samples)
        codes = self._codes(self._means.between(times - self.config.latency_s))
        words = np.empty((count, 4), dtype="<u2")
        words[:, :3] = codes.reshape(count, 3).astype("<i2").view("<u2")
        words[:, 3] = samples[1::3] & 0xFFFF
        raw, ready = words.tobytes(), self._ready_times(times[3::3])
        kept = np.flatnonzero(~self._lost(times[3::3]))
        return [(float(ready[k]), self.config.data_id, raw[8 * k : 8 * k + 8]) for k in kept]

    def _codes(self, truth: FloatArray) -> NDArray[np.int64]:
        """What the chip makes of the true acceleration (n,): bias, gain, noise, range, counts."""
        config, faults = self.config, self.config.faults
        noise = config.noise_m_s2 * self._streams[0].standard_normal(len(truth))
        value = truth * faults.gain * (1 + config.sensitivity_error) + config.bias_m_s2 + noise
        if faults.blocked:
            value = np.full_like(truth, config.bias_m_s2)
        counts = np.rint(value / ACCEL_LSB_M_S2)
        clipped = (np.abs(value) > config.range_m_s2) | (np.abs(counts) >= CLIPPED)
        self._over_range |= bool(clipped.any())
        codes = np.where(clipped, CLIPPED, counts)
        invalid = self._streams[1].random(len(truth)) < faults.invalid
        return np.where(invalid, INVALID, codes).astype(np.int64)

    def _ready_times(self, last_samples: FloatArray) -> FloatArray:
        """Frames are late by chance, but never overtake one another."""
        late = self.config.send_jitter_s * self._streams[2].standard_exponential(len(last_samples))
        ready = np.maximum.accumulate(last_samples + self.config.send_delay_s + late)
        ready = np.maximum(ready, self._free_at)
        self._free_at = float(ready[-1])
        return ready

    def _lost(self, times: FloatArray) -> NDArray[np.bool_]:
        faults = self.config.faults
        lost = self._streams[3].random(len(times)) < faults.loss
        begins = self._streams[4].random(len(times)) < faults.burst_rate
        for k in range(len(times)) if self._burst_left or begins.any() else ():
            self._burst_left = faults.burst_length if begins[k] else self._burst_left
            lost[k] |= self._burst_left > 0
            self._burst_left = max(0, self._burst_left - 1)
        if faults.lost_between_s is not None:
            start, end = faults.lost_between_s
            lost |= (times >= start) & (times < end)
        return lost

    def _time_frames(self, until: float) -> list[Frame]:
        """The latest sample's counter and its time on the device's own clock, ten times a second."""
        if until < self._next_time_frame or self._next == 0:
            return []
        self._next_time_frame += TIME_FRAME_PERIOD_S
        sample = self._next - 1
        time = float(self._clock.times(np.array([sample]))[0])
        device_us = round(time * (1 + self.config.clock_error) * 1e6) & 0xFFFF_FFFF
        status = self._over_range << 1 | self.config.faults.self_test_failed << 2
        self._over_range = False
        temperature = round(self.config.temperature_deg_c)
        data = (
            device_us.to_bytes(4, "little")
            + (sample & 0xFFFF).to_bytes(2, "little")
            + temperature.to_bytes(1, "little", signed=True)
            + bytes([status])
        )
        return [(max(time + self.config.send_delay_s, self._free_at), self.config.time_id, data)]
