"""Signals of a DBC message as numpy bit slices: cantools' values at a hundredth of its cost per frame."""

from __future__ import annotations

import importlib.resources
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from cantools.database.can import Database, Message, Signal
from numpy.typing import NDArray

from drivers.trace import ByteArray, FloatArray


@dataclass(frozen=True)
class SignalSlice:
    """Where a signal lies in an 8-byte payload and what its counts mean.

    Attributes
    ----------
    big_endian : Motorola byte order
    shift : how far the signal lies above bit 0 of the payload read as one 64-bit number
    length : in bits
    signed : two's complement
    scale, offset : physical value = counts * scale + offset, in the DBC's unit
    choices : named counts (VAL_), by name
    """

    big_endian: bool
    shift: int
    length: int
    signed: bool
    scale: float
    offset: float
    choices: Mapping[str, int]

    def raw(self, payload: ByteArray) -> NDArray[np.int64]:
        """Counts of the signal in payloads of shape (n, 8); shape (n,)."""
        word = np.ascontiguousarray(payload).view(">u8" if self.big_endian else "<u8")[:, 0].astype(np.uint64)
        left = np.uint64(64 - self.length - self.shift)
        right = np.uint64(64 - self.length)
        shifted = word << left
        if self.signed:
            return shifted.view(np.int64) >> np.int64(right)
        return (shifted >> right).astype(np.int64)

    def physical(self, payload: ByteArray) -> FloatArray:
        """Values in the DBC's unit; shape (n,)."""
        return self.raw(payload).astype(np.float64) * self.scale + self.offset


def slice_of(signal: Signal) -> SignalSlice:
    """The bit slice of a cantools signal in a frame of up to 8 bytes."""
    big_endian = signal.byte_order == "big_endian"
    if big_endian:
        most_significant = 8 * (signal.start // 8) + (7 - signal.start % 8)
        shift = 64 - most_significant - signal.length
    else:
        shift = signal.start
    if signal.is_float or shift < 0 or shift + signal.length > 64:
        raise ValueError(f"signal {signal.name} is a float or does not fit into 8 bytes")
    choices = {str(name): int(value) for value, name in (signal.choices or {}).items()}
    return SignalSlice(
        big_endian, shift, signal.length, signal.is_signed, float(signal.scale), float(signal.offset), choices
    )


def slices_of(message: Message) -> dict[str, SignalSlice]:
    """The bit slices of all signals of a message, by name."""
    return {signal.name: slice_of(signal) for signal in message.signals}


def load_dbc(path: Path | None = None) -> Database:
    """A DBC file; the default accelerometer's without a path."""
    source = path or importlib.resources.files("drivers") / "accelerometer.dbc"
    database = Database()
    database.add_dbc_string(source.read_text(encoding="cp1252"))
    return database
