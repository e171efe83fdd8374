"""The sensor's frames, written byte by byte, and what is made of them."""

from __future__ import annotations

import dataclasses
import logging
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.accelerometer import AccelerometerConfig, AccelerometerRecord, Decoder, RoleMap, decode
from drivers.errors import CounterRestarted, SamplesMissing, SensorFault, SensorSilent, SensorTooSlow
from drivers.trace import Frame, Recorder

CONFIG = AccelerometerConfig("X1", data_id=0x305, time_id=0x315)
LSB = 0.002394


def data_frames(count: int, rate: float = 4000.0, start: float = 10.0, first: int = 0) -> list[Frame]:
    """Frames of a sensor whose sample k reads k % 1000 counts and was taken at start + k / rate."""
    return [
        (
            start + (k + 2) / rate + 1e-4 * (n % 7),
            0x305,
            struct.pack("<hhhH", *((k + j) % 1000 for j in range(3)), k % 65536),
        )
        for n, k in enumerate(range(first, first + 3 * count, 3))
    ]


def time_frame(at: float, device_us: int, counter: int, temperature: int = 30, status: int = 1) -> Frame:
    return at, 0x315, struct.pack("<IHbB", device_us % 2**32, counter % 65536, temperature, status)


def record(frames: list[Frame], config: AccelerometerConfig = CONFIG) -> AccelerometerRecord:
    recorder = Recorder()
    if frames:
        recorder.append(frames)
    return decode(recorder.frames(), config, Decoder(config))


def test_samples_lie_where_they_were_taken() -> None:
    found = record(data_frames(1000, rate=4100.0))
    assert len(found.acceleration) == 3000
    assert found.acceleration.time == pytest.approx(10.0 + np.arange(3000) / 4100.0, abs=1e-6)
    assert found.acceleration.value == pytest.approx(np.arange(3000) % 1000 * LSB)
    assert found.timebase.rate == pytest.approx(4100.0, rel=1e-6)
    assert (found.lost, found.invalid, found.clipped, found.warnings) == (0, 0, 0, ())


def test_positive_travel_is_positive_whichever_way_the_sensor_points() -> None:
    found = record(data_frames(100), dataclasses.replace(CONFIG, direction=-1))
    assert found.acceleration.value[:3] == pytest.approx([0.0, -LSB, -2 * LSB])


def test_a_dbc_in_g_is_made_si() -> None:
    found = record(data_frames(100), dataclasses.replace(CONFIG, to_si=9.80665))
    assert found.acceleration.value[1] == pytest.approx(LSB * 9.80665)


def test_the_known_delay_is_taken_off_the_stamps() -> None:
    late = record(data_frames(1000), replace(CONFIG, delay=4.5e-4))
    prompt = record(data_frames(1000))
    np.testing.assert_allclose(prompt.acceleration.time - late.acceleration.time, 4.5e-4, atol=1e-12)


def test_lost_frames_leave_gaps_and_are_counted() -> None:
    frames = data_frames(1000)
    del frames[500:504]
    found = record(frames)
    assert found.lost == 12
    gap = np.diff(found.acceleration.time)
    assert gap.max() == pytest.approx(13 / 4000.0, rel=1e-3)
    assert np.count_nonzero(gap > 1.5 / 4000.0) == 1


def test_a_frame_that_comes_twice_counts_once() -> None:
    frames = data_frames(100)
    found = record([*frames[:50], frames[49], *frames[50:]])
    assert len(found.acceleration) == 300
    assert np.diff(found.acceleration.time).min() > 0
    assert found.lost == 0


def test_invalid_and_clipped_samples_are_left_out() -> None:
    frames = data_frames(100)
    marked = struct.pack("<hhhH", -32768, 32767, -32767, 30)
    frames[10] = (frames[10][0], 0x305, marked)
    found = record(frames)
    assert (found.invalid, found.clipped, len(found.acceleration)) == (1, 2, 297)
    assert "over its range" in found.warnings[0]


def test_counter_wraps() -> None:
    found = record(data_frames(1000, first=65536 - 1500 + 1))
    assert np.diff(found.acceleration.time) == pytest.approx(np.full(2999, 1 / 4000.0), rel=1e-6)


def test_status_of_the_device() -> None:
    times = [
        time_frame(10.0 + 0.1 * k, 4_294_900_000 + 100_000 * k, 65000 + 402 * k, 31 + k, 3) for k in range(4)
    ]
    status = record([*data_frames(2000), *times]).status
    assert status.device_rate == pytest.approx(4020.0)
    assert status.temperature == 34.0
    assert status.over_range


def test_a_failed_self_test_is_an_error() -> None:
    with pytest.raises(SensorFault, match="X1"):
        record([*data_frames(100), time_frame(10.0, 0, 0, status=0b101)])


def test_a_silent_sensor_is_named() -> None:
    with pytest.raises(SensorSilent, match=r"X1 \(frame 0x305\).*cable"):
        record([time_frame(10.0, 0, 0)])
    with pytest.raises(SensorSilent):
        record([])


def test_a_sensor_below_500_hz_is_refused() -> None:
    with pytest.raises(SensorTooSlow, match=r"X1 \(frame 0x305\): 4\d\d samples/s"):
        record(data_frames(200, rate=450.0), dataclasses.replace(CONFIG, nominal_rate=450.0))


def test_a_sensor_far_from_its_nominal_rate_is_refused() -> None:
    with pytest.raises(SensorTooSlow, match="4000 are configured"):
        record(data_frames(500, rate=3200.0))


def test_a_sensor_below_2_khz_is_warned_about(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        found = record(data_frames(500, rate=1600.0), dataclasses.replace(CONFIG, nominal_rate=1600.0))
    assert "1600 samples/s" in found.warnings[0]
    assert "1600 samples/s" in caplog.text


def test_a_restart_and_a_handful_of_frames_name_the_sensor() -> None:
    with pytest.raises(CounterRestarted, match=r"X1 \(frame 0x305\)"):
        record(data_frames(100, first=9000) + data_frames(100, start=20.0))
    with pytest.raises(SamplesMissing, match=r"X1 \(frame 0x305\): 4 frames"):
        record(data_frames(4))


OTHER_DBC = """VERSION ""
NS_ :
BS_:
BU_: S
BO_ 256 Vib: 6 S
 SG_ Seq : 7|8@0+ (1,0) [0|255] "" S
 SG_ AccX : 15|20@0- (0.0001,0) [-1|1] "g" S
 SG_ AccY : 27|20@0- (0.0001,0) [-1|1] "g" S
"""


def test_another_sensor_is_another_dbc_and_role_map(tmp_path: Path) -> None:
    dbc = tmp_path / "other.dbc"
    dbc.write_text(OTHER_DBC)
    roles = RoleMap(data_message="Vib", samples=("AccY",), counter="Seq", time_message=None)
    config = AccelerometerConfig("X1", 0x100, None, nominal_rate=2000.0, to_si=9.80665, dbc=dbc, roles=roles)
    frames = [
        (
            k / 2000.0,
            0x100,
            bytes([k % 256, 0, 0, *(((-k) & 0xFFFFF) >> s & 0xFF for s in (16,))])
            + struct.pack(">H", -k & 0xFFFF),
        )
        for k in range(600)
    ]
    found = record(frames, config)
    assert found.timebase.rate == pytest.approx(2000.0)
    assert found.acceleration.value == pytest.approx(-np.arange(600) * 0.0001 * 9.80665)
