"""Error frames of SocketCAN in words (linux/can/error.h): without them a bus that is off looks healthy."""

from __future__ import annotations

from enum import Enum

ERROR_FLAG = 0x2000_0000
REMOTE_FLAG = 0x4000_0000
EXTENDED_FLAG = 0x8000_0000

_CONTROLLER, _NO_ACKNOWLEDGE, _BUS_OFF, _RESTARTED = 0x004, 0x020, 0x040, 0x100
_OVERFLOW, _WARNING, _PASSIVE, _ACTIVE = 0x03, 0x0C, 0x30, 0x40
_CLASSES = {
    0x001: "transmit timeout",
    0x002: "lost arbitration",
    0x004: "controller",
    0x008: "protocol violation",
    0x010: "transceiver",
    0x020: "no acknowledge: no other node listens",
    0x040: "bus off",
    0x080: "bus error",
    0x100: "controller restarted",
}


class BusState(Enum):
    """State of the CAN controller by its error counters: below 96, from 96, from 128, from 256."""

    ACTIVE = "error active"
    WARNING = "error warning"
    PASSIVE = "error passive"
    OFF = "bus off"


def state_after(state: BusState, can_id: int, data: bytes) -> BusState:
    """The controller's state once this error frame has been seen."""
    if can_id & _BUS_OFF:
        return BusState.OFF
    if can_id & _RESTARTED:
        return BusState.ACTIVE
    if not can_id & _CONTROLLER or len(data) < 2:
        return state
    if data[1] & _PASSIVE:
        return BusState.PASSIVE
    if data[1] & _WARNING:
        return BusState.WARNING
    return BusState.ACTIVE if data[1] & _ACTIVE else state


def describe(can_id: int, data: bytes) -> str:
    """One line for the log."""
    words = [text for bit, text in _CLASSES.items() if can_id & bit]
    if can_id & _CONTROLLER and len(data) > 1 and data[1] & _OVERFLOW:
        words.append("buffer overflow")
    return ", ".join(words) or f"unknown error class 0x{can_id & 0x1FFFFFFF:08X}"
