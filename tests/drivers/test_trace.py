"""Recording: what goes in comes out, by id and by time."""

from __future__ import annotations

import numpy as np

from drivers.trace import Recorder, Trace


def recorded() -> Recorder:
    recorder = Recorder()
    recorder.append([(1.0, 0x80, b"\x01"), (1.1, 0x185, bytes(range(8)))])
    recorder.append([(1.3, 0x80, b"\x02"), (1.2, 0x301, b"")])
    return recorder


def test_frames_come_back_as_they_went_in() -> None:
    frames = recorded().frames()
    assert list(frames.time) == [1.0, 1.1, 1.3, 1.2]
    assert list(frames.can_id) == [0x80, 0x185, 0x80, 0x301]
    assert frames.payload[1].tolist() == [0, 1, 2, 3, 4, 5, 6, 7]
    assert frames.payload[0].tolist() == [1, 0, 0, 0, 0, 0, 0, 0]


def test_frames_of_one_id_and_of_a_time() -> None:
    frames = recorded().frames()
    assert frames.of(0x80).payload[:, 0].tolist() == [1, 2]
    assert len(frames.of(0x301)) == 1
    assert len(frames.of(0x301, length=1)) == 0
    assert list(frames.between(1.1, 1.3).time) == [1.1, 1.2]


def test_the_loop_goes_on_while_frames_are_looked_at() -> None:
    recorder = recorded()
    before = recorder.frames()
    recorder.append([(2.0, 0x80, b"\x03")])
    assert (len(before), len(recorder.frames()), len(recorder), recorder.latest) == (4, 5, 5, 2.0)


def test_an_empty_recorder() -> None:
    assert (len(Recorder().frames()), Recorder().latest) == (0, -np.inf)


def test_trace_cut_by_time() -> None:
    trace = Trace(np.array([0.0, 1.0, 2.0, 3.0]), np.array([5.0, 6.0, 7.0, 8.0]))
    assert trace.between(1.0, 3.0).value.tolist() == [6.0, 7.0]
