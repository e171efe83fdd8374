"""Forward model: the load's acceleration predicted from the measured motion of the motor, eqs. (2)-(9).

What a fit compares with the accelerometer. The structure and its parameters are in driven_model (effects that
the paper's model lacks are appended there), the motor's motion in driven_motion, and the propagation, exact
between contact events, in driven_propagation. All parameter sets and all steps are lanes of one pass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from service.dynamics.driven_model import LINKS, Model, Values, assemble, spring_damper
from service.dynamics.driven_propagation import Propagation
from service.recording import FloatArray


@dataclass(frozen=True)
class Response:
    """What the model says; X axes, S parameter sets, T steps, K intervals.

    Attributes
    ----------
    acceleration : (S, T, X, K) mean over each interval [m/s²], as the sensor would give it
    force : (S, T, X, K + 1) on the motor per moved mass [m/s²]
    relative : (S, T, X, K + 1) pinion minus load [m]; half the backlash is where a flank touches
    """

    acceleration: FloatArray
    force: FloatArray
    relative: FloatArray


def initial_states(model: Model, values: Values, motor: FloatArray, load: FloatArray) -> FloatArray:
    """States at the first grid point, (S, T, n), from motor and load (S, T, X, 2) position [m] and speed [m/s].

    The lumps between them start where the springs balance, so that no fast mode is excited.
    """
    x = np.zeros((*motor.shape[:2], model.n))
    for axis, name in enumerate(model.axes):
        first, at = axis * model.states_per_axis, model.load(axis)
        x[..., at : at + 2] = load[:, :, axis]
        half = 0.5 * values[f"{name}.backlash"][:, None]
        wind_up = motor[:, :, axis] - load[:, :, axis]
        gap = np.clip(wind_up[..., 0], -half, half)
        touching = np.abs(wind_up[..., 0]) > half
        soft = [
            1.0 / values[f"{name}.{link}_stiffness"][:, None] for link in (*LINKS[model.lumps], "contact")
        ]
        for body in range(model.lumps):
            share = sum(soft[: body + 1]) / sum(soft)
            x[..., first + 2 * body] = motor[:, :, axis, 0] - share * (wind_up[..., 0] - gap)
            x[..., first + 2 * body + 1] = motor[:, :, axis, 1] - touching * share * wind_up[..., 1]
    return x


def motor_force(model: Model, values: Values, states: FloatArray, motor: FloatArray) -> FloatArray:
    """Force on the motor per moved mass [m/s²]: states (P, S, T, n), motor (P, S, T, X, 2) -> (P, S, T, X)."""
    out = np.empty(motor.shape[:-1])
    for axis, name in enumerate(model.axes):
        first = axis * model.states_per_axis
        stretch = motor[..., axis, :] - states[..., first : first + 2]
        k, d = spring_damper(values, name, (*LINKS[model.lumps], "contact")[0])
        half = 0.0 if model.lumps else 0.5 * values[f"{name}.backlash"][:, None]
        beyond = stretch[..., 0] - np.clip(stretch[..., 0], -half, half)
        force = k[:, None] * beyond + d[:, None] * stretch[..., 1] * (beyond != 0.0)
        pushing = True if model.lumps else force * beyond > 0.0
        out[..., axis] = np.where(pushing, force, 0.0)
    return out


def simulate(
    model: Model, values: Values, c: FloatArray, s: FloatArray, load: FloatArray, h: float
) -> Response:
    """Simulate all parameter sets and steps as lanes of one pass.

    Parameters
    ----------
    values : (S,) each
    c : (S, T, K, X, 5) motor motion, see driven_motion.coefficients; already shifted by the skew
    s : (T,) directions
    load : (S, T, X, 2) load position [m] and speed [m/s] at the first grid point
    h : grid interval [s]
    """
    S, T, K, X, _ = c.shape
    system = assemble(model, values)
    run = Propagation(system, c, s, h)
    x0 = initial_states(model, values, c[:, :, 0, :, :2], load)
    states = run.run(x0.reshape(S * T, -1)).reshape(K + 1, S, T, model.n)
    motor = np.empty((K + 1, S, T, X, 2))
    motor[:-1] = c[..., :2].transpose(2, 0, 1, 3, 4)
    motor[-1] = 2.0 * motor[-2] - motor[-3]
    speeds = states[..., [model.load(a) + 1 for a in range(X)]]
    predicted = np.diff(speeds, axis=0).transpose(3, 1, 2, 0) / h
    for effect in model.effects:
        predicted = effect.measure(predicted, model, values)
    relative = states @ system.relative.T + system.motor_share * motor[..., 0]
    force = motor_force(model, values, states, motor)
    return Response(
        predicted.transpose(1, 2, 0, 3), force.transpose(1, 2, 3, 0), relative.transpose(1, 2, 3, 0)
    )
