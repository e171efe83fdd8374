"""Whether the two accelerometers of a gantry sit on the axes that they are said to sit on.

Both axes make the same move, so that swapped sensors pass every other check, and both values come out wrong.
What tells the sides apart is the blow when the flanks meet. Motor and load of one side jump apart in it (their
fast parts are opposed, correlation near −1), and the other side's blow comes at another time. Where that leaves a
doubt, because both gaps are passed at once or the blow swings faster than the speed is sampled, the machine decides:
whether any gantry moves as recorded better with the sensors as they are or exchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.signal import butter, sosfiltfilt

from service.backlash.model_fit_gantry import explained
from service.backlash.results import Reason, Refusal
from service.backlash.signals import AxisSignals, axis_signals, step_signals
from service.recording import FloatArray, Move, Recording

BLOW = 100.0
"""Corner of the high-pass that leaves the blow [Hz]. Chosen: above the step's own motion, whose jerk lasts 20 ms,
below the Nyquist frequency of 500 Hz."""

LOOKED_AT = (0.4, 0.95)
"""Share of the move in which the flanks meet."""

CLEAR = 3.0
"""Standard errors by which the sensors have to fit their own motors better for no doubt to be left. Chosen: asking the
machine takes some 2 s, and at three one sound gantry in fifty has to be asked."""


def paired(recording: Recording, axis: str) -> Refusal | None:
    """Refuse the axis of a gantry whose accelerometer fits the partner's motor better than its own."""
    partner = recording.partner(axis)
    if partner is None or recording.trace(partner, "acceleration") is None:
        return None
    here, there = axis_signals(recording, axis), axis_signals(recording, partner)
    if here is None or there is None:
        return None
    own = _opposed(here, recording.moves) + _opposed(there, recording.moves)
    crossed = _opposed(replace(here, load=there.load), recording.moves)
    crossed += _opposed(replace(there, load=here.load), recording.moves)
    known = (own - crossed)[np.isfinite(own - crossed)]
    if len(known) == 0 or clear(known) or not explained_exchanged(recording, axis, partner):
        return None
    return Refusal(
        Reason.SENSORS_SWAPPED,
        f"What the accelerometer of {axis} feels fits the motor of {partner} better than its own; the two "
        "sensors of the gantry are swapped: exchange their cables or their ids.",
    )


def clear(better: FloatArray) -> bool:
    """Whether the steps (n,) agree that the sensors fit their own motors better, which is a negative number."""
    if len(better) < 2:
        return False
    return bool(np.mean(better) + CLEAR * np.std(better, ddof=1) / np.sqrt(len(better)) < 0.0)


def explained_exchanged(recording: Recording, axis: str, partner: str) -> bool:
    """Whether a gantry explains the recording better with the two accelerometers exchanged."""
    traces = dict(recording.traces)
    here, there = (axis, "acceleration"), (partner, "acceleration")
    traces[here], traces[there] = traces[there], traces[here]
    axes = tuple(a.name for a in recording.axes if a.name in (axis, partner))
    return explained(replace(recording, traces=traces), axes) < explained(recording, axes)


def _opposed(signals: AxisSignals, moves: Sequence[Move]) -> FloatArray:
    """Correlation of the fast parts of motor and load acceleration in each move (moves,), NaN where unknown."""
    return np.array([_correlation(signals, index, move) for index, move in enumerate(moves)])


def _correlation(signals: AxisSignals, index: int, move: Move) -> float:
    step = step_signals(signals, index, move)
    if step is None:
        return float("nan")
    sections = butter(2, BLOW, "high", fs=1.0 / step.speed.period, output="sos")
    inside = step.within(*LOOKED_AT)
    motor, load = (sosfiltfilt(sections, a)[inside] for a in (step.a_mot, step.a_mas))
    return float(np.sum(motor * load) / np.sqrt(np.sum(motor**2) * np.sum(load**2)))
