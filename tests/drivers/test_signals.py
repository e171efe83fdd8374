"""Bit slices against cantools, for any layout that cantools accepts."""

from __future__ import annotations

import cantools
import numpy as np
import pytest
from cantools.database.can import Message, Signal
from cantools.database.conversion import LinearConversion
from hypothesis import given
from hypothesis import strategies as st

from drivers.signals import load_dbc, slice_of, slices_of

payloads = st.lists(st.binary(min_size=8, max_size=8), min_size=1, max_size=20)


def as_array(data: list[bytes]) -> np.ndarray:
    return np.frombuffer(b"".join(data), dtype=np.uint8).reshape(-1, 8)


@st.composite
def signals(draw: st.DrawFn) -> Signal:
    byte_order = draw(st.sampled_from(["little_endian", "big_endian"]))
    length = draw(st.integers(1, 64))
    lowest = draw(st.integers(0, 64 - length))
    if byte_order == "little_endian":
        start = lowest
    else:
        top = lowest  # bits from the first bit on the wire to the signal's most significant one
        start = 8 * (top // 8) + 7 - top % 8
    conversion = LinearConversion(
        scale=draw(st.sampled_from([1.0, 0.002394, -0.5])),
        offset=draw(st.sampled_from([0.0, -40.0])),
        is_float=False,
    )
    return Signal(
        "S", start, length, byte_order=byte_order, is_signed=draw(st.booleans()), conversion=conversion
    )


@given(signals(), payloads)
def test_any_signal_reads_as_cantools_reads_it(signal: Signal, data: list[bytes]) -> None:
    message = Message(0x100, "M", 8, [signal])
    expected = [message.decode(d)["S"] for d in data]
    counts = [message.decode(d, scaling=False)["S"] for d in data]
    found = slice_of(signal)
    if signal.length < 64 or signal.is_signed:
        assert found.raw(as_array(data)).tolist() == counts
        assert found.physical(as_array(data)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", ["AccelerometerData", "AccelerometerTime"])
@given(payloads)
def test_the_default_contract_reads_as_cantools_reads_it(name: str, data: list[bytes]) -> None:
    message = load_dbc().get_message_by_name(name)
    decoded = [message.decode(d, decode_choices=False) for d in data]
    for signal, part in slices_of(message).items():
        assert part.physical(as_array(data)) == pytest.approx([d[signal] for d in decoded], rel=1e-12)


def test_the_default_contract_by_its_bytes() -> None:
    parts = slices_of(load_dbc().get_message_by_name("AccelerometerData"))
    data = as_array([bytes.fromhex("0100 FFFF 0080 3412")])
    assert [int(parts[n].raw(data)[0]) for n in ("Sample0", "Sample1", "Sample2", "Counter")] == [
        1,
        -1,
        -32768,
        0x1234,
    ]
    assert parts["Sample0"].physical(data)[0] == pytest.approx(0.002394)
    assert parts["Sample0"].choices == {"Clipped": 32767, "Invalid": -32768}


def test_the_time_frame_by_its_bytes() -> None:
    parts = slices_of(load_dbc().get_message_by_name("AccelerometerTime"))
    data = as_array([bytes.fromhex("40420F00 0200 E7 05")])
    found = {name: int(part.raw(data)[0]) for name, part in parts.items()}
    assert found == {
        "DeviceTime": 1_000_000,
        "Counter": 2,
        "Temperature": -25,
        "Synced": 1,
        "OverRange": 0,
        "SelfTestFailed": 1,
    }


def test_a_float_signal_is_refused() -> None:
    signal = Signal("S", 0, 32, conversion=cantools.database.conversion.IdentityConversion(is_float=True))
    with pytest.raises(ValueError, match="signal S"):
        slice_of(signal)
