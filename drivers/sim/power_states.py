"""The power state machine of CiA 402-2 as the device runs it: states, and what a controlword makes of them."""

from __future__ import annotations

from enum import Enum

FAULT_RESET = 1 << 7


class State(Enum):
    """States of the power stage; the value is what the statusword shows in bits 0-3, 5 and 6."""

    SWITCH_ON_DISABLED = 0x40
    READY_TO_SWITCH_ON = 0x21
    SWITCHED_ON = 0x23
    OPERATION_ENABLED = 0x27
    QUICK_STOP_ACTIVE = 0x07
    FAULT_REACTION_ACTIVE = 0x0F
    FAULT = 0x08

    @property
    def powered(self) -> bool:
        """Whether the motor carries torque."""
        return self in (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE, State.FAULT_REACTION_ACTIVE)


_SHUTDOWN = (0x87, 0x06)
_SWITCH_ON = (0x8F, 0x07)
_ENABLE_OPERATION = (0x8F, 0x0F)
_DISABLE_VOLTAGE = (0x82, 0x00)
_QUICK_STOP = (0x86, 0x02)

_TRANSITIONS: dict[State, dict[tuple[int, int], State]] = {
    State.SWITCH_ON_DISABLED: {_SHUTDOWN: State.READY_TO_SWITCH_ON},
    State.READY_TO_SWITCH_ON: {
        _DISABLE_VOLTAGE: State.SWITCH_ON_DISABLED,
        _QUICK_STOP: State.SWITCH_ON_DISABLED,
        _SWITCH_ON: State.SWITCHED_ON,
        # the standard lets a drive pass through Switched on by itself
        _ENABLE_OPERATION: State.OPERATION_ENABLED,
    },
    State.SWITCHED_ON: {
        _DISABLE_VOLTAGE: State.SWITCH_ON_DISABLED,
        _QUICK_STOP: State.SWITCH_ON_DISABLED,
        _SHUTDOWN: State.READY_TO_SWITCH_ON,
        _ENABLE_OPERATION: State.OPERATION_ENABLED,
    },
    State.OPERATION_ENABLED: {
        _DISABLE_VOLTAGE: State.SWITCH_ON_DISABLED,
        _QUICK_STOP: State.QUICK_STOP_ACTIVE,
        _SHUTDOWN: State.READY_TO_SWITCH_ON,
        _SWITCH_ON: State.SWITCHED_ON,
    },
    State.QUICK_STOP_ACTIVE: {
        _DISABLE_VOLTAGE: State.SWITCH_ON_DISABLED,
        _ENABLE_OPERATION: State.OPERATION_ENABLED,
    },
    State.FAULT_REACTION_ACTIVE: {},
    State.FAULT: {},
}


def after_controlword(state: State, controlword: int, previous: int, quick_stop_option: int) -> State:
    """The state that a controlword leads to; a fault is left only by a rising edge of bit 7.

    Out of Quick stop active the way back (transition 16) is open only where 0x605A says to stay there.
    """
    if state is State.FAULT:
        rising = controlword & FAULT_RESET and not previous & FAULT_RESET
        return State.SWITCH_ON_DISABLED if rising else state
    for (mask, pattern), target in _TRANSITIONS[state].items():
        if controlword & mask == pattern:
            back = state is State.QUICK_STOP_ACTIVE and target is State.OPERATION_ENABLED
            return state if back and quick_stop_option < 5 else target
    return state
