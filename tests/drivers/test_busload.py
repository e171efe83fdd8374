"""Bus load against frame lengths counted by hand and the field's own figures."""

from __future__ import annotations

import pytest

from drivers.busload import (
    CyclicFrame,
    accelerometer_frames,
    bus_load,
    drive_frames,
    frame_bits,
    require_bus_load,
)
from drivers.errors import BusOverloaded


@pytest.mark.parametrize(("length", "bits"), [(0, 55), (1, 65), (8, 135)])
def test_worst_case_frame_lengths(length: int, bits: int) -> None:
    # Davis et al. 2007, table 1 of the transmission times: 55 + 10 n bits.
    assert frame_bits(length) == bits


def gantry(sync_period: float = 0.001) -> list[CyclicFrame]:
    frames = [CyclicFrame("master heartbeat", 10.0, 1)]
    for name, producer in (("X1", True), ("X2", False)):
        frames += drive_frames(name, sync_period=sync_period, sync_producer=producer, heartbeat_period=0.1)
        frames += accelerometer_frames(name, sample_rate=4000.0)
    return frames


def test_a_gantry_fits_one_megabit_and_not_half_of_it() -> None:
    load = require_bus_load(gantry(), 1_000_000)
    assert 0.61 <= load <= 0.70
    with pytest.raises(BusOverloaded, match="500 kbit/s"):
        require_bus_load(gantry(), 500_000)


def test_the_refusal_names_the_largest_contributors() -> None:
    with pytest.raises(BusOverloaded, match=r"X1 data 36%"):
        require_bus_load(gantry(), 500_000)


def test_halving_the_sync_rate_helps() -> None:
    assert bus_load(gantry(0.002), 1_000_000) < bus_load(gantry(), 1_000_000) - 0.15
