"""The accelerometer's frames: byte for byte, and statistically what its configuration says is wrong with it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.signal import welch

from drivers.sim.accelerometer_node import (
    AccelerometerConfig,
    AccelerometerFaults,
    AccelerometerNode,
    IntervalMeans,
    SampleClock,
)
from drivers.sim.physics import FloatArray

DT = 0.000125
LSB = 0.002394
PERFECT = AccelerometerConfig(
    "X1",
    "a",
    0x300,
    0x310,
    rate_error=0.0,
    rate_drift=0.0,
    clock_error=0.0,
    latency_s=0.0,
    send_jitter_s=0.0,
    noise_ug_sqrt_hz=0.0,
    bias_m_s2=0.0,
    sensitivity_error=0.0,
)


@dataclass
class Record:
    """What a reader of the frames sees: arrival, first counter (unwrapped by the test's shortness), raw codes."""

    arrival: FloatArray
    counter: np.ndarray
    codes: np.ndarray
    time_frames: list[tuple[float, bytes]]


def record(config: AccelerometerConfig, duration: float, signal=lambda t: 0 * t, seed: int = 1) -> Record:
    """Feed ``signal`` in blocks of 5 ms and take the frames apart."""
    node, frames = AccelerometerNode(config, DT, seed), []
    for k in range(round(duration / 0.005)):
        t = 0.005 * k + DT * np.arange(1, 41)
        frames += node.observe(signal(t), 0.005 * (k + 1))
    data = [f for f in frames if f[1] == 0x300]
    words = np.frombuffer(b"".join(f[2] for f in data), dtype="<u2").reshape(-1, 4)
    codes = words[:, :3].astype("<u2").view("<i2").reshape(-1, 3)
    times = [(f[0], f[2]) for f in frames if f[1] == 0x310]
    return Record(np.array([f[0] for f in data]), words[:, 3].astype(int), codes, times)


def test_frames_byte_for_byte():
    """0.2394 m/s² is 100 counts; at 4 kHz the third sample is taken at 0.5 ms."""
    node = AccelerometerNode(PERFECT, DT, 1)
    frames = node.observe(np.full(40, 0.2394), 0.005)
    data = [f for f in frames if f[1] == 0x300]
    assert data[1][2].hex() == "6400640064000300"
    assert data[1][0] == pytest.approx(5 / 4000 + 0.0001)


def test_time_frame_byte_for_byte():
    """After 5 ms 7 frames are complete: sample 20 was taken at 5000 µs = 0x1388; 31 °C."""
    node = AccelerometerNode(PERFECT, DT, 1)
    (frame,) = (f for f in node.observe(np.zeros(40), 0.005) if f[1] == 0x310)
    assert frame[2].hex() == "8813000014001f00"


@pytest.mark.parametrize("frequency", [37.0, 400.0])
def test_samples_are_means_over_their_own_interval(frequency):
    """A 3.117 kHz sensor on an 8 kHz physics, against the integral of the sine in closed form."""
    config = replace(PERFECT, nominal_rate_hz=3117.0)
    got = record(config, 0.4, lambda t: 10 * np.sin(2 * np.pi * frequency * t))
    value = got.codes.ravel() * LSB
    edges = np.arange(-1, len(value)) / 3117.0
    omega = 2 * np.pi * frequency
    expected = 10 * np.diff(-np.cos(omega * edges) / omega) * 3117.0
    linear = 10 * (omega * DT) ** 2 / 8  # what a chord misses of the sine
    assert np.max(np.abs(value - expected)[1:]) < LSB / 2 + linear


def test_interval_means_are_exact_for_what_is_linear():
    """The mean of 3t + 1 over any interval is its value in the middle, however the blocks fall."""
    means = IntervalMeans(DT, reach=0.01)
    rng = np.random.default_rng(0)
    done = 0
    for n in rng.integers(1, 90, size=40):
        t = (done + np.arange(1, n + 1)) * DT
        means.append(3 * t + 1)
        done += n
        low = max(0.002, done * DT - 0.01)
        edges = np.sort(rng.uniform(low, done * DT, size=9)) if done * DT > low else np.array([])
        middle = (edges[1:] + edges[:-1]) / 2
        if len(edges) and low > 0.002:
            assert np.allclose(means.between(edges), 3 * middle + 1, atol=1e-9)


def test_latency_shifts_the_content_not_the_frames():
    ramp = lambda t: 40 * t  # noqa: E731
    prompt, late = record(PERFECT, 0.5, ramp), record(replace(PERFECT, latency_s=0.002), 0.5, ramp)
    assert np.array_equal(prompt.arrival, late.arrival)
    shift = (prompt.codes[100:] - late.codes[100:]) * LSB / 40
    assert np.mean(shift) == pytest.approx(0.002, rel=0.02)


@pytest.mark.parametrize("rate_error", [-0.04, 0.021])
def test_the_sample_clock_is_off(rate_error):
    got = record(replace(PERFECT, rate_error=rate_error, send_jitter_s=0.0), 4.0)
    rate = (got.counter[-1] - got.counter[0]) / (got.arrival[-1] - got.arrival[0])
    assert rate == pytest.approx(4000 * (1 + rate_error), rel=1e-6)


def test_the_sample_clock_drifts_slowly_and_evenly():
    config = replace(PERFECT, rate_drift=1e-3)
    clock = SampleClock(config)
    t = clock.times(np.arange(0, 4000 * 130, 4000))
    rate = 4000 / np.diff(t)
    assert rate.max() == pytest.approx(4004, abs=0.05) and rate.min() == pytest.approx(3996, abs=0.05)
    assert np.max(np.abs(np.diff(rate))) < 4 * 2 * np.pi / 120 * 1.1
    assert clock.samples_until(float(t[77])) - 1 in (77 * 4000 - 1, 77 * 4000)


def test_device_time_and_counter_tell_the_rate():
    """The time frames' quartz is 30 ppm fast: the regression yields the sample rate on that quartz."""
    got = record(replace(PERFECT, rate_error=0.03, clock_error=30e-6), 8.0)
    device = np.array([int.from_bytes(d[0:4], "little") for _, d in got.time_frames]) * 1e-6
    counter = np.array([int.from_bytes(d[4:6], "little") for _, d in got.time_frames])
    assert len(device) == 81, "ten a second, and the first"
    rate = np.polyfit(device, counter, 1)[0]
    assert rate == pytest.approx(4120 / (1 + 30e-6), rel=1e-7)


def test_the_counter_wraps_at_16_bit():
    got = record(PERFECT, 17.0)
    assert np.all(np.diff(got.counter) % 65536 == 3)
    assert got.counter[-1] < got.counter[-2000]


@pytest.mark.parametrize("density", [25.0, 150.0])
def test_noise_density_by_welch(density):
    """One-sided density in m/s²/√Hz, flat from 50 Hz to 1.9 kHz; 157 averages give 8 % per bin, 0.2 % on average."""
    got = record(replace(PERFECT, noise_ug_sqrt_hz=density), 20.0)
    f, power = welch(got.codes.ravel() * LSB, fs=4000.0, nperseg=1024)
    band = (f > 50) & (f < 1900)
    quantisation = LSB**2 / 12 / 2000
    expected = (density * 1e-6 * 9.80665) ** 2 + quantisation
    assert np.mean(power[band]) == pytest.approx(expected, rel=0.02)
    low, high = np.mean(power[band & (f < 900)]), np.mean(power[band & (f > 1000)])
    assert low == pytest.approx(high, rel=0.03), "white"


def test_bias_and_sensitivity():
    got = record(replace(PERFECT, bias_m_s2=0.4, sensitivity_error=-0.01), 0.5, lambda t: 0 * t + 20.0)
    assert np.all(np.abs(got.codes[5:] * LSB - (20 * 0.99 + 0.4)) <= LSB / 2)


@pytest.mark.parametrize(
    ("value", "code"),
    [(78.0, 32581), (78.443, 32766), (-78.443, -32766), (78.447, 0x7FFF), (-78.447, 0x7FFF)],
)
def test_clipped_samples_are_marked_in_either_direction(value, code):
    got = record(PERFECT, 0.2, lambda t: 0 * t + value)
    assert np.all(got.codes[2:] == code)
    over_range = [d[7] for _, d in got.time_frames]
    assert over_range == [0b010 if code == 0x7FFF else 0] * 3


def test_jitter_delays_but_never_reorders():
    got = record(replace(PERFECT, send_jitter_s=0.0003), 10.0)
    late = got.arrival - ((got.counter + 2) / 4000 + 0.0001)
    assert np.all(np.diff(got.arrival) >= 0) and np.all(np.diff(got.counter) == 3)
    assert late.min() < 1e-5 and late.min() >= -1e-12
    assert 0.0003 < late.mean() < 0.0005  # waiting for one another makes it longer than the mean 0.3 ms


def test_random_losses():
    got = record(replace(PERFECT, faults=AccelerometerFaults(loss=0.02)), 15.0)
    expected = 15.0 * 4000 / 3
    lost = expected - len(got.counter)
    assert abs(lost - 0.02 * expected) < 4 * np.sqrt(expected * 0.02 * 0.98)


def test_losses_in_bursts():
    got = record(replace(PERFECT, faults=AccelerometerFaults(burst_rate=0.002, burst_length=7)), 15.0)
    gaps = np.diff(got.counter)
    missing = gaps[gaps > 3] // 3 - 1
    assert len(missing) > 15 and missing.min() == 7
    assert np.mean(missing == 7) > 0.9, "only overlapping bursts are longer"


def test_lost_in_a_window():
    got = record(replace(PERFECT, faults=AccelerometerFaults(lost_between_s=(0.2, 0.3))), 0.5)
    sampled = (got.counter + 2) / 4000
    assert not np.any((sampled >= 0.2) & (sampled < 0.3))
    assert np.count_nonzero(sampled < 0.2) + np.count_nonzero(sampled >= 0.3) == len(sampled) > 500


def test_blocked_sensor_repeats_itself():
    faulty = replace(PERFECT, noise_ug_sqrt_hz=75.0, bias_m_s2=0.05, faults=AccelerometerFaults(blocked=True))
    got = record(faulty, 0.5, lambda t: np.sin(t))
    assert set(got.codes.ravel().tolist()) == {round(0.05 / LSB)}


def test_silent_sensor_sends_nothing():
    got = record(replace(PERFECT, faults=AccelerometerFaults(silent=True)), 0.5)
    assert len(got.counter) == 0 and got.time_frames == []


@pytest.mark.parametrize(("faults", "gain"), [({"inverted": True}, -1.0), ({"across": True}, 0.02)])
def test_wrongly_mounted_sensor(faults, gain):
    got = record(replace(PERFECT, faults=AccelerometerFaults(**faults)), 0.3, lambda t: 0 * t + 50.0)
    assert np.all(np.abs(got.codes[5:] * LSB - 50 * gain) <= LSB / 2)


def test_invalid_samples_and_failed_self_test_are_said():
    got = record(replace(PERFECT, faults=AccelerometerFaults(invalid=0.05, self_test_failed=True)), 5.0)
    share = np.mean(got.codes == -0x8000)
    assert abs(share - 0.05) < 4 * np.sqrt(0.05 * 0.95 / got.codes.size)
    assert {d[7] for _, d in got.time_frames} == {0b100}


def test_the_seed_decides():
    noisy = AccelerometerConfig("X1", "a", 0x300, 0x310, faults=AccelerometerFaults(loss=0.01))
    first, again, other = (record(noisy, 1.0, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(first.codes, again.codes) and np.array_equal(first.arrival, again.arrival)
    assert not np.array_equal(first.codes[:500], other.codes[:500])
