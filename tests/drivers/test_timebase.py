"""Planted clocks, jitter and losses; the truth is the planting, not what came out once.

Limits: the punctual edge of n uniform latenesses within J lies J / n above zero on average; the tests allow some
hundred times that, which is still a tenth of a sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import ClockInconsistent, CounterRestarted, SamplesMissing
from drivers.timebase import lost_between, place, regress, unwrap

RATE = 4000.0
STRIDE = 3


@dataclass(frozen=True)
class Stream:
    """Frames of a device whose sample k was truly taken at `begin` + k / `rate`."""

    counter: np.ndarray
    time: np.ndarray
    index: np.ndarray
    taken: np.ndarray


def stream(
    rng: np.random.Generator,
    *,
    rate: float = RATE,
    frames: int = 8000,
    jitter: float = 2e-3,
    loss: float = 0.0,
    burst: int = 0,
    begin: float = 1000.0,
    first: int = 0,
    modulus: int = 65536,
    stride: int = STRIDE,
) -> Stream:
    index = first + stride * np.arange(frames)
    taken = begin + index / rate
    late = jitter * rng.random(frames)
    # Frames are read one after another: lateness cannot turn their order round.
    time = np.maximum.accumulate(taken + late)
    kept = rng.random(frames) >= loss
    if burst:
        at = int(rng.integers(1, frames - burst - 1))
        kept[at : at + burst] = False
    kept[[0, -1]] = True
    return Stream((index % modulus)[kept], time[kept], index[kept], taken[kept])


@given(
    seed=st.integers(0, 2**32 - 1),
    error=st.floats(-0.04, 0.04),
    jitter=st.floats(0.0, 2e-3),
    loss=st.floats(0.0, 0.05),
    burst=st.integers(0, 3000),
    first=st.integers(0, 65535),
)
@settings(max_examples=60, deadline=None)
def test_planted_clock_is_found(
    seed: int, error: float, jitter: float, loss: float, burst: int, first: int
) -> None:
    rate = RATE * (1 + error)
    planted = stream(
        np.random.default_rng(seed), rate=rate, jitter=jitter, loss=loss, burst=burst, first=first
    )
    index, timebase = place(planted.counter, planted.time, 65536, 1 / RATE)
    assert index[-1] - index[0] == planted.index[-1] - planted.index[0]
    placed = timebase.time(index)
    assert np.abs(placed - planted.taken).max() < 25e-6
    assert timebase.rate == pytest.approx(rate, rel=1e-5)
    assert timebase.worst <= jitter + 25e-6
    assert timebase.wander < 2e-4


def test_receive_times_themselves_would_be_far_worse() -> None:
    planted = stream(np.random.default_rng(1), rate=RATE * 0.97)
    index, timebase = place(planted.counter, planted.time, 65536, 1 / RATE)
    by_counter = np.abs(timebase.time(index) - planted.taken).max()
    by_arrival = np.abs(planted.time - planted.taken).max()
    assert by_counter < by_arrival / 50


def test_a_burst_of_late_frames_pulls_nothing() -> None:
    planted = stream(np.random.default_rng(2), jitter=2e-4)
    time = planted.time.copy()
    time[3000:3040] = time[3040]
    index, timebase = place(planted.counter, time, 65536, 1 / RATE)
    assert np.abs(timebase.time(index) - planted.taken).max() < 5e-6
    assert timebase.worst > 0.02


@pytest.mark.parametrize("lost_wraps", [0.4, 1.0, 2.6])
def test_gaps_longer_than_a_wrap_of_the_sync_counter(lost_wraps: float) -> None:
    planted = stream(
        np.random.default_rng(3), rate=1020.0, modulus=240, stride=1, frames=6000, burst=int(240 * lost_wraps)
    )
    index, timebase = place(planted.counter + 1, planted.time, 240, 1e-3, first=1)
    assert index[-1] - index[0] == 5999
    assert (
        np.abs(timebase.time(index - index[0]) - (planted.taken - timebase.period * index[0])).max() < 25e-6
    )


def test_sync_counter_starts_at_one() -> None:
    counter = np.array([239, 240, 1, 2] * 1)
    found = unwrap(counter, np.arange(4) * 1e-3, 240, 1e-3, first=1)
    assert found.index.tolist() == [239, 240, 241, 242]
    assert not len(found.restarts)


def test_a_restarted_device_is_noticed() -> None:
    rng = np.random.default_rng(4)
    before = stream(rng, frames=2000, first=30000)
    after = stream(rng, frames=2000, first=0, begin=1000.0 + 36000 / RATE + 0.8)
    counter = np.concatenate([before.counter, after.counter])
    time = np.concatenate([before.time, after.time])
    assert unwrap(counter, time, 65536, 1 / RATE).restarts.tolist() == [2000]
    with pytest.raises(CounterRestarted, match=r"first 2\.\d+ s"):
        place(counter, time, 65536, 1 / RATE)


def test_a_stepped_clock_of_the_pc_is_noticed() -> None:
    planted = stream(np.random.default_rng(6), jitter=1e-3)
    time = planted.time.copy()
    time[4000:] += 0.012
    with pytest.raises(ClockInconsistent):
        place(planted.counter, time, 65536, 1 / RATE)


def test_a_wrong_nominal_rate_does_not_bend_the_result() -> None:
    planted = stream(np.random.default_rng(7), rate=1600.0)
    assert place(planted.counter, planted.time, 65536, 1 / 4000.0)[1].rate == pytest.approx(1600.0, rel=1e-5)


def test_too_few_frames() -> None:
    with pytest.raises(SamplesMissing, match="5 frames"):
        regress(np.arange(5), np.arange(5) * 1e-3)
    with pytest.raises(SamplesMissing, match="0 frames"):
        place(np.empty(0, np.int64), np.empty(0), 65536, 1e-3)


def test_an_exact_clock_is_found_exactly() -> None:
    timebase = regress(np.arange(100), 5.0 + np.arange(100) * 0.25)
    assert (timebase.period, timebase.jitter, timebase.worst, timebase.wander) == (0.25, 0.0, 0.0, 0.0)
    assert timebase.time(np.array([-2, 0, 99, 101])).tolist() == [4.5, 5.0, 29.75, 30.25]


def test_a_clock_that_drifts_is_followed() -> None:
    rng = np.random.default_rng(8)
    index = STRIDE * np.arange(80_000)
    exact = index / RATE
    taken = exact + 1e-6 * exact**2 / 2  # the rate falls by 1e-6 per second, for a minute
    late = 2e-3 * rng.random(len(index))
    timebase = place(index % 65536, np.maximum.accumulate(taken + late), 65536, 1 / RATE)[1]
    assert np.abs(timebase.time(index) - taken).max() < 30e-6
    straight = np.polyval(np.polyfit(index, taken, 1), index)
    assert np.abs(straight - taken).max() > 120e-6


@pytest.mark.parametrize("seconds", [3.0, 13.0, 40.0])
@pytest.mark.parametrize("where", [0.1, 0.37, 0.5, 0.93])
@pytest.mark.parametrize("jump", [3, -3, 12, -12])
def test_a_jump_of_the_counter_is_never_swallowed(seconds: float, where: float, jump: int) -> None:
    planted = stream(np.random.default_rng(9), frames=int(seconds * RATE / STRIDE))
    counter = planted.counter.copy()
    counter[int(where * len(counter)) :] += jump
    with pytest.raises((ClockInconsistent, CounterRestarted)):
        place(counter % 65536, planted.time, 65536, 1 / RATE)


@pytest.mark.parametrize(
    ("index", "stride", "lost"), [([0, 3, 6], 3, 0), ([0, 3, 12], 3, 2), ([7], 3, 0), ([5, 6, 9], 1, 2)]
)
def test_lost_frames_are_counted(index: list[int], stride: int, lost: int) -> None:
    assert lost_between(np.array(index), stride) == lost
