"""Whether the two accelerometers of a gantry sit on the axes that they are said to sit on.

Both axes make the same move, so that swapped sensors pass every other check, and both values come out wrong.
What tells the sides apart is the blow when the flanks meet. Motor and load of one side jump apart in it (their
fast parts are opposed, correlation near −1), and the other side's blow comes at another time. Where both gaps are
passed at once a swap cannot be seen; the two values are then nearly equal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.signal import butter, sosfiltfilt

from service.backlash.results import Reason, Refusal
from service.backlash.signals import AxisSignals, axis_signals, step_signals
from service.recording import FloatArray, Move, Recording

BLOW = 100.0
"""Corner of the high-pass that leaves the blow [Hz]. Chosen: above the step's own motion, whose jerk lasts 20 ms,
below the Nyquist frequency of 500 Hz."""

LOOKED_AT = (0.4, 0.95)
"""Share of the move in which the flanks meet."""

BETTER = 0.15
"""By how much, in correlation of both sides together, the sensors must fit the other motors better. Chosen, see
test_pairing."""


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
    if len(known) == 0 or float(np.median(known)) < BETTER:
        return None
    return Refusal(
        Reason.SENSORS_SWAPPED,
        f"The blows that the accelerometer of {axis} feels fit the motor of {partner} better than its own; the two "
        "sensors of the gantry are swapped: exchange their cables or their ids.",
    )


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
