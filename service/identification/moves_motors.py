"""What the motors' torque and speed say of the force that a fit has between motor and load."""

from __future__ import annotations

import numpy as np

from service.backlash.motor_rows import OWN, MotorRows
from service.backlash.moves import predict
from service.backlash.moves_fit import Fitted, reconstructed
from service.recording import FloatArray

CONTRADICTED = 1.5
"""What a motor's equation of motion may leave, over the noise, with the force that a model makes: where it is more,
something may be hidden between motor and load (chosen: clean machines leave 1.0 to 1.3, those with impurities up to 7,
and those with two gaps 1.8 and more)."""


def left_by_motors(found: Fitted) -> FloatArray:
    """RMS of what is left of each motor's equation of motion with the force of a fit, over the noise: (X,); 0 where no
    torque was recorded."""
    left = [np.concatenate(of_motor) for of_motor in zip(*of_moves(found), strict=True)]
    return np.array([np.sqrt(np.mean(rows**2)) for rows in left] or [0.0] * len(found.model.axes))


def of_moves(found: Fitted) -> list[list[FloatArray]]:
    """What is left of the equation of motion of every motor in every move with the force of a fit, while it moves, over
    the noise (n,), so that its mean square is that of the degrees of freedom; none where no torque was recorded."""
    out = []
    for part, local in zip(reconstructed(found, asked=True, by_noise=True), found.at.local, strict=True):
        force = predict(part, found.model, found.at.shared[None], local[None]).force()[0]
        for of_move, acts in zip(part.motors, force, strict=bool(part.motors)):
            out.append([while_moving(rows, acts[x]) for x, rows in enumerate(of_move)])
    return out


def while_moving(rows: MotorRows, force: FloatArray) -> FloatArray:
    """The rows of one motor in one move with a force (K + 1,), where it moves."""
    moving = rows.weight > 0.0
    free = np.maximum(np.sum(moving) - OWN, 1)
    return np.asarray(rows.of(force[None])[0][moving] * np.sqrt(np.sum(moving) / free))
