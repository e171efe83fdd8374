"""Forward model: the load's acceleration predicted from the measured motion of the motor, eqs. (2)-(9).

What a fit compares with the accelerometer. The structure and its parameters are in driven_model (effects that
the paper's model lacks are appended there), the motor's motion in driven_motion, and the propagation, exact
between contact events, in driven_propagation. All parameter sets and all steps are lanes of one pass.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import factorial

import numpy as np

from service.dynamics.driven_effect import Case
from service.dynamics.driven_model import LINKS, Cases, Model, Values, assemble, spring_damper
from service.dynamics.driven_propagation import run
from service.dynamics.driven_recoil import Recoil
from service.recording import FloatArray


@dataclass(frozen=True)
class Response:
    """What the model says; X axes, S parameter sets, T steps, K intervals.

    Attributes
    ----------
    acceleration : (S, T, X, K) mean over each interval [m/s²], as the sensor would give it
    force : (S, T, X, K + 1) on the motor per moved mass [m/s²]
    relative : (S, T, X, K + 1) pinion minus load [m]; half the backlash is where a flank touches
    recoil : (S, T, X, K + 1, 2) of the motors, position [m] and speed [m/s]; None where the model has none
    """

    acceleration: FloatArray
    force: FloatArray
    relative: FloatArray
    recoil: FloatArray | None = None


LYING = 3
"""How often the place of a load is found anew from how wide the gap is there: each leaves as much of what is missing as
the gap gets wider along the rack, a tenth at most."""


def wider(cases: Cases, place: FloatArray) -> FloatArray:
    """How much wider than declared the gaps are [m] where the loads are, both (S, T, X)."""
    return sum((effect.wider(place, own) for effect, own, _ in cases), np.zeros_like(place))


def lying(cases: Cases, load: FloatArray, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The loads (S, T, X, 2) as far from their driving flanks as they were said to be from those of the declared gaps,
    for steps in the directions s (T,); and how much wider the gaps are there (S, T, X)."""
    out, more = load.copy(), np.zeros(load.shape[:-1])
    for _ in range(LYING):
        more = wider(cases, out[..., 0])
        out[..., 0] = load[..., 0] - 0.5 * s[:, None] * more
    return out, more


def initial_states(
    model: Model, values: Values, motor: FloatArray, load: FloatArray, wider: FloatArray
) -> FloatArray:
    """States at the first grid point, (S, T, n), from motor and load (S, T, X, 2) position [m] and speed [m/s], the
    gaps being `wider` (S, T, X) [m] than declared.

    The lumps between them start where the springs balance, so that no fast mode is excited.
    """
    x = np.zeros((*motor.shape[:2], model.n))
    for axis, name in enumerate(model.axes):
        first, at = axis * model.states_per_axis, model.load(axis)
        x[..., at : at + 2] = load[:, :, axis]
        half = 0.5 * (values[f"{name}.backlash"][:, None] + wider[..., axis])
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
    """Force on the motor per moved mass [m/s²]: states (S, T, K, n), motor (S, T, X, K, 2) -> (S, T, X, K)."""
    out = np.empty(motor.shape[:-1])
    for axis, name in enumerate(model.axes):
        first = axis * model.states_per_axis
        stretch = motor[:, :, axis] - states[..., first : first + 2]
        k, d = (
            law[:, None, None] for law in spring_damper(values, name, (*LINKS[model.lumps], "contact")[0])
        )
        half = 0.0 if model.lumps else 0.5 * values[f"{name}.backlash"][:, None, None]
        beyond = stretch[..., 0] - np.clip(stretch[..., 0], -half, half)
        force = k * beyond + d * stretch[..., 1] * (beyond != 0.0)
        pushing = True if model.lumps else force * beyond > 0.0
        out[:, :, axis] = np.where(pushing, force, 0.0)
    return out


