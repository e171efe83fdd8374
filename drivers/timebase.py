"""When was a sample taken? By its counter, never by the moment at which its frame was read.

A frame is read late, by anything between nothing and some milliseconds, never early. Its counter, on the
other hand, is exact: sample k was taken at offset + k * period of the device's own clock. So counter is
regressed on receive time along the *lower edge* of the receive times, where the delay was smallest:

    maximise  a + b * mean(k)   subject to   a + b * k_i <= t_i  for all i

a linear programme whose solution is the edge of the lower convex hull above mean(k) (S. B. Moon, P. Skelly,
D. Towsley, Estimation and removal of clock skew from network delay measurements, INFOCOM 1999). A mean line
would follow every burst of late frames; this one ignores all but the punctual ones.

The rate is estimated, not assumed: MEMS clocks are off by up to 4 %.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ClockInconsistent, CounterRestarted, SamplesMissing

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MAX_JITTER = 0.05
"""Latest reading of a frame that is still taken for lateness [s]. Chosen: fifty times the measured ±0.9 ms;
a stalled reader is no restart. Smaller jumps of a counter are left to ``MAX_WANDER``."""

RATE_TOLERANCE = 0.1
"""How far a device's rate may lie from its nominal one. Chosen: twice the 4 % seen on MEMS clocks."""

MAX_WANDER = 5e-4
"""Largest departure of the punctual frames from a straight line [s]. Chosen: half a SYNC period; a restarted
counter, a stepped PC clock or samples dropped uncounted show as one sample or more."""

MIN_FRAMES = 16
"""Fewer frames do not carry a regression. Chosen: the punctual ones must be among them."""

_BLOCKS = 16
_BLOCK_FRAMES = 64


@dataclass(frozen=True)
class Timebase:
    """Sample k of a device was taken at ``offset + k * period`` on the bus' clock.

    Attributes
    ----------
    period : [s] per count
    offset : bus time of count 0 [s]
    jitter : median lateness of the frames [s]
    worst : largest lateness [s]
    wander : largest departure of the punctual frames from the line [s]; drift of the clock against the bus
    """

    period: float
    offset: float
    jitter: float
    worst: float
    wander: float

    @property
    def rate(self) -> float:
        """Samples per second [Hz] on the bus' clock."""
        return 1.0 / self.period

    def time(self, index: IntArray) -> FloatArray:
        """Bus time at which the samples were taken [s], shape of `index`."""
        return self.offset + self.period * index.astype(np.float64)


@dataclass(frozen=True)
class Unwrapped:
    """Counters freed of their wraps.

    Attributes
    ----------
    index : (n,) int64, starting at the first counter value, one count per sample
    restarts : (m,) positions i at which the device had restarted between frame i - 1 and i
    """

    index: IntArray
    restarts: IntArray


def unwrap(
    counter: NDArray[np.integer], time: FloatArray, modulus: int, nominal_period: float, first: int = 0
) -> Unwrapped:
    """Undo the wrap of a counter, also across gaps longer than a wrap, and find restarts.

    Parameters
    ----------
    counter : (n,) values first ... first + modulus - 1, in order of arrival (65536 and 0; SYNC: 240 and 1)
    time : (n,) receive times [s]; they say how many whole wraps a gap swallowed
    nominal_period : [s] per count, right within ``RATE_TOLERANCE``

    Notes
    -----
    A step of the counter that elapsed time cannot explain within ``MAX_JITTER`` is a restart. Behind one the
    index goes on with the elapsed time, so that the caller still sees where it happened.
    """
    counts = counter.astype(np.int64) - first
    if not len(counts):
        return Unwrapped(counts, counts)
    step = np.mod(np.diff(counts), modulus)
    elapsed = np.diff(time)
    period = _period_between(step, elapsed, modulus, nominal_period)
    expected = elapsed / period
    wraps = np.maximum(np.rint((expected - step) / modulus), 0).astype(np.int64)
    step = step + modulus * wraps
    allowed = MAX_JITTER / period + 0.01 * np.abs(expected)
    broken = np.abs(step - expected) > np.minimum(allowed, 0.45 * modulus)
    step = np.where(broken, np.maximum(np.rint(expected), 1).astype(np.int64), step)
    index = counts[0] + first + np.concatenate(([0], np.cumsum(step)))
    return Unwrapped(index, np.flatnonzero(broken) + 1)


