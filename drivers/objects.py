"""A drive's object dictionary over SDO: read, and write with reading back, every failure named.

A write that is not read back is a hope. canopen's SDO client is not thread-safe and must not be called from
the receive loop; the lock here keeps callers apart.
"""

from __future__ import annotations

import contextlib
import importlib.resources
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import canopen

from drivers.bus import Bus
from drivers.errors import NodeSilent, ObjectRefused

SDO_TIMEOUT = 1.0
"""Longest wait for one answer [s]. Chosen: a drive answers in some ms, a busy PC in some tens."""

_PROFILE = 0x6000
"""From here on the objects of the device profile; those below are reset by the next master's NMT commands."""

Result = TypeVar("Result")


def load_dictionary(node_id: int, eds: Path | None = None) -> canopen.ObjectDictionary:
    """The object dictionary of an EDS file; of the generic drive that comes with this package without one."""
    if eds is not None:
        return canopen.import_od(str(eds), node_id=node_id)
    with importlib.resources.as_file(importlib.resources.files("drivers") / "drive.eds") as path:
        return canopen.import_od(str(path), node_id=node_id)


class Objects:
    """The objects of one node."""

    def __init__(self, bus: Bus, node_id: int, name: str, eds: Path | None = None) -> None:
        self.name = f"{name} (node {node_id})"
        self._bus = bus
        self._node_id = node_id
        self._node = canopen.RemoteNode(node_id, load_dictionary(node_id, eds))
        self._node.sdo.RESPONSE_TIMEOUT = SDO_TIMEOUT
        self._lock = threading.Lock()
        self._before: dict[tuple[int, int], int] = {}
        bus.network.add_node(self._node)

    def close(self) -> None:
        """Take the node off the bus' network; safe to call twice."""
        if self._bus.network.nodes.get(self._node_id) is self._node:
            del self._bus.network[self._node_id]

    def read(self, index: int, sub: int = 0, refused: type[ObjectRefused] = ObjectRefused) -> int:
        """Read an integer object; `refused` or NodeSilent when that fails."""
        variable = self._variable(index, sub, refused)

        def transfer() -> int:
            return int(variable.decode_raw(self._node.sdo.upload(index, sub)))

        return self._transfer(transfer, f"reading 0x{index:04X}:{sub:02X}", refused)

    def write(self, index: int, sub: int, value: int, refused: type[ObjectRefused] = ObjectRefused) -> None:
        """Write an integer object without reading it back; for what the drive changes by itself."""
        variable = self._variable(index, sub, refused)

        def transfer() -> None:
            self._node.sdo.download(index, sub, variable.encode_raw(value))

        self._transfer(transfer, f"writing {value} to 0x{index:04X}:{sub:02X}", refused)

    def confirm(self, index: int, sub: int, value: int, refused: type[ObjectRefused] = ObjectRefused) -> None:
        """Write an integer object and read it back; `refused` unless it reads as written.

        What an object of the drive's profile held before is kept for ``restore``.
        """
        if index >= _PROFILE and (index, sub) not in self._before:
            self._before[index, sub] = self.read(index, sub, refused)
        self.write(index, sub, value, refused)
        found = self.read(index, sub, refused)
        if found != value:
            raise refused(f"{self.name}: 0x{index:04X}:{sub:02X} reads {found} after {value} was written")

    def restore(self) -> None:
        """Write back what the profile's objects held before; those that the drive refuses stay as they are."""
        while self._before:
            (index, sub), value = self._before.popitem()
            with contextlib.suppress(ObjectRefused):
                self.write(index, sub, value)

    def _variable(self, index: int, sub: int, refused: type[ObjectRefused]) -> Any:
        variable = self._node.object_dictionary.get_variable(index, sub)
        if variable is None:
            raise refused(f"{self.name}: its EDS does not hold 0x{index:04X}:{sub:02X}")
        return variable

    def _transfer(self, transfer: Callable[[], Result], what: str, refused: type[ObjectRefused]) -> Result:
        self._bus.feed()
        try:
            with self._lock:
                return transfer()
        except canopen.SdoAbortedError as error:
            raise refused(f"{self.name}: {what} was aborted ({error})") from error
        except canopen.SdoCommunicationError as error:
            self._bus.check()
            raise NodeSilent(f"{self.name}: no answer to {what} ({error})") from error
        except canopen.ObjectDictionaryError as error:
            raise refused(f"{self.name}: {what} does not fit the object's type ({error})") from error
