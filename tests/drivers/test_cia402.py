"""The state machine against the tables of the standard, written out here once more."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers import cia402
from drivers.cia402 import Command, ProcessData, State
from drivers.errors import UnknownStatusword

# CiA 402-2 table "State coding": x = do not care, bits 15 … 0.
CODING = {
    State.NOT_READY: "xxxx xxxx x0xx 0000",
    State.SWITCH_ON_DISABLED: "xxxx xxxx x1xx 0000",
    State.READY: "xxxx xxxx x01x 0001",
    State.SWITCHED_ON: "xxxx xxxx x01x 0011",
    State.ENABLED: "xxxx xxxx x01x 0111",
    State.QUICK_STOP: "xxxx xxxx x00x 0111",
    State.FAULT_REACTION: "xxxx xxxx x0xx 1111",
    State.FAULT: "xxxx xxxx x0xx 1000",
}

# Transitions 2 to 12 and 15 as the standard numbers them: from, controlword's bits 7, 3 … 0, to.
TRANSITIONS = {
    2: (State.SWITCH_ON_DISABLED, "0 x110", State.READY),
    3: (State.READY, "0 0111", State.SWITCHED_ON),
    4: (State.SWITCHED_ON, "0 1111", State.ENABLED),
    5: (State.ENABLED, "0 0111", State.SWITCHED_ON),
    6: (State.SWITCHED_ON, "0 x110", State.READY),
    7: (State.READY, "0 xx0x", State.SWITCH_ON_DISABLED),
    8: (State.ENABLED, "0 x110", State.READY),
    9: (State.ENABLED, "0 xx0x", State.SWITCH_ON_DISABLED),
    10: (State.SWITCHED_ON, "0 xx0x", State.SWITCH_ON_DISABLED),
    11: (State.ENABLED, "0 x01x", State.QUICK_STOP),
    12: (State.QUICK_STOP, "0 xx0x", State.SWITCH_ON_DISABLED),
    15: (State.FAULT, "1 xxxx", State.SWITCH_ON_DISABLED),
}


def bits_match(word: int, pattern: str, positions: list[int]) -> bool:
    return all(
        c == "x" or int(c) == word >> p & 1 for c, p in zip(pattern.replace(" ", ""), positions, strict=True)
    )


@given(st.integers(0, 0xFFFF))
def test_every_statusword_is_read_as_the_standard_codes_it(word: int) -> None:
    expected = [s for s, pattern in CODING.items() if bits_match(word, pattern, list(range(15, -1, -1)))]
    if expected:
        assert [cia402.state_of(word)] == expected
    else:
        with pytest.raises(UnknownStatusword, match=f"0x{word:04X}"):
            cia402.state_of(word)


@pytest.mark.parametrize(
    ("word", "state"),
    [
        (0x0250, State.SWITCH_ON_DISABLED),
        (0x0231, State.READY),
        (0x0233, State.SWITCHED_ON),
        (0x1637, State.ENABLED),
        (0x0217, State.QUICK_STOP),
        (0x021F, State.FAULT_REACTION),
        (0x0218, State.FAULT),
    ],
)
def test_statuswords_seen_on_drives(word: int, state: State) -> None:
    assert cia402.state_of(word) is state


@pytest.mark.parametrize("number", TRANSITIONS)
def test_each_transition_of_the_standard_has_its_command(number: int) -> None:
    start, pattern, goal = TRANSITIONS[number]
    matching = [
        command
        for (state, command), to in cia402.TRANSITIONS.items()
        if state is start and to is goal and bits_match(command, pattern, [7, 3, 2, 1, 0])
    ]
    assert matching


def test_no_transition_beyond_the_standard() -> None:
    known = {(start, goal) for start, _, goal in TRANSITIONS.values()}
    # A quick stop without a powered motor is "disable voltage" by the standard: transitions 7 and 10.
    assert {(start, goal) for (start, _), goal in cia402.TRANSITIONS.items()} <= known


@pytest.mark.parametrize(
    "start", [State.SWITCH_ON_DISABLED, State.READY, State.SWITCHED_ON, State.QUICK_STOP]
)
def test_the_way_to_enabled_ends_there(start: State) -> None:
    state = start
    for _ in range(4):
        command = cia402.next_towards_enabled(state)
        if command is None:
            break
        state = cia402.TRANSITIONS[state, command]
    assert state is State.ENABLED


@pytest.mark.parametrize("state", [State.FAULT, State.FAULT_REACTION, State.NOT_READY])
def test_a_fault_is_never_left_by_itself(state: State) -> None:
    assert cia402.next_towards_enabled(state) is None


def test_controlwords_by_their_bytes() -> None:
    target = -2
    assert cia402.encode_rpdo(Command.SHUTDOWN, 0) == bytes.fromhex("0600 00000000")
    assert cia402.encode_rpdo(Command.SWITCH_ON, 0) == bytes.fromhex("0700 00000000")
    assert cia402.encode_rpdo(Command.ENABLE, 0x01020304) == bytes.fromhex("0F00 04030201")
    assert cia402.encode_rpdo(Command.QUICK_STOP, target) == bytes.fromhex("0200 FEFFFFFF")
    assert cia402.encode_rpdo(Command.FAULT_RESET, 0) == bytes.fromhex("8000 00000000")
    absolute = cia402.position_controlword(new_set_point=True, relative=False)
    relative = cia402.position_controlword(new_set_point=True, relative=True)
    waiting = cia402.position_controlword(new_set_point=False, relative=True)
    assert (absolute, relative, waiting) == (0x1F, 0x5F, 0x4F)


def test_process_data_by_their_bytes() -> None:
    assert cia402.decode_tpdo(bytes.fromhex("9CFFFFFF 18FC 3716")) == ProcessData(-100, -1000, 0x1637)


def test_emergency_by_its_bytes() -> None:
    assert cia402.decode_emcy(bytes.fromhex("11 86 21 00 00 00 00 00")) == (0x8611, 0x21)
    assert "following error" in cia402.error_text(0x8611)
    assert "current" in cia402.error_text(0x2341)
    assert cia402.error_text(0xA000) == "unknown error"
