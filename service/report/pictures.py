"""The pictures of a finding: one step as measured and as predicted, what is left over, its spectrum or its place.

Everything is drawn from the run that judged, which was not fitted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import welch

from service.recording import FloatArray, Move, Recording, Trace
from service.report.plot import Curve, curves

Predictions = Mapping[tuple[str, str], Trace]
"""What the model says the channel reads, by (axis, "before" or "after"), at the channel's own time stamps."""

BY_POSITION = {
    "position_dependent_force",
    "position_dependent_backlash",
    "transmission_ripple",
    "lost_motion",
    "compliance",
}
"""Effects that are seen better along the travel than over the frequency."""

UNITS = {
    "acceleration": "m/s²",
    "motor_torque": "N·m",
    "load_position": "m or rad",
    "load_speed": "m/s or rad/s",
    "motor_position": "rad",
    "motor_speed": "rad/s",
}
HIGHEST = 500.0
"""Highest frequency shown [Hz]: what a machine of this size does beyond it does not reach the backlash."""
SHOWN = (0.1, 0.25)
"""Shown before and after the move, in its durations."""


@dataclass(frozen=True)
class Told:
    """One axis of the judging run: time (n,) [s], measured, before and after (n,) in the channel's unit."""

    channel: str
    time: FloatArray
    measured: FloatArray
    before: FloatArray
    after: FloatArray

    @property
    def unit(self) -> str:
        return UNITS.get(self.channel, "")


def told(recording: Recording, predictions: Predictions, axis: str, channel: str) -> Told | None:
    """Set the predictions beside what was measured; None where either is missing."""
    measured = recording.trace(axis, channel)
    before, after = predictions.get((axis, "before")), predictions.get((axis, "after"))
    if measured is None or before is None or after is None or len(before) < 2 or len(measured) < 2:
        return None
    value = np.interp(before.time, measured.time, measured.value)
    return Told(channel, before.time, value, before.value, np.interp(before.time, after.time, after.value))


def pictures(recording: Recording, shown: Told, axis: str, effects: tuple[str, ...]) -> list[str]:
    """The pictures of one axis, in the order in which they are read."""
    move = _telling_move(recording, shown)
    drawn = [_step(shown, move), _left_over(shown, move)]
    if set(effects) & BY_POSITION:
        drawn.append(_over_position(recording, shown, axis))
    else:
        drawn.append(_spectrum(shown))
    return [picture for picture in drawn if picture]


def _telling_move(recording: Recording, shown: Told) -> Move | None:
    """The move in which the model before is the furthest off."""
    error = np.abs(shown.measured - shown.before)
    moves = [m for m in recording.moves if _inside(shown, m).any()]
    return max(moves, key=lambda m: float(np.sum(error[_inside(shown, m)])), default=None)


def _inside(shown: Told, move: Move) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    start, end = move.start - SHOWN[0] * move.duration, move.end + SHOWN[1] * move.duration
    return (shown.time >= start) & (shown.time < end)


def _part(
    shown: Told, move: Move | None
) -> tuple[FloatArray, np.ndarray[tuple[int], np.dtype[np.bool_]], str]:
    """Time axis, mask and label: one move in ms, or all of the recording in s where it holds no moves."""
    if move is None:
        return shown.time, np.ones(len(shown.time), dtype=bool), "time / s"
    mask = _inside(shown, move)
    return 1e3 * (shown.time - move.start), mask, "time since the start of the step / ms"


def _step(shown: Told, move: Move | None) -> str:
    time, mask, label = _part(shown, move)
    lines = [
        Curve("measured", "measured", time[mask], shown.measured[mask]),
        Curve("model before", "before", time[mask], shown.before[mask]),
        Curve("model after", "after", time[mask], shown.after[mask]),
    ]
    return curves("Measured and predicted", label, f"{_name(shown)} / {shown.unit}", lines)


def _left_over(shown: Told, move: Move | None) -> str:
    time, mask, label = _part(shown, move)
    lines = [
        Curve("left over before", "before", time[mask], (shown.measured - shown.before)[mask]),
        Curve("left over after", "after", time[mask], (shown.measured - shown.after)[mask]),
    ]
    return curves("What the model leaves over", label, f"measured − predicted / {shown.unit}", lines)


def _spectrum(shown: Told) -> str:
    lines = [
        Curve(name, style, *_density(shown.time, shown.measured - model))
        for name, style, model in (
            ("left over before", "before", shown.before),
            ("left over after", "after", shown.after),
        )
    ]
    label = f"left over / ({shown.unit})/√Hz"
    return curves("Spectrum of what is left over", "frequency / Hz", label, lines, log_y=True)


def _density(time: FloatArray, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Amplitude density over the frequency [Hz], the mean of the parts that were sampled without a gap."""
    period = float(np.median(np.diff(time)))
    parts = np.split(value, np.flatnonzero(np.diff(time) > 3 * period) + 1)
    size = min(1024, max(len(part) for part in parts))
    long = [part for part in parts if len(part) >= size // 2]
    found = [welch(np.pad(part, (0, max(0, size - len(part)))), 1.0 / period, nperseg=size) for part in long]
    frequency = found[0][0]
    power = np.mean([one for _, one in found], axis=0)
    keep = (frequency > 0) & (frequency <= HIGHEST)
    return frequency[keep], np.sqrt(power[keep])


def _over_position(recording: Recording, shown: Told, axis: str) -> str:
    """What is left over along the travel, which is counted from where the recording began."""
    speed = recording.trace(axis, "motor_speed")
    if speed is None or len(speed) < 2:
        return _spectrum(shown)
    described = recording.axis(axis)
    way = np.concatenate([[0.0], np.cumsum(np.diff(speed.time) * (speed.value[1:] + speed.value[:-1]) / 2)])
    scale, unit = (1e3, "mm") if described.motion == "linear" else (1.0, "rad")
    position = scale * described.transmission * np.interp(shown.time, speed.time, way)
    order = np.argsort(position)
    lines = [
        Curve(name, style, position[order], (shown.measured - model)[order])
        for name, style, model in (
            ("left over before", "before", shown.before),
            ("left over after", "after", shown.after),
        )
    ]
    return curves(
        "What is left over along the travel", f"position / {unit}", f"left over / {shown.unit}", lines
    )


def _name(shown: Told) -> str:
    return shown.channel.replace("_", " ")
