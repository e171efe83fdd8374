"""When was a sample taken? By its counter, never by the moment at which its frame was read.

A frame is read late, by anything between nothing and some milliseconds, never early. Its counter, on the
other hand, is exact: sample k was taken at offset + k * period of the device's own clock. So counter is
regressed on receive time along the *lower edge* of the receive times, where the delay was smallest:

    maximise  a + b * mean(k)   subject to   a + b * k_i <= t_i  for all i

a linear programme whose solution is the edge of the lower convex hull above mean(k) (S. B. Moon, P. Skelly,
D. Towsley, Estimation and removal of clock skew from network delay measurements, INFOCOM 1999). A mean line
would follow every burst of late frames; this one ignores all but the punctual ones.

The rate is estimated, not assumed: MEMS clocks are off by up to 4 %. And they drift as they warm up, so that a
recording of many seconds gets a chain of such lines.
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

MAX_WANDER = 2.5e-4
"""Largest departure of the punctual frames from the chain [s]. Chosen: one sample at 4 kHz; a restarted counter, a
stepped PC clock or samples dropped uncounted show as more, see test_a_jump_of_the_counter_is_never_swallowed."""

WINDOW = 8.0
"""Length of a line of the chain [s]. Chosen: a clock whose rate drifts by 1e-6/s leaves a line by 8 µs in it, and
thousands of frames are in it."""

MIN_FRAMES = 16
"""Fewer frames do not carry a regression. Chosen: the punctual ones must be among them."""

_BLOCK = 256


@dataclass(frozen=True)
class Timebase:
    """When the samples of a device were taken: a line, or a chain of lines where its clock drifts.

    Attributes
    ----------
    knot_index, knot_time : (m,) counts and bus times [s] between which time is linear in the count
    jitter : median lateness of the frames [s]
    worst : largest lateness [s]
    wander : largest departure of the punctual frames from the chain [s]
    """

    knot_index: FloatArray
    knot_time: FloatArray
    jitter: float
    worst: float
    wander: float

    @property
    def period(self) -> float:
        """Mean time per count [s] on the bus' clock."""
        return float((self.knot_time[-1] - self.knot_time[0]) / (self.knot_index[-1] - self.knot_index[0]))

    @property
    def rate(self) -> float:
        """Samples per second [Hz] on the bus' clock."""
        return 1.0 / self.period

    def time(self, index: NDArray[np.int64] | FloatArray) -> FloatArray:
        """Bus time at which the samples were taken [s], shape of `index`; beyond the ends the lines go on."""
        piece = np.clip(np.searchsorted(self.knot_index, index) - 1, 0, len(self.knot_index) - 2)
        slope = np.diff(self.knot_time) / np.diff(self.knot_index)
        return self.knot_time[piece] + slope[piece] * (index - self.knot_index[piece])


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
    """Fit the line of the punctual frames; in a long recording a chain of lines, one per ``WINDOW``.

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
    # Receive times are seconds since 1970: too large to be multiplied and still resolve microseconds.
    k = (index - index[0]).astype(np.float64)
    t = time - time[0]
    knots, at, disagreement = _chain(k, t)
    late = t - Timebase(knots, at, 0.0, 0.0, 0.0).time(k)
    return Timebase(
        knot_index=knots + index[0],
        knot_time=at + time[0],
        jitter=float(np.median(late)),
        worst=float(late.max()),
        wander=max(disagreement, _wander(late)),
    )


def _chain(k: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Knots of the chain, and by how much neighbouring lines disagree half-way between their middles [s].

    Each window's line is trusted at its middle; outwards of the first and the last middle their lines go on.
    """
    parts = [part for part in _windows(t) if np.count_nonzero(part) >= _BLOCK] or [np.ones(len(t), np.bool_)]
    lines = np.array([_lower_edge(k[part], t[part]) for part in parts])
    middle = np.array([0.5 * (k[part][0] + k[part][-1]) for part in parts])
    between = 0.5 * (middle[1:] + middle[:-1])
    disagreement = np.abs(np.diff(lines[:, 0]) * between + np.diff(lines[:, 1]))
    if len(parts) == 1:
        middle, lines = np.empty(0), lines[[0, 0]]
    knots = np.concatenate(([k[0]], middle, [k[-1]]))
    lines = lines if len(lines) == len(knots) else np.concatenate((lines[:1], lines, lines[-1:]))
    return knots, lines[:, 0] * knots + lines[:, 1], float(disagreement.max(initial=0.0))


def _windows(t: FloatArray) -> list[NDArray[np.bool_]]:
    """Which frames lie in each of the half-overlapping windows; one window for a short recording."""
    span = t.max() - t.min()
    if span < 1.5 * WINDOW:
        return []
    count = round(2 * span / WINDOW) - 1
    width = 2 * span / (count + 1)
    begins = t.min() + 0.5 * width * np.arange(count)
    return [(t >= begin) & (t <= begin + width) for begin in begins]


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


def _wander(late: FloatArray) -> float:
    """Largest of the blocks' smallest lateness [s]: zero on a straight line, whatever the jitter."""
    blocks = max(1, len(late) // _BLOCK)
    return float(max(abs(part.min()) for part in np.array_split(late, blocks)))


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
            f"counter against bus time departs from even running by {timebase.wander * 1e3:.2f} ms, "
            f"at most {MAX_WANDER * 1e3:.2f} ms are trusted"
        )
    return unwrapped.index, timebase


def lost_between(index: IntArray, stride: int = 1) -> int:
    """How many frames of `stride` counts each are missing between the first and the last of `index`."""
    if len(index) < 2:
        return 0
    return int((index[-1] - index[0]) // stride + 1 - len(index))
