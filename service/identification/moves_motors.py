"""What the motors' torque and speed say of the force that a fit has between motor and load."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from service.backlash.motor_rows import OWN, MotorRows
from service.backlash.moves_fit import Fitted
from service.backlash.moves_predicted import predict
from service.backlash.moves_refined import reconstructed
from service.identification.held_out import SEARCHED, Explained
from service.identification.selection import EXPLAINED, Trial, gone
from service.recording import FloatArray

CONTRADICTED = 1.5
"""What a motor's equation of motion may leave, over the noise, with the force that a model makes: where it is more,
something may be hidden between motor and load (chosen: clean machines leave 1.0 to 1.3, those with impurities up to 7,
and those with two gaps 1.8 and more, before it was counted what a right model's force may be off by)."""
PLAINLY = 2.5
"""How many times more the motors' equations leave than the samples where they speak plainly: then what is hidden is
asked for first, and what was found and is not spoken of otherwise is not what acts (chosen)."""
HARDLY_LESS = 0.75
"""Share of what the motors' equations left before that is gone where the motors speak for a model (chosen)."""
FINEST = 3e-4
"""Shortest length [m] that is looked for in what repeats with a motor's position: its poles and slots are twenty to
a hundred of a turn, and a speed that is sampled each millisecond hardly shows shorter ones (chosen)."""
OFTENEST = 500.0
"""How often at most it is looked for within the span of the moves, so that those all along a rack take no longer
(chosen)."""


def nothing_left(found: Fitted) -> bool:
    """Whether nothing but noise is left of the samples and, together with them, of the motors that were asked."""
    return len(found.motors) > 0 and found.rms_with_motors < SEARCHED


def left_by_motors(found: Fitted) -> FloatArray:
    """RMS of what is left of each motor's equation of motion with the force of a fit, over the noise: (X,); 0 where no
    torque was recorded."""
    left = [np.concatenate(of_motor) for of_motor in zip(*of_moves(found), strict=True)]
    return np.array([np.sqrt(np.mean(rows**2)) for rows in left] or [0.0] * len(found.model.axes))


def reconciled(before: Trial[Explained], trial: Trial[Explained]) -> bool:
    """Whether the motors leave what a clean machine's do, or nearly all is gone by which they contradicted the model
    before."""
    first, left_by = (float(np.max(left_by_motors(t.model.fitted))) for t in (before, trial))
    return left_by <= CONTRADICTED or gone(first, left_by, EXPLAINED)


def plainly_against(present: Trial[Explained], trial: Trial[Explained]) -> bool:
    """Whether the motors contradict a model plainly, and not far less than the present one: what acts is something
    else, of which it is a likeness."""
    before, after = (left_by_motors(t.model.fitted) for t in (present, trial))
    hardly_less = after**2 - 1.0 > (1.0 - HARDLY_LESS) * (before**2 - 1.0)
    return bool(np.any((after > PLAINLY * trial.train_rms) & hardly_less))


def of_moves(found: Fitted) -> list[list[FloatArray]]:
    """What is left of the equation of motion of every motor in every move with the force of a fit, while it moves, over
    the noise (n,), so that its mean square is that of the degrees of freedom, without what cogs; none where no torque
    was recorded."""
    out = []
    for part, local in zip(reconstructed(found, asked=True), found.at.local, strict=True):
        force = predict(part, found.model, found.at.shared[None], local[None]).force()[0]
        of_motors = [
            while_moving(rows, without_cogging(rows, left_of(rows, force[:, x])))
            for x, rows in enumerate(zip(*part.motors, strict=True))
        ]
        out += [list(of_move) for of_move in zip(*of_motors, strict=True)]
    return out


def left_of(rows: Sequence[MotorRows], force: FloatArray) -> list[FloatArray]:
    """What is left of the equation of motion of one motor in every move (n,) with its forces (T, K + 1)."""
    return [one.of(acts[None])[0] for one, acts in zip(rows, force, strict=True)]


def while_moving(rows: Sequence[MotorRows], left: Sequence[FloatArray]) -> list[FloatArray]:
    """What is left in every move, where the motor moves, by the degrees of freedom."""
    out = []
    for one, of_move in zip(rows, left, strict=True):
        moving = one.weight > 0.0
        free = np.maximum(np.sum(moving) - OWN, 1)
        out.append(np.asarray(of_move[moving] * np.sqrt(np.sum(moving) / free)))
    return out


def without_cogging(rows: Sequence[MotorRows], left: Sequence[FloatArray]) -> list[FloatArray]:
    """What is left of the moves (n,) of one motor without the one force that repeats with its position, in all moves
    alike, and takes the most away: every motor cogs, and gaps that are crossed show at times and hardly so."""
    ends, whole = np.cumsum([len(one) for one in left])[:-1], np.concatenate(left)
    if not np.isfinite(whole).all():
        return list(left)
    places = np.concatenate([one.place[one.weight > 0.0] for one in rows])
    span = max(float(np.ptp(places)), FINEST)

    def cogs(waves: float) -> FloatArray:
        """What of the whole goes so often around within the span of the moves."""
        acts = []
        for one in rows:
            angle = 2.0 * np.pi * waves * one.place / span
            acts.append(one.without_own(np.stack((np.cos(angle), np.sin(angle))) * one.weight))
        both = np.concatenate(acts, axis=1)
        return np.asarray(np.linalg.lstsq(both.T, whole, rcond=None)[0] @ both)

    coarse, fine = np.arange(1.0, min(span / FINEST, OFTENEST), 0.25), np.linspace(-0.25, 0.25, 17)
    near = max(coarse, key=lambda waves: float(np.sum(cogs(waves) ** 2)), default=1.0)
    best = max(near + fine, key=lambda waves: float(np.sum(cogs(waves) ** 2)))
    return np.split(whole - cogs(best), ends)
