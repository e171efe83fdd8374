"""A MEMS accelerometer that sends raw frames, described by a DBC.

Each data frame carries consecutive samples and the counter of the first; the samples are placed by
regressing that counter on receive time (``timebase``). A frame leaves when its last sample has been taken,
so the receive time belongs to the last sample. Invalid and clipped samples are left out, never filled in.

Another sensor is another DBC and a ``RoleMap``, no other code.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.bus import Bus
from drivers.errors import SensorFault, SensorSilent, SensorTooSlow, StreamError
from drivers.signals import SignalSlice, load_dbc, slices_of
from drivers.timebase import RATE_TOLERANCE, Timebase, lost_between, place
from drivers.trace import ByteArray, FloatArray, Frames, Trace

log = logging.getLogger(__name__)

LOWEST_RATE = 500.0
"""Below it t2 is uncertain by more than a tenth of the gap time [Hz]: db/b = 3 dt/T, T = 11.4 ms at 50 µm."""

SENSIBLE_RATE = 2000.0
"""Below it a warning [Hz]: one sample is 13 % of a 50 µm backlash."""


@dataclass(frozen=True)
class RoleMap:
    """Which messages and signals of the DBC play which part; None where the sensor has none.

    `invalid` and `clipped` are names in the samples' value table (VAL_). Clipped counts mark both directions.
    """

    data_message: str = "AccelerometerData"
    samples: tuple[str, ...] = ("Sample0", "Sample1", "Sample2")
    counter: str = "Counter"
    invalid: str = "Invalid"
    clipped: str = "Clipped"
    time_message: str | None = "AccelerometerTime"
    device_time: str = "DeviceTime"
    device_time_lsb_s: float = 1e-6
    temperature: str = "Temperature"
    over_range: str = "OverRange"
    self_test_failed: str = "SelfTestFailed"


@dataclass(frozen=True)
class AccelerometerConfig:
    """One sensor.

    Attributes
    ----------
    data_id, time_id : CAN ids of its frames; they take the place of the DBC's
    nominal_rate : samples per second [Hz]
    direction : +1 where the sensor's axis points along positive travel, else -1
    to_si : [m/s²] per unit of the DBC's physical value (1 for m/s², 9.80665 for g)
    delay : from the middle of a sample's interval to the arrival of the frame that ends with it [s]: half a sample,
        the filter's group delay, and the frame's time on the wire
    dbc : None for the default contract
    """

    name: str
    data_id: int
    time_id: int | None
    nominal_rate: float = 4000.0
    direction: Literal[1, -1] = 1
    to_si: float = 1.0
    delay: float = 0.0
    dbc: Path | None = None
    roles: RoleMap = field(default_factory=RoleMap)


@dataclass(frozen=True)
class DeviceStatus:
    """What the time frames of a recording said.

    Attributes
    ----------
    device_rate : samples per second by the device's own clock [Hz]; nan with fewer than two time frames
    temperature : the last one [°C]; nan without
    over_range : it saw more than it can measure
    """

    device_rate: float = np.nan
    temperature: float = np.nan
    over_range: bool = False


@dataclass(frozen=True)
class AccelerometerRecord:
    """What one sensor said during a recording.

    Attributes
    ----------
    acceleration : [m/s²], positive travel positive; lost, invalid and clipped samples are absent
    timebase : one count per sample
    lost, invalid, clipped : samples
    status : from the time frames
    warnings : sentences for the run's report
    """

    acceleration: Trace
    timebase: Timebase
    lost: int
    invalid: int
    clipped: int
    status: DeviceStatus
    warnings: tuple[str, ...] = ()


class Decoder:
    """Turns payloads into counters, samples and status by the DBC and the role map."""

    def __init__(self, config: AccelerometerConfig) -> None:
        roles = config.roles
        database = load_dbc(config.dbc)
        data = slices_of(database.get_message_by_name(roles.data_message))
        self._samples = tuple(data[name] for name in roles.samples)
        self._counter = data[roles.counter]
        self._time: dict[str, SignalSlice] = (
            slices_of(database.get_message_by_name(roles.time_message)) if roles.time_message else {}
        )
        self._config = config

    @property
    def samples_per_frame(self) -> int:
        """Samples in one data frame."""
        return len(self._samples)

    @property
    def modulus(self) -> int:
        """The counter wraps here."""
        return 1 << self._counter.length

    def counter(self, payload: ByteArray) -> NDArray[np.int64]:
        """Counter of the first sample of each frame, shape (n,)."""
        return self._counter.raw(payload)

    def counts(self, payload: ByteArray) -> NDArray[np.int64]:
        """Raw samples, shape (n, samples per frame)."""
        return np.stack([sample.raw(payload) for sample in self._samples], axis=1)

    def acceleration(self, counts: NDArray[np.int64]) -> FloatArray:
        """[m/s²], positive travel positive, of raw samples (n, samples per frame)."""
        scale = np.array([sample.scale for sample in self._samples])
        offset = np.array([sample.offset for sample in self._samples])
        value: FloatArray = (counts * scale + offset) * (self._config.to_si * self._config.direction)
        return value

    def invalid(self, counts: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Samples that the sensor marks as invalid; shape of `counts`."""
        return np.equal(counts, self._marker(self._config.roles.invalid))

    def clipped(self, counts: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Samples at the end of the range, in either direction; shape of `counts`."""
        marker = self._marker(self._config.roles.clipped)
        return np.equal(np.abs(counts), marker)

    def _marker(self, name: str) -> int:
        # Beyond any count of a 64-bit payload, hence equal to none: a sensor without this marker.
        return self._samples[0].choices.get(name, 1 << 62)

    def status(self, payload: ByteArray) -> DeviceStatus:
        """Status from the time frames; SensorFault when the self-test failed."""
        roles = self._config.roles
        if not len(payload) or not self._time:
            return DeviceStatus()
        if self._flag(roles.self_test_failed, payload):
            raise SensorFault(f"{self._config.name}: the self-test failed")
        temperature = self._time.get(roles.temperature)
        return DeviceStatus(
            device_rate=self._device_rate(payload),
            temperature=float(temperature.physical(payload[-1:])[0]) if temperature else np.nan,
            over_range=self._flag(roles.over_range, payload),
        )

    def _flag(self, name: str, payload: ByteArray) -> bool:
        return name in self._time and bool(self._time[name].raw(payload).any())

    def _device_rate(self, payload: ByteArray) -> float:
        device_time, counter = (
            self._time.get(self._config.roles.device_time),
            self._time.get(self._config.roles.counter),
        )
        if device_time is None or counter is None or len(payload) < 2:
            return np.nan
        ticks = np.mod(np.diff(device_time.raw(payload)), 1 << device_time.length)
        counts = np.mod(np.diff(counter.raw(payload)), 1 << counter.length)
        # A lost time frame or two leave the counter unambiguous; more than a wrap of it do not.
        seconds = ticks * self._config.roles.device_time_lsb_s
        known = (seconds > 0) & (seconds < 0.5 * (1 << counter.length) / self._config.nominal_rate)
        return float(counts[known].sum() / seconds[known].sum()) if known.any() else np.nan


class Accelerometer:
    """One sensor on a bus."""

    def __init__(self, bus: Bus, config: AccelerometerConfig) -> None:
        self.bus = bus
        self.config = config
        self.decoder = Decoder(config)
        self._clock: float | None = None
        bus.subscribe(config.data_id, self._on_data)

    def _on_data(self, at: float, _: int, __: bytes) -> None:
        self._clock = self.bus.moment(at)

    def close(self) -> None:
        """Take no notice of the sensor any more."""
        self.bus.unsubscribe(self.config.data_id, self._on_data)

    def wait_alive(self, timeout: float = 1.0) -> None:
        """Wait for a first data frame from now on; SensorSilent without one."""
        self._clock = None
        if not self.bus.wait_until(lambda: self._clock is not None, timeout):
            raise SensorSilent(f"{self._label}: no data frame within {timeout:.1f} s")

    def check(self, patience: float = 0.5) -> None:
        """Raise SensorSilent when the last data frame is older than `patience` [s]."""
        age = self.bus.clock() - self._clock if self._clock is not None else np.inf
        if age > patience:
            raise SensorSilent(f"{self._label}: no data frame for {age:.1f} s")

    def record(self, frames: Frames) -> AccelerometerRecord:
        """Acceleration out of recorded frames.

        Raises SensorSilent, SensorTooSlow, SensorFault, SamplesMissing, CounterRestarted or ClockInconsistent
        when there is no honest trace.
        """
        return decode(frames, self.config, self.decoder)

    @property
    def _label(self) -> str:
        return f"{self.config.name} (frame 0x{self.config.data_id:X})"


def decode(frames: Frames, config: AccelerometerConfig, decoder: Decoder) -> AccelerometerRecord:
    """See ``Accelerometer.record``."""
    data = frames.of(config.data_id)
    if not len(data):
        raise SensorSilent(f"{config.name} (frame 0x{config.data_id:X}): no data frame in the recording")
    try:
        index, timebase = _place(data, config, decoder)
    except StreamError as error:
        raise type(error)(f"{config.name} (frame 0x{config.data_id:X}): {error.what}") from error
    status = decoder.status(_time_payload(frames, config))
    fresh = np.diff(index, prepend=index[0] - 1) > 0
    index, counts = index[fresh], decoder.counts(data.payload[fresh])
    invalid, clipped = decoder.invalid(counts), decoder.clipped(counts)
    sample = index[:, None] + np.arange(decoder.samples_per_frame)
    kept = ~(invalid | clipped)
    return AccelerometerRecord(
        acceleration=Trace(timebase.time(sample[kept]) - config.delay, decoder.acceleration(counts)[kept]),
        timebase=timebase,
        lost=decoder.samples_per_frame * lost_between(index, decoder.samples_per_frame),
        invalid=int(invalid.sum()),
        clipped=int(clipped.sum()),
        status=status,
        warnings=_warnings(config, timebase, int(clipped.sum()), status),
    )


def _time_payload(frames: Frames, config: AccelerometerConfig) -> ByteArray:
    return frames.of(config.time_id if config.time_id is not None else -1).payload


def _place(data: Frames, config: AccelerometerConfig, decoder: Decoder) -> tuple[NDArray[np.int64], Timebase]:
    """Index of the first sample of each frame, and the line on which samples lie."""
    last = decoder.samples_per_frame - 1
    counter = np.mod(decoder.counter(data.payload) + last, decoder.modulus)
    index, timebase = place(counter, data.time, decoder.modulus, 1 / config.nominal_rate)
    if timebase.rate < LOWEST_RATE:
        raise SensorTooSlow(f"{timebase.rate:.0f} samples/s, at least {LOWEST_RATE:.0f} are needed")
    if abs(timebase.rate / config.nominal_rate - 1) > RATE_TOLERANCE:
        raise SensorTooSlow(f"{timebase.rate:.0f} samples/s where {config.nominal_rate:.0f} are configured")
    return index - last, timebase


def _warnings(
    config: AccelerometerConfig, timebase: Timebase, clipped: int, status: DeviceStatus
) -> tuple[str, ...]:
    found = []
    if timebase.rate < SENSIBLE_RATE:
        found.append(f"{config.name}: {timebase.rate:.0f} samples/s; 2000 or more are advised")
    if clipped or status.over_range:
        found.append(f"{config.name}: the sensor was over its range ({clipped} clipped samples)")
    for sentence in found:
        log.warning(sentence)
    return tuple(found)
