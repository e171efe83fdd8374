"""The object dictionary of one simulated drive: what the EDS lists, with the access rules of CiA 301."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from canopen.objectdictionary import import_od

Key = tuple[int, int]
"""Index and sub-index."""

NO_OBJECT = 0x0602_0000
NO_SUBINDEX = 0x0609_0011
WRITE_ONLY = 0x0601_0001
READ_ONLY = 0x0601_0002
WRONG_LENGTH = 0x0607_0010
OUT_OF_RANGE = 0x0609_0030
NOT_IN_THIS_STATE = 0x0800_0022
NOT_MAPPABLE = 0x0604_0041
MAPPING_TOO_LONG = 0x0604_0042

_SIZE_AND_SIGN = {
    1: (1, False),
    2: (1, True),
    3: (2, True),
    4: (4, True),
    5: (1, False),
    6: (2, False),
    7: (4, False),
}
"""Bytes and signedness of the integer data types 0x0001-0x0007 of CiA 301."""


class SdoAbort(Exception):
    """An SDO transfer ends here, with the abort code of CiA 301."""

    def __init__(self, code: int) -> None:
        super().__init__(f"abort code 0x{code:08X}")
        self.code = code


@dataclass(frozen=True)
class Entry:
    """One object: its size [bytes], sign, access, default, and whether a PDO may carry it."""

    size: int
    signed: bool
    readable: bool
    writable: bool
    mappable: bool
    default: int


class Dictionary:
    """Values by (index, sub-index); ``values`` is the device's own way in, ``read`` and ``write`` the SDO's."""

    def __init__(self, eds: Path, node_id: int) -> None:
        self.entries = _entries(import_od(str(eds), node_id))
        self.values = {key: entry.default for key, entry in self.entries.items()}

    def restore(self, communication_only: bool) -> None:
        """Back to the defaults of the EDS: all objects, or 0x1000-0x1FFF."""
        for key, entry in self.entries.items():
            if not communication_only or 0x1000 <= key[0] < 0x2000:
                self.values[key] = entry.default

    def read(self, key: Key) -> bytes:
        """An object as it travels. Raises SdoAbort."""
        entry = self._entry(key)
        if not entry.readable:
            raise SdoAbort(WRITE_ONLY)
        return self.encode(key)

    def decode(self, key: Key, data: bytes) -> int:
        """The value that a write of ``data`` means. Raises SdoAbort where the object cannot take it."""
        entry = self._entry(key)
        if not entry.writable:
            raise SdoAbort(READ_ONLY)
        if len(data) != entry.size:
            raise SdoAbort(WRONG_LENGTH)
        return int.from_bytes(data, "little", signed=entry.signed)

    def encode(self, key: Key) -> bytes:
        entry = self.entries[key]
        return self.values[key].to_bytes(entry.size, "little", signed=entry.signed)

    def _entry(self, key: Key) -> Entry:
        if key not in self.entries:
            known = any(index == key[0] for index, _ in self.entries)
            raise SdoAbort(NO_SUBINDEX if known else NO_OBJECT)
        return self.entries[key]


def _entries(od: Any) -> dict[Key, Entry]:
    variables = (
        v for item in od.values() for v in (item.values() if hasattr(item, "subindices") else [item])
    )
    return {(v.index, v.subindex): _entry(v) for v in variables}


def _entry(variable: Any) -> Entry:
    size, signed = _SIZE_AND_SIGN[variable.data_type]
    return Entry(
        size, signed, variable.readable, variable.writable, variable.pdo_mappable, int(variable.default or 0)
    )
