"""What a verdict says of one model of an axis: its errors, its numbers, and what it predicts beside the capture."""

from __future__ import annotations

import numpy as np

from service.backlash.moves_fit import Fitted
from service.identification.axis_numbers import deviations, interval_95
from service.identification.explanation import ErrorReport, Parameter, Prediction
from service.identification.held_out import Explained, Held, rms
from service.recording import FloatArray


def report(one: Explained, axis: int) -> ErrorReport:
    held, noise = one.held, float(one.held.moves.noise[axis])
    errors = held.errors[:, axis] * noise
    lagged = errors[:, :-1] * errors[:, 1:]
    train = train_errors(one.fitted, axis)
    b, interval = interval_95(one.fitted, axis, rms(held.weighed[:, axis]))
    return ErrorReport(
        train_rms=rms(train) * noise,
        validation_rms=rms(errors),
        normalised_rms=rms(errors)
        / max(rms(np.where(held.moves.used, held.moves.measured, np.nan)[:, axis]), 1e-300),
        whiteness=float(np.nanmean(lagged) / max(float(np.nanmean(errors**2)), 1e-300)),
        backlash=b,
        interval_95=interval,
        expected_rms=float(one.announced[axis]) * noise,
    )


def train_errors(found: Fitted, axis: int) -> FloatArray:
    """Residuals over the noise of one axis in all train recordings."""
    first, out = 0, []
    for part in found.moves:
        count = int(np.sum(part.used))
        of_axis = np.nonzero(part.used)[1] == axis
        over_noise = found.r[first : first + count] * part.expected[part.used]
        out.append(over_noise[of_axis])
        first += count
    return np.concatenate(out)


def parameters(found: Fitted, axis: int) -> dict[str, Parameter]:
    """Effects' own parameters first, then the declared model's; forces and stiffnesses per moved mass."""
    values, units = deviations(found), {p.name: p.unit for p in found.model.parameters}
    own = [p.name for effect in found.model.effects[1:] for p in effect.parameters]
    other = [name for name in values if name not in own]
    out = {}
    for name in (*own, *other):
        of, _, short = name.rpartition(".")
        if of in ("", found.model.axes[axis]):
            unit = units[name]
            out[short + ("_s" if unit == "s" else "")] = Parameter(*values[name], unit)
    return out


def prediction(which: str, held: Held, axis: int) -> Prediction:
    """At the capture's own time stamps: every sample of a move lies in one interval of the grid."""
    moves, times, values = held.moves, [], []
    trace = moves.recording.traces[moves.axes[axis], "acceleration"]
    for t, (grid, move) in enumerate(zip(moves.grids, moves.made, strict=True)):
        part = trace.between(move.start, move.end)
        at = np.clip(np.floor((part.time - grid.start) / grid.h).astype(int), 0, moves.samples - 1)
        times.append(part.time)
        values.append(held.predicted[t, axis, at] + moves.bias[t, axis])
    return Prediction(
        "before" if which == "before" else "after", np.concatenate(times), np.concatenate(values)
    )
