"""The loads' accelerations by their balance of forces, eqs. (4) and (9), along their own measured motion.

Nothing is simulated: where each load is comes from its accelerometer, integrated from the first grid point, and
contact, friction and bridge there are what the parameters make of it. An error in one sample is not carried on into
the next, so that a search finds its way from far off, where a simulation that has once lost the contact says
nothing. For a value it is too coarse: the integrated noise is taken for motion.

Shapes: S parameter sets, T steps, X axes, K intervals.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from service.dynamics.driven import Response
from service.dynamics.driven_model import LINKS, Model, Values, spring_damper
from service.recording import FloatArray


@dataclass(frozen=True)
class Along:
    """What was measured, in the middle of the intervals.

    Attributes
    ----------
    motor : (T, X, K, 3) position [m], speed [m/s] and acceleration [m/s²] of the motors
    load : (T, X, K, 3) position [m] and speed [m/s] that the loads gained since the first grid point, and their mean
        acceleration [m/s²]
    time : (K,) since the first grid point [s]
    """

    motor: FloatArray
    load: FloatArray
    time: FloatArray

    def motors(self, skews: FloatArray, added: FloatArray) -> FloatArray:
        """Position and speed of the motors (S, T, X, K, 2) at skews (S, X) [s], with (S, T, X, 1) [m] added."""
        x, v, a = np.moveaxis(self.motor, -1, 0)
        skew = skews[:, None, :, None]
        return np.stack((x + skew * v + 0.5 * skew**2 * a + added, v + skew * a), axis=-1)

    def first_steps(self, n: int) -> Along:
        """The same for the first n steps."""
        return replace(self, motor=self.motor[:n], load=self.load[:n])


@dataclass(frozen=True)
class Balanced:
    """What the balance says of all sets, as a driven.Course does what a simulation says.

    Attributes
    ----------
    accelerations, forces : (S, T, X, K), (S, T, X, K + 1), see balance
    """

    accelerations: FloatArray
    forces: FloatArray

    def only(self, k: int) -> Balanced:
        return Balanced(self.accelerations[k : k + 1], self.forces[k : k + 1])

    def acceleration(self) -> FloatArray:
        return self.accelerations

    def force(self) -> FloatArray:
        return self.forces

    def recoil(self) -> None:
        return None

    def response(self) -> Response:
        return Response(self.accelerations, self.forces, np.zeros((len(self.forces), 0)))


def along(motor: FloatArray, measured: FloatArray, h: float) -> Along:
    """Motors (T, K, X, 5), see driven_motion.coefficients, and loads by their mean accelerations (T, X, K), where
    lost samples (NaN) are closed by straight lines."""
    a = np.array(measured)
    for row in a.reshape(-1, a.shape[-1]):
        lost = ~np.isfinite(row)
        row[lost] = np.interp(np.flatnonzero(lost), np.flatnonzero(~lost), row[~lost])
    v = np.cumsum(a, axis=-1) * h - 0.5 * a * h
    x = np.cumsum(v, axis=-1) * h - 0.5 * v * h
    half = 0.5 * h
    taylor = np.array(
        [[1.0, half, half**2 / 2.0, half**3 / 6.0], [0.0, 1.0, half, half**2 / 2.0], [0.0, 0.0, 1.0, half]]
    )
    middle = (motor[..., :4] @ taylor.T).swapaxes(1, 2)
    time = np.asarray((np.arange(a.shape[-1]) + 0.5) * h, dtype=np.float64)
    return Along(middle, np.stack((x, v, a), axis=-1), time)


def balance(
    model: Model, values: Values, s: FloatArray, seen: Along, motor: FloatArray, load: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Accelerations of the loads (S, T, X, K) [m/s²] by a model whose lumps move with their load, and the forces on the
    motors (S, T, X, K + 1) per moved mass [m/s²] by what was measured.

    Parameters
    ----------
    s : (T,) directions
    motor : (S, T, X, K, 2) position [m] and speed [m/s] of the motors
    load : (S, T, X, 2) the same of the loads at the first grid point
    """
    x = load[..., :1] + load[..., 1:] * seen.time + seen.load[..., 0]
    v = load[..., 1:] + seen.load[..., 1]
    held, predicted, needed = pull(model, values, x, v), np.empty_like(x), np.empty_like(x)
    for axis, name in enumerate(model.axes):
        stretch, rate = motor[:, :, axis, :, 0] - x[:, :, axis], motor[:, :, axis, :, 1] - v[:, :, axis]
        coulomb, viscous, constant = (
            values[f"{name}.{law}"][:, None, None] for law in ("coulomb", "viscous", "constant")
        )
        a = seen.load[:, axis, :, 2]
        rest = constant + held[axis] - s[:, None] * coulomb - viscous * v[:, :, axis]
        soft, inert, mass, damped = in_series(model, values, name)
        wound = stretch - inert * a
        depth = np.abs(wound) - 0.5 * values[f"{name}.backlash"][:, None, None]
        push = np.maximum(0.0, depth / soft + damped * rate * np.sign(wound))
        predicted[:, :, axis] = np.where(depth > 0.0, push, 0.0) * np.sign(wound) + rest
        needed[:, :, axis] = (1.0 + mass) * a - rest
    middle = 0.5 * (needed[..., 1:] + needed[..., :-1])
    return predicted, np.concatenate((needed[..., :1], middle, needed[..., -1:]), axis=-1)


def pull(model: Model, values: Values, x: FloatArray, v: FloatArray) -> list[FloatArray | float]:
    """What the bridge gives each load per its mass (S, T, K), from their positions and speeds (S, T, X, K)."""
    if len(model.axes) == 1:
        return [0.0]
    k, d, offset, ratio = (
        values[name][:, None, None]
        for name in ("bridge_stiffness", "bridge_damping", "bridge_offset", "mass_ratio")
    )
    force = k * (x[:, :, 1] - x[:, :, 0] + offset) + d * (v[:, :, 1] - v[:, :, 0])
    return [force, -force / ratio]


def in_series(
    model: Model, values: Values, axis: str
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Links and contact of one axis as one spring, (S, 1, 1) each: compliance [s²], what its lumps' own acceleration
    winds it up by [s²], their mass, and its damping [1/s]."""
    links = (*LINKS[model.lumps], "contact")
    laws = [spring_damper(values, axis, link) for link in links]
    masses = [values[f"{axis}.{link}_mass"] for link in LINKS[model.lumps]]
    soft, inert, behind = np.zeros((3, len(laws[0][0])))
    for (k, _), mass in zip(reversed(laws), (np.zeros_like(soft), *reversed(masses)), strict=True):
        behind = behind + mass
        soft, inert = soft + 1.0 / k, inert + behind / k
    damped = np.sum([d / (k * soft) ** 2 for k, d in laws], axis=0)
    return soft[:, None, None], inert[:, None, None], behind[:, None, None], damped[:, None, None]
