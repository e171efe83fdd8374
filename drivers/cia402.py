"""The state machine of a drive by CiA 402 (IEC 61800-7-201): states, controlwords, statuswords, transitions.

canopen's own profile class is not used: it can drop controlwords, quick stop included, without a word. Here a
controlword is always sent, by ``drive.py``, and the statusword is the only proof that it arrived.

::

                     ┌───────────── fault (13) ──────────────┐
    NOT_READY ─0,1→ SWITCH_ON_DISABLED ←─15─ FAULT ←─14─ FAULT_REACTION
                     2↓  ↑7,9,10,12
                    READY ←─6,8─┐
                     3↓  ↑6     │
                    SWITCHED_ON │
                     4↓  ↑5     │
                    ENABLED ────┘ ─11→ QUICK_STOP ─12→ SWITCH_ON_DISABLED
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import Enum, IntEnum, IntFlag

from drivers.errors import UnknownStatusword


class State(Enum):
    """The states of the power drive system: (mask, value) of the statusword."""

    NOT_READY = (0x4F, 0x00)
    SWITCH_ON_DISABLED = (0x4F, 0x40)
    READY = (0x6F, 0x21)
    SWITCHED_ON = (0x6F, 0x23)
    ENABLED = (0x6F, 0x27)
    QUICK_STOP = (0x6F, 0x07)
    FAULT_REACTION = (0x4F, 0x0F)
    FAULT = (0x4F, 0x08)

    def __str__(self) -> str:
        return self.name.lower().replace("_", " ")


class Command(IntEnum):
    """Commands to the state machine as controlwords, the mode's own bits being zero."""

    DISABLE_VOLTAGE = 0x00
    QUICK_STOP = 0x02
    SHUTDOWN = 0x06
    SWITCH_ON = 0x07
    DISABLE_OPERATION = 0x07
    ENABLE = 0x0F
    FAULT_RESET = 0x80


class Control(IntFlag):
    """Bits of the controlword in profile position mode."""

    NEW_SET_POINT = 1 << 4
    CHANGE_AT_ONCE = 1 << 5
    RELATIVE = 1 << 6
    HALT = 1 << 8


class Status(IntFlag):
    """Bits of the statusword beside the state, in profile position mode."""

    VOLTAGE_ENABLED = 1 << 4
    WARNING = 1 << 7
    REMOTE = 1 << 9
    TARGET_REACHED = 1 << 10
    INTERNAL_LIMIT = 1 << 11
    SET_POINT_ACKNOWLEDGE = 1 << 12
    FOLLOWING_ERROR = 1 << 13


def state_of(statusword: int) -> State:
    """State that a statusword tells; UnknownStatusword for the bit patterns that the standard leaves out."""
    for state in State:
        mask, value = state.value
        if statusword & mask == value:
            return state
    raise UnknownStatusword(f"statusword 0x{statusword:04X} is none of CiA 402")


TRANSITIONS: dict[tuple[State, Command], State] = {
    (State.SWITCH_ON_DISABLED, Command.SHUTDOWN): State.READY,
    (State.READY, Command.SWITCH_ON): State.SWITCHED_ON,
    (State.READY, Command.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.READY, Command.QUICK_STOP): State.SWITCH_ON_DISABLED,
    (State.SWITCHED_ON, Command.ENABLE): State.ENABLED,
    (State.SWITCHED_ON, Command.SHUTDOWN): State.READY,
    (State.SWITCHED_ON, Command.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.SWITCHED_ON, Command.QUICK_STOP): State.SWITCH_ON_DISABLED,
    (State.ENABLED, Command.SWITCH_ON): State.SWITCHED_ON,
    (State.ENABLED, Command.SHUTDOWN): State.READY,
    (State.ENABLED, Command.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.ENABLED, Command.QUICK_STOP): State.QUICK_STOP,
    (State.QUICK_STOP, Command.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.FAULT, Command.FAULT_RESET): State.SWITCH_ON_DISABLED,
}
"""Which command leads from which state to which; commands of other pairs change nothing."""

_TOWARDS_ENABLED: dict[State, Command] = {
    State.SWITCH_ON_DISABLED: Command.SHUTDOWN,
    State.READY: Command.SWITCH_ON,
    State.SWITCHED_ON: Command.ENABLE,
    State.QUICK_STOP: Command.DISABLE_VOLTAGE,
}


def next_towards_enabled(state: State) -> Command | None:
    """The command that leads one state nearer to *operation enabled*; None where only waiting helps."""
    return _TOWARDS_ENABLED.get(state)


def powered(state: State) -> bool:
    """Whether the drive may put torque on the motor in this state."""
    return state in (State.ENABLED, State.QUICK_STOP, State.FAULT_REACTION)


def position_controlword(*, new_set_point: bool, relative: bool) -> int:
    """Controlword of *operation enabled* for the set-point handshake of profile position mode."""
    word = int(Command.ENABLE)
    if new_set_point:
        word |= Control.NEW_SET_POINT
    if relative:
        word |= Control.RELATIVE
    return word


_RPDO = struct.Struct("<Hi")
_TPDO = struct.Struct("<ihH")
_EMCY = struct.Struct("<HB")


@dataclass(frozen=True)
class ProcessData:
    """TPDO1 in the drive's own units: velocity and torque actual value, statusword."""

    velocity: int
    torque: int
    statusword: int


def encode_rpdo(controlword: int, target: int) -> bytes:
    """RPDO1: 0x6040 and 0x607A."""
    return _RPDO.pack(controlword, target)


def decode_tpdo(data: bytes) -> ProcessData:
    """TPDO1: 0x606C, 0x6077, 0x6041."""
    return ProcessData(*_TPDO.unpack(data))


def decode_emcy(data: bytes) -> tuple[int, int]:
    """EMCY: error code and error register; code 0x00xx means that the error is gone."""
    code, register = _EMCY.unpack_from(data)
    return code, register


_ERRORS = {
    0x2310: "continuous over-current",
    0x2320: "short circuit or earth leakage",
    0x3110: "mains over-voltage",
    0x3120: "mains under-voltage",
    0x3130: "mains phase failure",
    0x3210: "DC link over-voltage (braking resistor?)",
    0x3220: "DC link under-voltage (mains off?)",
    0x4210: "drive too hot",
    0x4310: "drive too hot",
    0x4410: "motor too hot",
    0x5441: "emergency stop or enable input opened",
    0x7121: "motor blocked",
    0x7305: "incremental encoder 1 faulty",
    0x7380: "position sensor faulty",
    0x8110: "CAN overrun: frames were lost in the drive",
    0x8120: "CAN error passive",
    0x8130: "heartbeat of the master missing",
    0x8140: "recovered from bus-off",
    0x8180: "SYNC or RPDO missing",
    0x8250: "RPDO timed out",
    0x8611: "following error: the axis did not follow its set-point",
    0x8612: "reference or position limit",
}
_GROUPS = {
    0x1: "generic error",
    0x2: "current",
    0x3: "voltage",
    0x4: "temperature",
    0x5: "device hardware, supply or enable inputs",
    0x6: "device software or parameters",
    0x7: "additional modules, encoder, brake or motor",
    0x8: "monitoring: communication or following error",
    0x9: "external error",
    0xF: "additional functions or vendor specific",
}


def error_text(code: int) -> str:
    """What an error code of EMCY or 0x603F means by CiA 301 and CiA 402."""
    return _ERRORS.get(code) or _GROUPS.get(code >> 12, "unknown error")
