"""The SDO server of one simulated drive (CiA 301, 7.2.4.3): expedited and segmented, no block transfer."""

from __future__ import annotations

from collections.abc import Callable

from drivers.sim.dictionary import Key, SdoAbort

TOGGLE_NOT_ALTERNATED = 0x0503_0000
UNKNOWN_COMMAND = 0x0504_0001

_TOGGLE = 0x10
_LAST_SEGMENT = 0x01


def is_upload(data: bytes) -> bool:
    """Whether a request only reads: upload or upload segment."""
    return len(data) == 8 and data[0] >> 5 in (2, 3)


class SdoServer:
    """Answers one request frame with at most one response frame, through ``read`` and ``write``."""

    def __init__(self, read: Callable[[Key], bytes], write: Callable[[Key, bytes], None]) -> None:
        self._read, self._write = read, write
        self._key: Key = (0, 0)
        self._buffer = b""
        self._toggle = 0

    def respond(self, request: bytes) -> bytes | None:
        """The response to a request; None where the protocol has none (an abort, a frame cut short)."""
        if len(request) != 8 or request[0] >> 5 == 4:
            return None
        try:
            return self._dispatch(request)
        except SdoAbort as abort:
            return b"\x80" + _pack(self._key) + abort.code.to_bytes(4, "little")

    def _dispatch(self, request: bytes) -> bytes:
        command = request[0] >> 5
        if command in (1, 2):
            self._key = (int.from_bytes(request[1:3], "little"), request[3])
            return self._initiate_download(request) if command == 1 else self._initiate_upload()
        if command in (0, 3):
            if request[0] & _TOGGLE != self._toggle:
                raise SdoAbort(TOGGLE_NOT_ALTERNATED)
            self._toggle ^= _TOGGLE
            return self._download_segment(request) if command == 0 else self._upload_segment(request)
        raise SdoAbort(UNKNOWN_COMMAND)

    def _initiate_download(self, request: bytes) -> bytes:
        self._buffer, self._toggle = b"", 0
        if request[0] & 0x02:
            unused = request[0] >> 2 & 0x03 if request[0] & 0x01 else 0
            self._write(self._key, request[4 : 8 - unused])
        return b"\x60" + _pack(self._key) + bytes(4)

    def _download_segment(self, request: bytes) -> bytes:
        unused = request[0] >> 1 & 0x07
        self._buffer += request[1 : 8 - unused]
        if request[0] & _LAST_SEGMENT:
            self._write(self._key, self._buffer)
        return bytes([0x20 | request[0] & _TOGGLE]) + bytes(7)

    def _initiate_upload(self) -> bytes:
        data = self._read(self._key)
        self._buffer, self._toggle = data, 0
        if len(data) <= 4:
            return bytes([0x43 | 4 - len(data) << 2]) + _pack(self._key) + data.ljust(4, b"\0")
        return b"\x41" + _pack(self._key) + len(data).to_bytes(4, "little")

    def _upload_segment(self, request: bytes) -> bytes:
        chunk, self._buffer = self._buffer[:7], self._buffer[7:]
        head = request[0] & _TOGGLE | 7 - len(chunk) << 1 | (0 if self._buffer else _LAST_SEGMENT)
        return bytes([head]) + chunk.ljust(7, b"\0")


def _pack(key: Key) -> bytes:
    return key[0].to_bytes(2, "little") + bytes([key[1]])
