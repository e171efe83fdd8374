"""What goes with a verdict on an axis' moves: evidence in words, and the move that would tell rivals apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from service.backlash.moves import Moves
from service.dynamics.driven_effect import DrivenEffect
from service.identification.axis_numbers import apart_in_time, clearance_beside, division_known
from service.identification.explanation import Finding, SeparatingMove
from service.identification.held_out import Explained, Held, rms
from service.identification.moves_motors import CONTRADICTED, left_by_motors
from service.identification.moves_repeated import pure_error
from service.identification.scene import Scene
from service.identification.selection import Selection
from service.recording import FloatArray

MOVES, CHANGES, TELLS = 4, 1.5, 0.9
"""Least number of moves of which a course is told, how many times the largest residual must be the smallest, and the
share of the variance between moves that a step or a line must explain to be told (chosen; a bowl is a step to four
fifths)."""


def over_range(scene: Scene, axis: str) -> tuple[str, ...]:
    """What says that an accelerometer was over its range, if this one was."""
    if axis not in scene.clipped:
        return ()
    return (
        "the accelerometer stays at an end of its range: the steps are harder than it can measure, and nothing was "
        "searched for. Choose a larger range, or step with a smaller jerk, and record again",
    )


def of_motor(left: float, model: str) -> tuple[str, ...]:
    """What an axis' motor says of a model that leaves so much of its equation of motion, over the noise; nothing where
    no torque was recorded."""
    if not left > 0.0:
        return ()
    return (
        f"what the motor's torque and speed say of the force on it, the {model} model leaves at {left:.1f} of their "
        f"noise; from {CONTRADICTED} on something between motor and load is not as the model has it",
    )


def shares(moves: Moves) -> FloatArray:
    """(T, K) how far each sample's move has gone."""
    out = []
    for grid, move in zip(moves.grids, moves.made, strict=True):
        out.append((grid.time[:-1] + 0.5 * grid.h - move.start) / move.duration)
    return np.stack(out)


def evidence_of(
    held: Held, selection: Selection[Explained], finding: Finding, axis: int, model: str = "declared"
) -> tuple[str, ...]:
    """What the moves show of an axis; `held` are those that judge, by the model before the search, and `model` says
    which that is."""
    noise = held.moves.noise[axis]
    errors, share = held.errors[:, axis] * noise, shares(held.moves)
    parts = [rms(errors[(share >= k / 5) & (share < (k + 1) / 5)]) for k in range(5)]
    worst = int(np.argmax(parts))
    lines = [
        f"residual of the {model} model: {rms(errors):.4g} m/s² against a noise of {noise:.4g}",
        f"largest between {20 * worst} and {20 * worst + 20} % of the move ({parts[worst]:.4g} m/s²)",
    ]
    for word, d in (("positive", 1.0), ("negative", -1.0)):
        if np.any(held.moves.s == d):
            of = errors[held.moves.s == d]
            lines.append(f"{word} moves: {rms(of):.4g} m/s², mean {float(np.nanmean(of)):.3g}")
    lines += in_time(errors, held.moves.s)
    lines.append(f"strongest frequency in the residual: {strongest_frequency(errors, held.moves.h):.0f} Hz")
    if len(held.moves.axes) == 2:
        other = held.errors[:, 1 - axis] * held.moves.noise[1 - axis]
        known = np.isfinite(errors) & np.isfinite(other)
        tie = float(np.corrcoef(errors[known], other[known])[0, 1])
        lines.append(f"correlation with the partner's residual: {tie:.2f}")
    lines.append(
        "where the pinion stands in its gap, and what swings there, is found again in the first 45 % of every held-out "
        "move; the sensor's zero at rest, or as the mean of the recording where something swings in the rests"
    )
    if selection.before.model.fitted.model.bridge and len(held.moves.axes) == 2:
        lines.append(
            "where the two motors stand to each other when the bridge pulls on neither side is one number of a "
            "recording, found again in four whole held-out moves"
        )
    lines += of_motor(float(left_by_motors(selection.before.model.fitted)[axis]), model)
    if finding == "effect":
        after = selection.after.model
        lines.append(
            f"residual with {' and '.join(selection.effects)}: {rms(after.held.errors[:, axis]) * noise:.4g} m/s²; "
            f"{after.announced[axis] * noise:.4g} is to be expected of the right model, by the noise of both sensors "
            "and by what the moves that were fitted do not tell of its numbers"
        )
        lines += zeros_found_again(after.fitted.model.effects)
    both, known = (f(selection.after.model.fitted, axis) for f in (clearance_beside, division_known))
    if finding == "effect" and both:
        lines.append(
            f"the two gaps are {1e6 * both:.1f} µm together; how they divide between flanks and gearbox these moves "
            f"tell to about {1e6 * known:.1f} µm: hold the motor and turn the pinion by hand to measure the "
            "gearbox alone"
        )
    if finding == "unknown":
        lines += of_unknown(selection, axis, model)
    return tuple(lines)


