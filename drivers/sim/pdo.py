"""PDOs from the device's side: the mapping that the master wrote, packed and unpacked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.sim.dictionary import (
    MAPPING_TOO_LONG,
    NOT_IN_THIS_STATE,
    NOT_MAPPABLE,
    OUT_OF_RANGE,
    Dictionary,
    Key,
    SdoAbort,
)

INVALID = 1 << 31
_COB_ID = 0x7FF


class Pdo:
    """One PDO of the dictionary: communication parameter 0x1400/0x1800 + k, mapping 0x1600/0x1A00 + k."""

    def __init__(self, dictionary: Dictionary, communication: int) -> None:
        self._dictionary = dictionary
        self.communication = communication
        self.mapping = communication + 0x200

    @property
    def valid(self) -> bool:
        return not self._dictionary.values[self.communication, 1] & INVALID

    @property
    def cob_id(self) -> int:
        return self._dictionary.values[self.communication, 1] & _COB_ID

    @property
    def transmission_type(self) -> int:
        return self._dictionary.values[self.communication, 2]

    @property
    def mapped(self) -> list[Key]:
        values = self._dictionary.values
        return [_target(values[self.mapping, sub + 1])[0] for sub in range(values[self.mapping, 0])]

    def check(self, key: Key, value: int) -> None:
        """Refuse a write that the standard forbids: mapping a PDO that is valid, or what cannot be mapped."""
        index, sub = key
        if index == self.communication and sub == 1:
            changes = (value ^ self._dictionary.values[key]) & _COB_ID
            if changes and not value & INVALID and self.valid:
                raise SdoAbort(NOT_IN_THIS_STATE)
        if index == self.mapping:
            self._check_mapping(sub, value)

    def _check_mapping(self, sub: int, value: int) -> None:
        values = self._dictionary.values
        if self.valid or (sub and values[self.mapping, 0]):
            raise SdoAbort(NOT_IN_THIS_STATE)
        if sub:
            self._check_target(value)
        elif value > 8:
            raise SdoAbort(OUT_OF_RANGE)
        elif sum(_target(values[self.mapping, k + 1])[1] for k in range(value)) > 64:
            raise SdoAbort(MAPPING_TOO_LONG)

    def _check_target(self, value: int) -> None:
        target, bits = _target(value)
        entry = self._dictionary.entries.get(target)
        if value and (entry is None or not entry.mappable or bits != entry.size * 8):
            raise SdoAbort(NOT_MAPPABLE)

    def unpack(self, data: bytes) -> dict[Key, int]:
        """The values that an RPDO carries; bytes beyond the mapping are ignored, too few void the frame."""
        found, position = {}, 0
        for key in self.mapped:
            entry = self._dictionary.entries[key]
            chunk = data[position : position + entry.size]
            if len(chunk) < entry.size:
                return {}
            found[key] = int.from_bytes(chunk, "little", signed=entry.signed)
            position += entry.size
        return found

    def pack(self, count: int, signals: Mapping[int, NDArray[np.int64]]) -> tuple[bytes, int]:
        """Payloads of ``count`` TPDOs in a row, and the bytes of each.

        ``signals`` are the objects that change within a block, (count,), by index; others are constant.
        """
        keys = self.mapped
        rows = np.empty(count, dtype=[(f"f{n}", self._type(key)) for n, key in enumerate(keys)])
        for n, key in enumerate(keys):
            rows[f"f{n}"] = signals.get(key[0], self._dictionary.values[key])
        return rows.tobytes(), rows.dtype.itemsize

    def _type(self, key: Key) -> Any:
        entry = self._dictionary.entries[key]
        return f"<{'i' if entry.signed else 'u'}{entry.size}"


def _target(entry: int) -> tuple[Key, int]:
    """Object and length [bit] that a mapping entry names."""
    return (entry >> 16, entry >> 8 & 0xFF), entry & 0xFF
