"""What a set of recordings must satisfy before any verdict is tried; otherwise ``CannotExplain`` says why."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from service.identification.explanation import CannotExplain
from service.recording import Recording, Trace

MAX_LOSS = 0.015
"""Share of missing samples above which a residual is no longer trusted. Chosen: an estimate still holds at
1 % (one step in twenty touched), at 2 % two steps in three have a hole in the backlash pass."""


def check_recordings(train: Sequence[Recording], validate: Recording) -> None:
    """Raise ``CannotExplain`` unless the recordings show the same axes, independent data and usable channels."""
    if not train:
        raise CannotExplain("no train recording was given; record at least one run to fit the model to")
    for recording in train:
        _same_axes(recording, validate)
        _independent(recording, validate)
    for number, recording in enumerate((*train, validate)):
        name = "the validate recording" if number == len(train) else f"train recording {number + 1}"
        _usable(recording, name)
    _same_rates((*train, validate))


def _same_axes(train: Recording, validate: Recording) -> None:
    ours, theirs = {a.name for a in train.axes}, {a.name for a in validate.axes}
    if ours != theirs:
        raise CannotExplain(
            f"train holds the axes {sorted(ours)}, validate {sorted(theirs)}; give recordings of the same axes"
        )
    for axis in train.axes:
        other = validate.axis(axis.name)
        if not np.isclose(axis.transmission, other.transmission, rtol=1e-6) or axis.motion != other.motion:
            raise CannotExplain(
                f"axis {axis.name} has transmission {axis.transmission:g} ({axis.motion}) in train and "
                f"{other.transmission:g} ({other.motion}) in validate: these are two different axes"
            )


def _independent(train: Recording, validate: Recording) -> None:
    """Refuse a validation on samples that were fitted: it would prove nothing."""
    shared = [key for key in train.traces if key in validate.traces]
    if shared and all(_equal(train.traces[key], validate.traces[key]) for key in shared):
        raise CannotExplain("train and validate are the same recording; judge on moves that were not fitted")
    # A drive that repeats a step well repeats its coarse counts, too; a load's sensor never repeats its noise.
    told = [key for key in shared if not key[1].startswith("motor")] or shared
    repeated = [key for key in told if _repeats(train.traces[key], validate.traces[key])]
    if repeated:
        raise CannotExplain(
            f"validate repeats samples of train in {repeated[0][0]} {repeated[0][1]}; record the moves anew"
        )


def _equal(a: Trace, b: Trace) -> bool:
    return len(a) == len(b) and bool(np.array_equal(a.value, b.value))


def _repeats(a: Trace, b: Trace) -> bool:
    """True when half of the moving part of one trace is found, sample for sample, in the other."""
    count = min(len(a), len(b))
    if count < 100:
        return False
    said, again = a.value[:count], b.value[:count]
    held = np.diff(said, prepend=np.nan) == 0.0  # at the end of a sensor's range all recordings are alike
    moving = (np.abs(said) > 0.2 * np.ptp(a.value)) & ~held
    same = (said == again) & moving
    return bool(moving.sum() > 50 and same.sum() > 0.5 * moving.sum())


def _usable(recording: Recording, name: str) -> None:
    for (axis, channel), trace in recording.traces.items():
        where = f"{name}, {axis} {channel}"
        if len(trace) < 20:
            raise CannotExplain(f"{where}: only {len(trace)} samples; the channel was not recorded")
        if not (np.isfinite(trace.time).all() and np.isfinite(trace.value).all()):
            raise CannotExplain(
                f"{where}: holds values that are not finite; the recorder or its decoder failed"
            )
        if np.ptp(trace.value) == 0.0:
            raise CannotExplain(f"{where}: flat; the sensor is dead or unplugged. Check its supply and cable")
        loss = lost_share(trace)
        if loss > MAX_LOSS:
            raise CannotExplain(
                f"{where}: {100 * loss:.1f} % of the samples are missing (at most {100 * MAX_LOSS:g} %); "
                "an overloaded bus or a bad connector. Check the bus load and the wiring, then record again"
            )
        broken = recording.moves_without(axis, channel)
        if broken:
            raise CannotExplain(
                f"{where}: hardly any samples in move {broken[0] + 1}; the recording broke off there. "
                "Check the bus and the connector, then record again"
            )


def lost_share(trace: Trace) -> float:
    """Share of samples missing between the first and the last one, by the median sample distance."""
    step = np.diff(trace.time)
    expected = np.round(step / np.median(step)).sum() + 1
    return float(max(0.0, 1.0 - len(trace) / expected))


def _same_rates(recordings: Sequence[Recording]) -> None:
    """A channel that was sampled at two rates was not recorded by one set-up."""
    for axis, channel in recordings[-1].traces:
        rates = [
            1.0 / float(np.median(np.diff(r.traces[axis, channel].time)))
            for r in recordings
            if (axis, channel) in r.traces
        ]
        if max(rates) > 1.05 * min(rates):
            raise CannotExplain(
                f"{axis} {channel} was recorded at {min(rates):.0f} Hz and at {max(rates):.0f} Hz; "
                "the set-up changed between the recordings. Record both at one rate"
            )