def of_unknown(selection: Selection[Explained], axis: int, model: str) -> list[str]:
    """What an axis' moves show of something that nothing explains."""
    lines, found = [], selection.before.model.fitted
    apart, alike = apart_in_time(found, axis), pure_error(found)
    if apart:
        lines.append(
            f"the {model} model needs channels that are {1e6 * abs(apart):.0f} µs apart in time, more than a "
            "measurement's clocks are: a channel is late, or a stage of the transmission creeps under its force, as a "
            "slipping coupling or a belt does. Check the time stamps, then look for a mark that wanders between motor "
            "and pinion"
        )
    if alike.beyond_any_effect:
        lines.append(
            f"moves of one set-point from one place differ by {alike.apart:.1f} of what is expected, of "
            f"{alike.together:.1f} in all: what acts does not follow the motion, and nothing was searched for that "
            "does. Look for a sensor or a cable that is loose, a clock that jumps, a machine near by that runs, a load "
            "that was changed or a part that warms up, and record again"
        )
    if selection.effects:
        lines.append(f"{', '.join(selection.effects)} explain a part, but not enough to be named")
    return lines


def zeros_found_again(effects: Sequence[DrivenEffect]) -> tuple[str, ...]:
    """Which numbers of the effects every recording has anew, so that the held-out moves were asked for them."""
    names = [p.name.rpartition(".")[2] for effect in effects for p in effect.parameters if p.found_again]
    if not names:
        return ()
    return (f"found again in the first 45 % of the held-out moves: {', '.join(dict.fromkeys(names))}",)


def in_time(errors: FloatArray, direction: FloatArray) -> tuple[str, ...]:
    """How the residual (T, K) changes from move to move, each beside those of its direction (T,); nothing where it does
    not."""
    size = np.sqrt(np.nanmean(errors**2, axis=1))
    size = size / [np.mean(size[direction == d]) for d in direction]
    if len(size) < MOVES or size.max() < CHANGES * size.min():
        return ()
    split = [
        np.abs(size[:k].mean() - size[k:].mean()) * np.sqrt(k * (len(size) - k)) for k in range(1, len(size))
    ]
    after = 1 + int(np.argmax(split))
    stepped = (split[after - 1] / len(size)) ** 2 / np.var(size)
    along = np.corrcoef(np.arange(len(size)), size)[0, 1]
    if max(stepped, along**2) < TELLS:
        return (f"it changes from move to move, up to {size.max() / size.min():.1f} times",)
    if stepped > along**2:
        ratio = size[after:].mean() / size[:after].mean()
        return (
            f"it changes at once after held-out move {after}, to {ratio:.2g} times: a load that is taken up or set "
            "down would do so",
        )
    ratio = size[-1] / size[0]
    return (
        f"it changes steadily along the recording, to {ratio:.2g} times: what drifts (a clock, heat) or dies away "
        "would do so",
    )


def strongest_frequency(errors: FloatArray, h: float) -> float:
    """Frequency [Hz] of the strongest line in the residuals of all moves (T, K)."""
    clean = np.nan_to_num(errors)
    power = np.sum(np.abs(np.fft.rfft(clean * np.hanning(clean.shape[1]), 4096, axis=1)) ** 2, axis=0)
    return float(np.fft.rfftfreq(4096, h)[1:][np.argmax(power[1:])])


def separating_move(selection: Selection[Explained], moves: Moves) -> SeparatingMove:
    """The move that would tell the first pair of rivals apart, from the move that was made.

    What depends on speed or on time shows in another jerk, what depends on direction in two moves the same way,
    what depends on position in a longer travel.
    """
    move, pair = moves.recording.moves[0], set(selection.rivals[0])
    text = f"{' and '.join(selection.rivals[0])} explain these moves alike; "
    if pair & {"position_dependent_force", "position_dependent_backlash", "transmission_ripple"}:
        why = text + "only one changes along the travel"
        return SeparatingMove(4 * move.length, move.jerk, 1, "along the whole travel", why)
    if pair <= {"constant_force", "asymmetric_friction"}:
        why = text + "a slow reversal keeps a force and turns friction over"
        return SeparatingMove(move.length, move.jerk / 4, -1, "as before", why)
    if pair <= {"sensor_latency", "sensor_filter", "speed_filter"}:
        why = text + "a sharper step is delayed by both, and flattened by a filter only"
        return SeparatingMove(move.length, 2 * move.jerk, 1, "as before", why)
    why = text + "a slower, longer move changes speed against acceleration"
    return SeparatingMove(2 * move.length, move.jerk / 4, 1, "as before", why)