@dataclass(frozen=True)
class Course:
    """Simulated sets; what is not asked for is not computed.

    Attributes
    ----------
    cases : the model's effects, see Model.cases
    c : (S, T, K, X, 5) motion of the motors as it drives the chain
    states : (S, T, K + 1, n)
    """

    model: Model
    values: Values
    cases: Cases
    c: FloatArray
    states: FloatArray
    h: float

    def only(self, k: int) -> Course:
        """One of the sets."""
        values = {name: value[k : k + 1] for name, value in self.values.items()}
        return replace(self, values=values, c=self.c[k : k + 1], states=self.states[k : k + 1])

    def acceleration(self) -> FloatArray:
        """As in Response."""
        loads = [self.model.load(a) + 1 for a in range(len(self.model.axes))]
        predicted = np.stack([np.diff(self.states[..., load], axis=2) for load in loads], axis=2) / self.h
        for effect, own, _ in self.cases:
            predicted = effect.measure(predicted, own)
        return predicted

    def recoil(self) -> FloatArray | None:
        """As in Response."""
        given = [effect.of(self.states, room) for effect, _, room in self.cases if isinstance(effect, Recoil)]
        return given[0] if given else None

    def motor(self) -> FloatArray:
        """(S, T, X, K + 1, 2) position and speed of what pushes the first spring."""
        recoil = self.recoil()
        moved = np.concatenate((self.c[..., :2], ends(self.c[:, :, -1:], self.h)), axis=2).swapaxes(2, 3)
        return moved if recoil is None else moved + recoil

    def force(self) -> FloatArray:
        """As in Response."""
        return motor_force(self.model, self.values, self.states, self.motor())

    def relative(self) -> FloatArray:
        """As in Response."""
        axes, motor = range(len(self.model.axes)), self.motor()
        return np.stack([relative_position(self.model, self.states, motor, a) for a in axes], axis=2)

    def response(self) -> Response:
        return Response(self.acceleration(), self.force(), self.relative(), self.recoil())


def simulate(
    model: Model,
    values: Values,
    c: FloatArray,
    s: FloatArray,
    load: FloatArray,
    h: float,
    nuisance: FloatArray | None = None,
    start: FloatArray | None = None,
) -> Response:
    """All that the model says, see `course_of`."""
    return course_of(model, values, c, s, load, h, nuisance, start).response()


def course_of(
    model: Model,
    values: Values,
    c: FloatArray,
    s: FloatArray,
    load: FloatArray,
    h: float,
    nuisance: FloatArray | None = None,
    start: FloatArray | None = None,
) -> Course:
    """Simulate all parameter sets and steps as lanes of one pass.

    Parameters
    ----------
    values : (S,) of every free parameter of the model
    c : (S, T, K, X, 5) motor motion, see driven_motion.coefficients; already shifted by the skew
    s : (T,) directions
    load : (S, T, X, 2) load position [m] and speed [m/s] at the first grid point; where effects make a gap wider there,
        the load is as far from its driving flank as it is by this from that of the declared gap
    h : grid interval [s]
    nuisance : (S, T, len(model.nuisance)) the effects' own coordinates of every step, in their units; 0 by default
    start : (T,) time of the first grid point since the recording began [s]; only a drift asks for it
    """
    S, T = c.shape[:2]
    case = Case(
        model,
        model.complete(values),
        np.zeros((S, T, len(model.nuisance))) if nuisance is None else nuisance,
        s,
        np.zeros(T) if start is None else start,
        h,
    )
    cases = tuple(model.cases(case))
    for effect, own, _ in cases:
        c = effect.drive(c, own)
    cases = tuple((effect, replace(own, c=c), room) for effect, own, room in cases)
    system = assemble(model, case, cases)
    x0 = initial_states(model, case.values, c[:, :, 0, :, :2], *lying(cases, load, s))
    for effect, own, room in cases:
        effect.begin(x0, own, room)

    def states_after(before: FloatArray | None = None) -> FloatArray:
        followed = [effect.follow(c, own, before) for effect, own, _ in cases if effect.motions]
        moved = np.concatenate((c, *followed), axis=3) if followed else c
        return run(system, x0, moved, np.stack((np.ones(T), s), axis=1), h)

    states = states_after()
    for _ in range(max((effect.turns for effect in model.effects), default=0)):
        states = states_after(states)
    return Course(model, case.values, cases, c, states, h)


def ends(c: FloatArray, h: float) -> FloatArray:
    """Position and speed at the end of intervals of length h: c (…, J) -> (…, 2)."""
    powers = np.array([h**i / factorial(i) for i in range(c.shape[-1])])
    return np.stack((c @ powers, c[..., 1:] @ powers[:-1]), axis=-1)


def relative_position(model: Model, states: FloatArray, motor: FloatArray, axis: int) -> FloatArray:
    """Pinion minus load [m] on the grid: (S, T, K + 1)."""
    pinion = model.pinion(axis)
    touching = motor[:, :, axis, :, 0] if pinion is None else states[..., pinion]
    return np.asarray(touching - states[..., model.load(axis)])
