"""Whether the two accelerometers of a gantry sit on the axes that they are said to sit on.

Both axes make the same move, so that swapped sensors pass every other check, and both values come out wrong.
What tells the sides apart is the blow when the flanks meet. Motor and load of one side jump apart in it (their
fast parts are opposed, correlation near −1), and the other side's blow comes at another time. Where that leaves a
doubt, because both gaps are passed at once or the blow swings faster than the speed is sampled, the machine decides:
whether any gantry moves as recorded better with the sensors as they are or exchanged. That takes seconds.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import butter, sosfiltfilt

from service.backlash.model_fit_gantry import explained, explained_closely
from service.backlash.results import Reason, Refusal
from service.backlash.signals import AxisSignals, axis_signals, compared, even
from service.recording import FloatArray, Move, Recording

BLOW = 100.0
"""Corner of the high-pass that leaves the blow [Hz]. Chosen: above the step's own motion, whose jerk lasts 20 ms,
below the Nyquist frequency of 500 Hz."""

LOOKED_AT = (0.4, 0.95)
"""Share of the move in which the flanks meet."""

FEWEST = 10
"""Samples of the speed that tell of a blow, at least."""

CLEAR = 3.0
"""Standard errors by which the sensors have to fit their own motors better for no doubt to be left. Chosen: asking the
machine takes seconds, and at three few sound gantries have to be asked."""


DECIDED = 0.5
"""Share of the other way's cost below which one way is the right one. Above it the gantry is simulated both ways: of 27
swapped ones two were within a fifth, and one of them the wrong way round."""


def paired(recording: Recording, axis: str) -> Refusal | None:
    """Refuse the axis of a gantry whose blows leave a doubt whether its accelerometer is its own."""
    partner = recording.partner(axis)
    if partner is None or recording.trace(partner, "acceleration") is None:
        return None
    here, there = axis_signals(recording, axis), axis_signals(recording, partner)
    if here is None or there is None:
        return None
    better = own_over_crossed(here, there, recording.moves)
    if len(better) == 0 or clear(better):
        return None
    return Refusal(
        Reason.SENSORS_IN_DOUBT,
        f"What the accelerometers of {axis} and {partner} feel does not tell at once which sits on which side: "
        "both gaps are passed at the same time, or the sensors are swapped; wait for the model fit, which decides.",
    )


def swapped(recording: Recording, pair: tuple[str, str]) -> Refusal | None:
    """Refuse a gantry that explains the recording better with its accelerometers exchanged: the machine is asked."""
    first, second = pair
    if not explained_exchanged(recording, first, second):
        return None
    return Refusal(
        Reason.SENSORS_SWAPPED,
        f"What the accelerometers of {first} and {second} feel fits the motor of the other side better than their own; "
        "the two sensors of the gantry are swapped: exchange their cables or their ids.",
    )


def own_over_crossed(here: AxisSignals, there: AxisSignals, moves: tuple[Move, ...]) -> FloatArray:
    """How much more opposed the blows of motors and loads are on the sides that they are said to sit on than on the
    others, in each move that tells: (n,), negative where the sensors sit right."""
    crossed = (replace(here, load=there.load), replace(there, load=here.load))
    own, other = (blows_opposed(a, moves) + blows_opposed(b, moves) for a, b in ((here, there), crossed))
    return (own - other)[np.isfinite(own - other)]


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
    both = recording, replace(recording, traces=traces)
    as_said, exchanged = (explained(one, axes) for one in both)
    if min(as_said, exchanged) > DECIDED * max(as_said, exchanged):
        as_said, exchanged = (explained_closely(one, axes) for one in both)
    return exchanged < as_said


def blows_opposed(signals: AxisSignals, moves: tuple[Move, ...]) -> FloatArray:
    """Correlation of the fast parts of motor and load acceleration in each move (moves,), NaN where unknown."""
    motor, mass = even(signals.speed), even(signals.load)
    a_max = max(move.jerk * move.duration / 4.0 for move in moves)
    sections = butter(2, BLOW, "high", fs=1.0 / motor.period, output="sos")
    a_mot, a_mas = (sosfiltfilt(sections, a) for a in compared(motor, mass, a_max, signals.noise))
    return np.array([_correlation(motor.time, a_mot, a_mas, move) for move in moves])


def _correlation(time: FloatArray, motor: FloatArray, load: FloatArray, move: Move) -> float:
    first, last = (move.start + share * move.duration for share in LOOKED_AT)
    inside = (time > first) & (time < last)
    if np.sum(inside) < FEWEST:
        return float("nan")
    motor, load = motor[inside], load[inside]
    return float(np.sum(motor * load) / np.sqrt(np.sum(motor**2) * np.sum(load**2)))
