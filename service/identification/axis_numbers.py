"""What a fit of an axis' moves says of its numbers: values with standard deviations, and the backlash."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from service.backlash.moves_fit import Fitted
from service.dynamics.effects.driven_transmission import TYPICAL_PUSH, DrivenLocalBacklash
from service.identification.held_out import judged_rms
from service.identification.moves_motors import nothing_left
from service.recording import FloatArray

LAW = 0.5
"""Standard deviation of where a bent flank begins to push, over its bend and the depth at which its force is the
sensor's noise. Chosen: what the law of its force is at smaller depths no sample shows, and the stronger it is bent, the
farther from each other the laws that are alike above."""
CROSSED = 0.6
"""Share of a move at which its gap is crossed, about: after the top speed, at two thirds of the braking."""
STRUCTURE = (0.11e-6, 1.2e-3)
"""Standard deviation of what the structure is worth: floor [m] and share of the backlash, as in the estimator."""
UNTIMELY = 3.0
"""Standard deviations of its prior from which on a clock's offset is none of a measurement whose channels are in time
(chosen: 90 µs)."""
SPLIT, UNSURE = 0.06, 0.12
"""Standard deviation of how two gaps in series divide what they are together, as a share of that, where nothing is left
of samples and motors, and elsewhere. Chosen: the fit has a valley every few micrometres of the split, and the deepest
is not always the right one; of twelve machines ten were off by up to 0.04, one by 0.10 with nothing left, and one by
0.12 with something left."""

MISFIT, ENDED = 0.03, 1.05
"""Standard deviation of a backlash of a model that leaves something of the moves that were fitted, as a share of it, by
what is left beyond that RMS, over what is expected: what such a model lacks it puts in part into the gap, however
closely that is known (chosen: of 34 declared models that lacked something other than a second gap, and left 1.05 to 3,
21 were within their interval without it and 31 with it)."""


def apart_in_time(found: Fitted, axis: int) -> float:
    """By how much the channels of an axis would have to be apart in time [s], if that is more than a measurement's
    clocks are, else 0: what a fit needs this for is another effect."""
    name = f"{found.model.axes[axis]}.clock_offset"
    of = {p.name: (p, float(u)) for p, u in zip(found.model.parameters, found.at.shared, strict=True)}
    parameter, u = of.get(name, (None, 0.0))
    return float(parameter.value(u)) if parameter and abs(u) > UNTIMELY else 0.0


def covariance(found: Fitted) -> FloatArray:
    """(P, P) of the shared coordinates, robust against coloured residuals: moves are taken as the independent
    blocks (the sandwich of Huber and White), but never less than by white noise."""
    P = len(found.model.parameters)
    J = found.slopes.dense()
    H = np.linalg.inv(J.T @ J + np.eye(J.shape[1]))
    scores, first = [], 0
    for part in found.moves:
        move_of = np.nonzero(part.used)[0]
        rows = slice(first, first + len(move_of))
        weighted = J[rows] * found.r[rows, None]
        scores += [weighted[move_of == t].sum(axis=0) for t in range(len(part.grids))]
        first += len(move_of)
    meat = np.stack(scores).T @ np.stack(scores) * len(scores) / max(1, len(scores) - 1)
    sandwich, plain = (H @ meat @ H)[:P, :P], H[:P, :P] * max(1.0, found.rms**2)
    size = np.sqrt(np.maximum(np.diag(sandwich) / np.maximum(np.diag(plain), 1e-300), 1.0))
    return np.asarray(plain * np.outer(size, size))


def deviations(found: Fitted) -> Mapping[str, tuple[float, float]]:
    """Value and standard deviation of every parameter in its unit."""
    spread = np.sqrt(np.diag(covariance(found)))
    names = [p.name for p in found.model.parameters]
    return {n: (found.value(n), abs(slope_of(found, k)) * float(spread[k])) for k, n in enumerate(names)}


def backlash_of(found: Fitted, axis: int) -> tuple[float, float]:
    """Backlash of an axis where its moves crossed the gap, and its standard deviation [m]."""
    name = found.model.axes[axis]
    names = [p.name for p in found.model.parameters]
    k, gradient = names.index(f"{name}.backlash"), np.zeros(len(names))
    b, gradient[k] = found.value(names[k]), slope_of(found, k)
    for effect in found.model.effects:
        if isinstance(effect, DrivenLocalBacklash):
            wider, more = widening(found, effect, axis)
            b, gradient = b + wider, gradient + more
    floor, share = STRUCTURE
    laws = division_known(found, axis) ** 2 + (LAW * unseen_depth(found, axis)) ** 2
    variance = float(gradient @ covariance(found) @ gradient) + laws
    return b, float(np.hypot(np.sqrt(variance), max(1.0, found.rms) * np.hypot(floor, share * b)))


def interval_95(found: Fitted, axis: int, foretold: float = 1.0) -> tuple[float, tuple[float, float]]:
    """Backlash of an axis and its 95 % interval [m], with what the model lacks, of a fit that leaves so much of moves
    that it has `foretold`, over what is expected."""
    b, std = backlash_of(found, axis)
    std = float(np.hypot(std * max(1.0, foretold), misfit(found, axis)))
    return b, (max(0.0, b - 1.96 * std), b + 1.96 * std)


def misfit(found: Fitted, axis: int) -> float:
    """Standard deviation of the backlash of an axis for what the model lacks [m]."""
    gap = found.value(f"{found.model.axes[axis]}.backlash")
    return MISFIT * gap * float(np.sqrt(max(0.0, judged_rms(found) ** 2 - ENDED**2)))


def clearance_beside(found: Fitted, axis: int) -> float:
    """The backlash and a second gap in series with it together [m]; 0 where there is none."""
    name = found.model.axes[axis]
    if f"{name}.clearance" not in {p.name for p in found.model.parameters}:
        return 0.0
    return found.value(f"{name}.backlash") + found.value(f"{name}.clearance")


def division_known(found: Fitted, axis: int) -> float:
    """Standard deviation of how the backlash and a second gap divide what they are together [m]; 0 where there is
    none."""
    return (SPLIT if nothing_left(found) else UNSURE) * clearance_beside(found, axis)


def unseen_depth(found: Fitted, axis: int) -> float:
    """How deep a bent flank is pressed [m] until its force is the sensor's noise, times its bend; 0 where it is not
    bent."""
    name = found.model.axes[axis]
    if f"{name}.bend" not in {p.name for p in found.model.parameters}:
        return 0.0
    bend, k = found.value(f"{name}.bend"), found.value(f"{name}.contact_stiffness")
    noise = float(found.moves[0].noise[axis])
    return abs(bend) * TYPICAL_PUSH / k * float((noise / TYPICAL_PUSH) ** (1.0 / (1.0 + bend)))


def widening(found: Fitted, effect: DrivenLocalBacklash, axis: int) -> tuple[float, FloatArray]:
    """How much wider a gap is where it is crossed than where the recording began [m], on average, and its derivative
    (parameters,) with respect to the coordinates."""
    name, places = found.model.axes[axis], crossings(found, axis)
    moved = np.concatenate((np.zeros((1, len(found.at.shared))), 1e-4 * np.eye(len(found.at.shared))))
    values = {
        p.name: np.asarray(p.value(found.at.shared[k] + moved[:, k]))
        for k, p in enumerate(found.model.parameters)
    }
    wider = effect.widening(values, name, np.broadcast_to(places, (len(moved), len(places))))[0].mean(axis=1)
    return float(wider[0]), np.asarray((wider[1:] - wider[0]) / 1e-4)


def crossings(found: Fitted, axis: int) -> FloatArray:
    """Where the gap is crossed [m] from where the recording began: at CROSSED of every move's duration."""
    places = [
        float(part.plain[axis](move.start + CROSSED * move.duration))
        for part in found.moves
        for move in part.made
    ]
    return np.array(places)


def slope_of(found: Fitted, k: int) -> float:
    """Derivative of a parameter with respect to its coordinate."""
    p, u = found.model.parameters[k], found.at.shared[k]
    return float((p.value(u + 1e-4) - p.value(u - 1e-4)) / 2e-4)
