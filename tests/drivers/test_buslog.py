"""The bus log read back by python-can's own reader."""

from __future__ import annotations

from pathlib import Path

import can
import numpy as np
import pytest

from drivers.bus import Bus, BusConfig
from drivers.buslog import blf
from drivers.errorframes import ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG
from drivers.trace import Frame, Recorder


def read_back(log: bytes, folder: Path) -> list[can.Message]:
    path = folder / "log.blf"
    path.write_bytes(log)
    with can.BLFReader(path) as reader:
        return list(reader)


def holding(*frames: Frame) -> Recorder:
    recorder = Recorder()
    recorder.append(frames)
    return recorder


def test_every_frame_comes_back_with_its_kind(tmp_path: Path) -> None:
    recorder = holding(
        (1.0, 0x181, bytes(range(8))),
        (2.0, 0x80, b"\x07"),
        (3.0, 0x18FF_0001 | EXTENDED_FLAG, b"\xff"),
        (4.0, 0x705 | REMOTE_FLAG, b""),
        (5.0, 0x40 | ERROR_FLAG, bytes(8)),
    )
    messages = read_back(blf([recorder]), tmp_path)
    assert [(m.arbitration_id, bytes(m.data)) for m in messages] == [
        (0x181, bytes(range(8))),
        (0x80, b"\x07"),
        (0x18FF_0001, b"\xff"),
        (0x705, b""),
        (0x40, bytes(8)),
    ]
    assert [m.is_extended_id for m in messages[:4]] == [False, False, True, False]
    assert [m.is_remote_frame for m in messages] == [False, False, False, True, False]
    assert [m.is_error_frame for m in messages] == [False, False, False, False, True]


@pytest.mark.parametrize("began", [0.0, 12.345678, 1_795_256_330.123456])
def test_times_keep_their_distances(tmp_path: Path, began: float) -> None:
    times = began + np.cumsum(np.random.default_rng(1).exponential(1e-3, 500))
    recorder = Recorder()
    recorder.append([(float(t), 0x300, b"") for t in times])
    found = np.array([m.timestamp for m in read_back(blf([recorder]), tmp_path)])
    np.testing.assert_allclose(np.diff(found), np.diff(times), rtol=0, atol=1e-6)
    if began > 1e9:
        np.testing.assert_allclose(found, times, rtol=0, atol=1e-6)


def test_buses_are_told_apart_and_in_order_of_time(tmp_path: Path) -> None:
    drives, sensors = (
        holding((1.0, 0x80, b""), (3.0, 0x80, b"")),
        holding((0.5, 0x300, b""), (2.0, 0x300, b"")),
    )
    messages = read_back(blf([drives, sensors]), tmp_path)
    assert [(m.channel, m.arbitration_id) for m in messages] == [(1, 0x300), (0, 0x80), (1, 0x300), (0, 0x80)]


def test_what_we_sent_is_in_it_and_marked(tmp_path: Path) -> None:
    config = BusConfig("virtual", "test_buslog", machine_time=True, master_node_id=None)
    with Bus(config) as bus, bus.recording() as recorder:
        bus.send(0x605, bytes(8))
        recorder.append([(7.0, 0x585, bytes(8))])
        bus.send(0x205, b"\x0f\x00")
    messages = read_back(blf([recorder]), tmp_path)
    assert [(m.arbitration_id, m.is_rx) for m in messages] == [(0x585, True), (0x605, False), (0x205, False)]
    assert len({m.timestamp for m in messages}) == 1
    assert bytes(messages[2].data) == b"\x0f\x00"


def test_a_frame_that_could_not_be_sent_is_not_in_it() -> None:
    class Deaf(can.BusABC):
        def __init__(self) -> None:
            super().__init__("deaf")

        def send(self, msg: can.Message, timeout: float | None = None) -> None:
            raise can.CanOperationError("no buffer space")

        def _recv_internal(self, timeout: float | None) -> tuple[None, bool]:
            return None, True

    config = BusConfig("virtual", "x", master_node_id=None)
    with Bus(config, lambda _: Deaf()) as bus, bus.recording() as recorder:
        with pytest.raises(Exception, match="could not be sent"):
            bus.send(0x1, b"")
        assert len(recorder.sent()) == 0


def test_nothing_heard_is_a_log_of_nothing(tmp_path: Path) -> None:
    assert read_back(blf([Recorder()]), tmp_path) == []
