"""What one step says about the gap: the model's own sensitivities, with everything else as nuisance.

One step forth and one back are simulated at the accelerometer's rate with the motor on its nominal trajectory, at a
point and around it in every coordinate of the fit; the differences over the noise give the Fisher information, of
which the load's state at the start of each step is marginalised.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from service.dynamics.driven import Response, simulate
from service.dynamics.driven_model import LINKS, Model
from service.dynamics.driven_motion import coefficients
from service.dynamics.trajectory import JerkLimitedStep
from service.recording import FloatArray

PART = (0.3, 0.97)
"""Share of T that is simulated, as the fit does: before it the axis still rings from its start."""

SETTLING, LOW_SPEED = 0.004, 0.15
"""Not compared: the first [s], and what is slower than this share of v_max, where friction may turn; as the fit."""

STATE_SPREAD = np.array([1e-5, 1e-2])
"""Prior of the load's position [m] and speed [m/s] at the start of a step, against the flank; as the fit."""

DIFFERENCE = 1e-4


@dataclass(frozen=True)
class Sensing:
    """Sampling rates [Hz], noise of one acceleration sample and the sensor's range [m/s²], LSB of the speed [m/s]."""

    speed_rate: float = 1000.0
    acceleration_rate: float = 4000.0
    noise: float = 0.05
    range: float = 78.0
    speed_lsb: float = 1.6e-5


def machine(model: Model, b: float, shift: float) -> FloatArray:
    """Coordinates (P,) of a machine with the gap b: stiffer and smoother by `shift` prior standard deviations."""
    point = np.zeros(len(model.parameters))
    for k, p in enumerate(model.parameters):
        name = p.name.rpartition(".")[2]
        if name == "backlash":
            point[k] = p.internal(b)
        elif name.endswith("stiffness"):
            point[k] = shift
        elif name in ("coulomb", "viscous"):
            point[k] = -shift
    return point


@dataclass(frozen=True)
class Sampled:
    """Responses at a point and around it in every coordinate, on the times (K + 1,) [s]; used : (K,) bool.

    Sets: the point, then one per shared coordinate (P), then one per coordinate of the axes' initial states (2 X).
    """

    time: FloatArray
    response: Response
    used: NDArray[np.bool_]


def sampled(model: Model, point: FloatArray, step: JerkLimitedStep, sensing: Sensing) -> Sampled:
    """Simulate one step forth and one back at the accelerometer's rate, the motor on its nominal trajectory."""
    P, X, h = len(point), len(model.axes), 1.0 / sensing.acceleration_rate
    S, K = 1 + P + 2 * X, int((PART[1] - PART[0]) * step.duration / h)
    start = PART[0] * step.duration
    sets = np.tile(point, (S, 1))
    sets[1 + np.arange(P), np.arange(P)] += DIFFERENCE
    values = {p.name: p.value(sets[:, k]) for k, p in enumerate(model.parameters)}
    fine = np.arange(0.0, step.duration + 2 * h, 0.5 * h)
    moving = CubicSpline(fine, step.speed(fine)).antiderivative()
    skews = np.stack([values[f"{axis}.skew"] for axis in model.axes], axis=1)
    s = np.array([1.0, -1.0])
    c = np.empty((S, 2, K, X, 5))
    for row in range(S):
        for x in range(X):
            forward = coefficients(moving, start + float(skews[row, x]), h, K)
            c[row, :, :, x] = s[:, None, None] * forward
    load = _load_start(model, values, c, s, h)
    for j in range(2 * X):
        load[1 + P + j, :, j // 2, j % 2] += DIFFERENCE * STATE_SPREAD[j % 2]
    time = np.asarray(start + h * np.arange(K + 1), dtype=np.float64)
    middle = time[:-1] + 0.5 * h
    speed = step.speed(middle)
    used = (middle > start + SETTLING) & ((speed > LOW_SPEED * step.v_max) | (middle < 0.5 * step.duration))
    return Sampled(time, simulate(model, values, c, s, load, h), used)


def _load_start(
    model: Model, values: dict[str, FloatArray], c: FloatArray, s: FloatArray, h: float
) -> FloatArray:
    """Load position and speed (S, 2, X, 2) where the driving flank holds the load at the motor's acceleration."""
    out = np.empty((*c.shape[:2], len(model.axes), 2))
    for x, name in enumerate(model.axes):
        links = (*LINKS[model.lumps], "contact")
        k = 1.0 / np.sum([1.0 / values[f"{name}.{link}_stiffness"] for link in links], axis=0)
        x_mot, v, a = (c[:, :, 0, x, j] for j in range(3))
        pull = a + s * values[f"{name}.coulomb"][:, None] + values[f"{name}.viscous"][:, None] * v
        out[:, :, x, 0] = x_mot - pull / k[:, None] - 0.5 * s * values[f"{name}.backlash"][:, None]
        out[:, :, x, 1] = v
    return out


def information(model: Model, sampled: Sampled, sensing: Sensing) -> FloatArray:
    """Information of one step forth and one back about the shared coordinates (P, P), initial states marginalised."""
    P, X = len(model.parameters), len(model.axes)
    total = np.zeros((P, P))
    for t in range(2):
        a = sampled.response.acceleration[:, t][:, :, sampled.used].reshape(1 + P + 2 * X, -1)
        J = (a[1:] - a[0]) / (DIFFERENCE * sensing.noise)
        shared, local = J[:P], J[P:]
        own = local @ local.T + np.eye(2 * X)
        cross = shared @ local.T
        total += shared @ shared.T - cross @ np.linalg.solve(own, cross.T)
    return total
