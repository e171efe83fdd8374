"""TPDOs to samples: literal bytes, and every way in which SYNC and TPDO can get lost."""

from __future__ import annotations

import dataclasses
import struct

import numpy as np
import pytest

from drivers.commissioning import DriveConfig
from drivers.drivetraces import DriveRecord, decode
from drivers.errors import SamplesMissing
from drivers.trace import Frame, Recorder

CONFIG = DriveConfig("X1", 5, speed_lsb_rad_s=0.01)


def frames(count: int, drop: set[str] = frozenset()) -> list[Frame]:  # type: ignore[assignment]
    """SYNC k at 100 + k ms and the TPDO of sample k; `drop` names the lost ones: "S3", "T3"."""
    found: list[Frame] = []
    for k in range(count):
        at = 100.0 + k * 1e-3
        if f"S{k}" not in drop:
            found.append((at, 0x80, bytes([k % 240 + 1])))
        if f"T{k}" not in drop:
            found.append((at + 2e-4, 0x185, struct.pack("<ihH", k, -k % 1000, 0x1637)))
    return found


def record(some: list[Frame], config: DriveConfig = CONFIG) -> DriveRecord:
    recorder = Recorder()
    recorder.append(some)
    return decode(recorder.frames(), config, rated_torque=4.0)


def test_a_tpdo_by_its_bytes() -> None:
    some = frames(32, {f"T{k}" for k in range(32)} - {"T3"})
    at = next(i for i, f in enumerate(some) if f[1] == 0x185)
    some[at] = (some[at][0], 0x185, bytes.fromhex("9CFFFFFF E803 3706"))
    found = record(some)
    assert found.speed.value == pytest.approx([-1.0])
    assert found.torque.value == pytest.approx([4.0])
    assert found.statusword.value.tolist() == [0x0637]
    assert found.speed.time == pytest.approx([100.003])


def test_an_inverted_axis() -> None:
    found = record(frames(100), dataclasses.replace(CONFIG, direction=-1))
    assert found.speed.value == pytest.approx(-0.01 * np.arange(100))


def assert_right(found: DriveRecord, count: int, missing: set[int]) -> None:
    """Sample k reads k counts and was taken at 100 + k ms; exactly `missing` are absent."""
    k = np.array(sorted(set(range(count)) - missing))
    assert found.speed.value == pytest.approx(0.01 * k)
    assert found.speed.time == pytest.approx(100.0 + 1e-3 * k, abs=1e-6)
    assert found.lost == len(missing)


def test_all_frames_there() -> None:
    assert_right(record(frames(1000)), 1000, set())


def test_a_lost_tpdo_is_a_lost_sample() -> None:
    assert_right(record(frames(1000, {"T400", "T401", "T700"})), 1000, {400, 401, 700})


def test_a_lost_sync_costs_nothing_while_its_tpdo_arrived() -> None:
    assert_right(record(frames(1000, {"S400", "S600", "S601"})), 1000, set())


def test_what_cannot_be_told_apart_is_lost() -> None:
    # Between SYNC 399 and 401 one TPDO: of 399 or of 400?
    assert_right(record(frames(1000, {"S400", "T400"})), 1000, {399, 400})


def test_a_late_tpdo_is_no_sample_of_the_next_sync() -> None:
    some = frames(1000)
    at = some.index(next(f for f in some if f[1] == 0x185 and f[2][:4] == struct.pack("<i", 500)))
    some[at], some[at + 1] = some[at + 1], some[at]
    assert_right(record(some), 1000, {500, 501})


def test_random_losses_never_shift_a_sample() -> None:
    rng = np.random.default_rng(11)
    drop = {f"{kind}{k}" for kind in "ST" for k in range(2, 4998) if rng.random() < 0.05}
    found = record(frames(5000, drop))
    k = np.rint(found.speed.value / 0.01)
    assert found.speed.time == pytest.approx(100.0 + 1e-3 * k, abs=1e-6)
    lost_for_sure = sum(1 for name in drop if name.startswith("T"))
    assert lost_for_sure <= found.lost <= 2.2 * lost_for_sure


def test_tpdos_of_other_drives_and_short_ones_are_not_ours() -> None:
    other = [(at + 3e-4, 0x186, data) for at, can_id, data in frames(50) if can_id == 0x185]
    short = [(at + 3e-4, 0x185, data[:6]) for at, can_id, data in frames(50) if can_id == 0x185]
    merged = sorted(frames(50) + other + short, key=lambda f: f[0])
    assert_right(record(merged), 50, set())


def test_no_tpdo_at_all() -> None:
    with pytest.raises(SamplesMissing, match=r"X1 \(node 5\): no TPDO1 between 50 SYNCs"):
        record(frames(50, {f"T{k}" for k in range(50)}))


def test_what_a_late_frame_says_happened_when_its_sample_was_taken() -> None:
    """A PC that falls behind by 0.1 s and catches up again reads no frame much later than the one before."""
    taken = np.arange(0.0, 2.0, 1e-3)
    late = np.interp(taken, [0.9, 1.0, 1.05, 1.15], [0.0, 0.1, 0.1, 0.0])
    some = [(at + np.interp(at - 100.0, taken, late), can_id, data) for at, can_id, data in frames(2000)]
    found = record(some)
    assert found.speed.time == pytest.approx(100.0 + taken, abs=1e-6)
    assert found.sampled(101.02 + 0.1 + 2e-4) == pytest.approx(101.02, abs=1e-6)
    assert found.sampled(100.5 + 2e-4) == pytest.approx(100.5, abs=1e-6)
