"""What was on the buses, as a BLF file: the tools of the trade (CANalyzer, python-can, SavvyCAN) open it.

About 10 bytes per frame: a run of the demo's machine leaves 0.6 MB (5 s, 58,000 frames of a gantry's drives and
three accelerometers), two groups every night for a year 0.4 GB. So nothing is ever deleted.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import can
import numpy as np

from drivers.errorframes import ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG
from drivers.trace import Frames, Recorder

_ID = 0x1FFF_FFFF


def blf(recorders: Sequence[Recorder]) -> bytes:
    """A BLF file of what the recorders hold, one channel each, numbered from 0 as python-can reads it back.

    Times keep their distances to a microsecond; a simulated machine's time begins at the first frame.
    What we sent ourselves is marked as sent, with the time of the last frame received before it.
    """
    messages = [
        message for channel, recorder in enumerate(recorders) for message in _messages(recorder, channel)
    ]
    messages.sort(key=lambda message: message.timestamp)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "bus.blf")
        with can.BLFWriter(path) as writer:
            for message in messages:
                writer.on_message_received(message)
        return path.read_bytes()


def _messages(recorder: Recorder, channel: int) -> Iterator[can.Message]:
    received, sent = recorder.frames(), recorder.sent()
    began = received.time.min() if len(received) else 0.0
    yield from _decoded(received, began, channel, is_rx=True)
    yield from _decoded(sent, began, channel, is_rx=False)


def _decoded(frames: Frames, began: float, channel: int, *, is_rx: bool) -> Iterator[can.Message]:
    times = np.maximum(frames.time, began).tolist()
    lengths = frames.table["length"].tolist()
    for time, can_id, length, data in zip(
        times, frames.can_id.tolist(), lengths, frames.payload, strict=True
    ):
        yield can.Message(
            timestamp=time,
            arbitration_id=can_id & _ID,
            is_extended_id=bool(can_id & EXTENDED_FLAG),
            is_remote_frame=bool(can_id & REMOTE_FLAG),
            is_error_frame=bool(can_id & ERROR_FLAG),
            is_rx=is_rx,
            channel=channel,
            data=b"" if can_id & REMOTE_FLAG else data[:length].tobytes(),
            dlc=length,
        )
