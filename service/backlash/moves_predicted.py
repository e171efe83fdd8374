"""What a model predicts of the moves of a recording, and what is left of their samples beside it."""

from __future__ import annotations

import numpy as np

from service.backlash.moves import Moves
from service.backlash.signals import summed
from service.dynamics.driven import Course, course_of
from service.dynamics.driven_model import Model, Values
from service.dynamics.driven_motion import of_motors
from service.dynamics.driven_reconstruction import answered
from service.dynamics.effects.driven_bodies import WANDER
from service.recording import FloatArray

REST_SPREAD = np.array([6e-5, 5e-4])
"""Prior of the load's position [m] and speed [m/s] at the start of a move, against the driving flank: anywhere in a
gap of some 10 to 200 µm, and nearly at rest."""

TOGETHER = 24
"""Sets simulated in one pass: about as many as a single axis' model has coordinates; more cost 0.5 to 1 MB each."""


def motor_coefficients(moves: Moves, skews: FloatArray) -> FloatArray:
    """Motor motion of every set, move and axis on the grid: skews (S, X) [s] -> (S, T, K, X, 5)."""
    return of_motors(moves.motion, moves.start, moves.h, moves.samples, skews)


def predict(moves: Moves, model: Model, shared: FloatArray, local: FloatArray) -> Course:
    """Simulate sets of coordinates: shared (S, P), local (S, T, L), L = 2·X + the effects' nuisances.

    Where the motors' motion was reconstructed, it answers to the force that a set makes: otherwise a fit would take
    the error of its input for a change of the structure, and come nearer only from one reconstruction to the next.
    """
    values = model.complete(model.values(shared))
    c = motor_coefficients(moves, np.stack([values[f"{a}.skew"] for a in model.axes], axis=1))
    said = simulated(moves, model, shared, local, c)
    if moves.reference is None:
        return said
    c += answered(np.nan_to_num(said.force() - moves.reference), moves.echoes, moves.h)
    return simulated(moves, model, shared, local, c)


def simulated(moves: Moves, model: Model, shared: FloatArray, local: FloatArray, c: FloatArray) -> Course:
    """As `predict`, for a given motion of the motors c (S, T, K, X, 5), whose K may go beyond the moves' end."""
    free = model.values(shared)
    values = model.complete(free)
    S, X = len(shared), len(model.axes)
    load = np.empty((S, len(moves.grids), X, 2))
    own = local[:, :, : 2 * X] + moves.loads
    for x, name in enumerate(model.axes):
        behind = 0.5 * moves.s * values[f"{name}.backlash"][:, None]
        load[:, :, x, 0] = c[:, :, 0, x, 0] - behind + own[:, :, 2 * x] * REST_SPREAD[0]
        load[:, :, x, 1] = c[:, :, 0, x, 1] + own[:, :, 2 * x + 1] * REST_SPREAD[1]
    nuisance = np.empty((S, len(moves.grids), len(model.nuisance)))
    begun = left_over(moves, model, values)
    for k, p in enumerate(model.nuisance):
        width = moves.swings.width if moves.swings and p.name in begun else 1.0
        width = moves.apart if p.name == WANDER else width
        nuisance[..., k] = p.value(width * local[..., 2 * X + k]) + begun.get(p.name, 0.0)
    return course_of(model, free, c, moves.s, load, moves.h, nuisance, moves.start)


def left_over(moves: Moves, model: Model, values: Values) -> dict[str, FloatArray]:
    """What the moves before leave swinging at the beginning of each move, or is heard then: (S, T) by name, in their
    units."""
    out = {name: value[None] for name, value in moves.heard.items()}
    if (swings := moves.swings) is not None:
        for effect in model.effects:
            if effect.states:
                out.update(effect.swung(values, swings.released, swings.rest))
    return out


def residuals(moves: Moves, said: Course) -> FloatArray:
    """(measured − predicted) of the samples used, over the standard deviation that is expected of it, and behind those
    of each move what its motors say of the force: (S, N)."""
    difference = (moves.measured - said.acceleration()) / moves.noise[:, None]
    over = (
        moves.wander.whitened(difference, moves.used)
        if moves.white and moves.wander
        else difference / moves.expected
    )
    if moves.lasting:
        over = summed(np.where(moves.used, over, 0.0), np.exp(-moves.h / moves.lasting))
    if not moves.motors:
        return np.asarray(over[:, moves.used])
    force, parts = said.force(), []
    for t, own in enumerate(moves.motors):
        parts += [over[:, t][:, moves.used[t]], *(rows.of(force[:, t, x]) for x, rows in enumerate(own))]
    return np.concatenate(parts, axis=1)


def misfits(moves: Moves, model: Model, shared: FloatArray, local: FloatArray) -> FloatArray:
    """Residuals (S, N) of sets of coordinates, see `predict`, a few simulated at a time."""
    parts = [slice(k, k + TOGETHER) for k in range(0, len(shared), TOGETHER)]
    return np.concatenate(
        [residuals(moves, predict(moves, model, shared[part], local[part])) for part in parts]
    )