def _period_between(step: IntArray, elapsed: FloatArray, modulus: int, nominal: float) -> float:
    """Period [s] from neighbours that are no more than half a wrap apart; the nominal one without any."""
    near = (elapsed < 0.5 * modulus * nominal) & (
        np.abs(step - elapsed / nominal) <= MAX_JITTER / nominal + RATE_TOLERANCE * elapsed / nominal
    )
    counts = int(step[near].sum())
    period = float(elapsed[near].sum()) / counts if counts else nominal
    return float(np.clip(period, nominal * (1 - RATE_TOLERANCE), nominal * (1 + RATE_TOLERANCE)))


def regress(index: IntArray, time: FloatArray) -> Timebase:
    """Fit the line of the punctual frames.

    Parameters
    ----------
    index : (n,) unwrapped counter, increasing
    time : (n,) receive time [s]; lateness is one-sided

    Raises
    ------
    SamplesMissing
        Fewer than ``MIN_FRAMES`` frames, or all of one index.
    """
    if len(index) < MIN_FRAMES or index[-1] <= index[0]:
        raise SamplesMissing(
            f"{len(index)} frames, at least {MIN_FRAMES} are needed to place samples in time"
        )
    k = (index - index[0]).astype(np.float64)
    t = time - time[0]
    slope, intercept = _lower_edge(k, t)
    late = t - (intercept + slope * k)
    return Timebase(
        period=slope,
        offset=float(time[0] + intercept - slope * index[0]),
        jitter=float(np.median(late)),
        worst=float(late.max()),
        wander=_wander(k, late),
    )


def _lower_edge(k: FloatArray, t: FloatArray) -> tuple[float, float]:
    """Slope and intercept of the lower hull's edge above mean(k).

    An end of the edge is replaced by the lowest point below it until there is none.
    """
    middle = k.mean()
    left, right = k <= middle, k > middle
    slope = float((t[-1] - t[0]) / (k[-1] - k[0]))
    i = int(np.flatnonzero(left)[np.argmin((t - slope * k)[left])])
    j = int(np.flatnonzero(right)[np.argmin((t - slope * k)[right])])
    for _ in range(len(k)):
        slope = float((t[j] - t[i]) / (k[j] - k[i]))
        below = (t - t[i]) - slope * (k - k[i])
        lowest = int(np.argmin(below))
        if lowest in (i, j) or below[lowest] >= -1e-12:
            break
        i, j = (lowest, j) if left[lowest] else (i, lowest)
    return slope, float(t[i] - slope * k[i])


def _wander(k: FloatArray, late: FloatArray) -> float:
    """Largest of the blocks' smallest lateness [s]: zero on a straight line, whatever the jitter."""
    blocks = min(_BLOCKS, max(1, len(k) // _BLOCK_FRAMES))
    return float(max(part.min() for part in np.array_split(late, blocks)))


def place(
    counter: NDArray[np.integer], time: FloatArray, modulus: int, nominal_period: float, first: int = 0
) -> tuple[IntArray, Timebase]:
    """Unwrap and regress in one go: the index of each frame and the line that places it.

    Raises
    ------
    SamplesMissing, CounterRestarted, ClockInconsistent
        When no honest placement exists.
    """
    unwrapped = unwrap(counter, time, modulus, nominal_period, first)
    if len(unwrapped.restarts):
        at = time[unwrapped.restarts[0]] - time[0]
        raise CounterRestarted(
            f"the counter jumped {len(unwrapped.restarts)} time(s), first {at:.3f} s into the recording"
        )
    timebase = regress(unwrapped.index, time)
    if timebase.wander > MAX_WANDER:
        raise ClockInconsistent(
            f"counter against bus time departs from a line by {timebase.wander * 1e3:.2f} ms, "
            f"at most {MAX_WANDER * 1e3:.1f} ms are trusted"
        )
    return unwrapped.index, timebase


def lost_between(index: IntArray, stride: int = 1) -> int:
    """How many frames of `stride` counts each are missing between the first and the last of `index`."""
    if len(index) < 2:
        return 0
    return int((index[-1] - index[0]) // stride + 1 - len(index))
