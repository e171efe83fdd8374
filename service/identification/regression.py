"""Channels whose model is linear in most parameters: torque balance at the motor, motor minus load.

Torque balance: F = m ẍ + f_v ẋ + f_c sign ẋ + F_0, the sum of eqs. (1) to (4) for a rigid chain, plus offset.
Motor minus load: x_mot - x_load = offset + torque / stiffness, or offset alone where no torque was recorded.
Nonlinear parameters (``shape``) are searched on a grid and refined while the linear ones are solved exactly at
each value (variable projection, Golub and Pereyra 1973).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from service.identification.motion_signals import Drive, DriveSignals, drive_signals, low_pass, standstill
from service.identification.regression_effects import RegressionEffect, deflection_effects, torque_effects
from service.recording import FloatArray, Recording, Trace

RegressionChannel = Literal["motor_torque", "load_position", "load_speed"]

FORCE_BAND_HZ = 40.0
"""Band in which forces are compared (Janot, Gautier and Brunot 2019): above it current ripple dominates."""
DRIVE_BAND_HZ = 100.0
"""Cut-off of the differentiated position, two and a half times the compared band."""
BLOCKS = 16
"""Pieces into which each recording is cut for the held-out test; chosen: 15 degrees of freedom."""
MIN_REST = 20
"""Samples at rest from which a zero or a noise level may be read."""


@dataclass(frozen=True)
class Model:
    """Which effects are in, with their nonlinear parameters, and the linear coefficients by name."""

    effects: tuple[RegressionEffect, ...] = ()
    shapes: tuple[float, ...] = ()
    coefficients: dict[str, float] = field(default_factory=dict)

    @property
    def latency(self) -> float:
        """Time skew of the channel [s]; 0 unless ``sensor_latency`` is in."""
        return sum(s for e, s in zip(self.effects, self.shapes, strict=True) if e.name == "sensor_latency")


@dataclass(frozen=True)
class Record:
    """One recording made ready: target channel, driven side, and the samples that are compared."""

    trace: Trace
    signals: DriveSignals
    rest: FloatArray
    keep: slice
    step: float


@dataclass(frozen=True)
class RegressionProblem:
    """One channel of one axis, with train recordings and a held-out one."""

    channel: RegressionChannel
    train: tuple[Record, ...]
    validate: Record
    scale: float

    @property
    def library(self) -> tuple[RegressionEffect, ...]:
        return torque_effects() if self.channel == "motor_torque" else deflection_effects()


def regression_problem(
    train: Sequence[Recording], validate: Recording, axis: str, channel: RegressionChannel
) -> RegressionProblem | None:
    """The problem, or None where a recording lacks the channel or anything that drives it."""
    records = [_record(recording, axis, channel) for recording in (*train, validate)]
    ready = [record for record in records if record is not None]
    if len(ready) < len(records):
        return None
    return RegressionProblem(channel, tuple(ready[:-1]), ready[-1], abs(validate.axis(axis).transmission))


def _record(recording: Recording, axis: str, channel: RegressionChannel) -> Record | None:
    trace = recording.trace(axis, channel)
    if trace is None:
        return None
    step = float(np.median(np.diff(trace.time)))
    cutoff = min(DRIVE_BAND_HZ, 0.2 / step)
    signals = drive_signals(recording, axis, cutoff, with_torque=channel != "motor_torque")
    if signals is None:
        return None
    stride = max(1, int(0.125 / step / FORCE_BAND_HZ)) if channel == "motor_torque" else 1
    return Record(trace, signals, standstill(signals.at(trace.time)), slice(None, None, stride), step)


def columns(
    problem: RegressionProblem, record: Record, model: Model
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """What is known (n,) and the columns (n,) of the coefficients, at the trace's own times, unfiltered."""
    drive = record.signals.at(record.trace.time - model.latency)
    table = _declared(problem, drive)
    for effect, shape in zip(model.effects, model.shapes, strict=True):
        table.update(effect.columns(drive, shape))
    known = np.zeros_like(drive.time) if problem.channel == "motor_torque" else drive.position
    if problem.channel == "load_speed":
        known = drive.speed
        table = {name: np.gradient(column, drive.time) for name, column in table.items() if name != "offset"}
    return known, table


def _declared(problem: RegressionProblem, drive: Drive) -> dict[str, FloatArray]:
    offset = {"offset": np.ones_like(drive.time)}
    if problem.channel == "motor_torque":
        return {"inertia": drive.acceleration, "viscous": drive.speed, "coulomb": drive.direction, **offset}
    return offset if drive.torque is None else {**offset, "compliance_per_torque": -drive.torque}


def _compared(problem: RegressionProblem, record: Record, values: FloatArray) -> FloatArray:
    """The samples that are compared, in the compared band; ``values`` (n,) or (n, k)."""
    if problem.channel == "motor_torque":
        values = low_pass(values, record.step, min(FORCE_BAND_HZ, 0.2 / record.step))
    return values[record.keep]


def design(
    problem: RegressionProblem, record: Record, model: Model
) -> tuple[FloatArray, FloatArray, list[str]]:
    """Target (m,) and design matrix (m, k) as compared, with the columns' names.

    The zero of a position difference is its own in every recording, so its column is centred away here.
    """
    known, table = columns(problem, record, model)
    y = _compared(problem, record, record.trace.value - known)
    X = _compared(problem, record, np.column_stack(list(table.values())))
    if problem.channel == "load_position":
        size = np.linalg.norm(X, axis=0)
        y, X = y - y.mean(), X - X.mean(axis=0)
        X[:, np.linalg.norm(X, axis=0) < 1e-3 * size] = 0.0
    return y, X, list(table)


def solve(problem: RegressionProblem, model: Model, rho: float = 0.0) -> tuple[Model, float]:
    """The model with its linear coefficients solved on the train recordings, and the train RMS.

    ``rho`` is the residual's lag-one correlation, if the fit is to be efficient for it (Cochrane and Orcutt
    1949): samples are replaced by y[k] - rho y[k-1], which weighs the fast part of the motion.
    """
    parts = [design(problem, record, model) for record in problem.train]
    y = np.concatenate([part[0][1:] - rho * part[0][:-1] for part in parts])
    X = np.concatenate([part[1][1:] - rho * part[1][:-1] for part in parts])
    theta = least_squares(X, y)
    rms = float(np.sqrt(np.mean((y - X @ theta) ** 2)))
    return replace(model, coefficients=dict(zip(parts[0][2], theta.tolist(), strict=True))), rms


def least_squares(X: FloatArray, y: FloatArray) -> FloatArray:
    """Least squares with columns scaled to unit length, so that the rank is judged alike for all units."""
    size = np.linalg.norm(X, axis=0)
    size[size == 0.0] = 1.0
    theta = np.linalg.lstsq(X / size, y, rcond=1e-9)[0] / size
    return np.asarray(theta, dtype=np.float64)


def add(problem: RegressionProblem, model: Model, effect: RegressionEffect) -> Model:
    """The model with one more effect, its nonlinear parameter at the best train error.

    Timing first: a time skew is told by the fast part of the motion, which friction and compliance cannot
    imitate, so its error is weighed for the correlation of the residual.
    """
    record = problem.train[0]
    drive = record.signals.at(record.trace.time)
    grid = np.sort(np.asarray(effect.grid(drive, _residual(problem, record, model))))
    trial = replace(model, effects=(*model.effects, effect), shapes=(*model.shapes, float(grid[0])))
    if effect.shape is None:
        return solve(problem, trial)[0]
    found = _searched(problem, trial, grid, 0.0)
    if effect.name == "sensor_latency":
        found = _searched(problem, trial, grid, whiteness(residual(problem, record, found)))
    return found


def _searched(problem: RegressionProblem, model: Model, grid: FloatArray, rho: float) -> Model:
    """The last effect's nonlinear parameter from the best of a grid, refined between its neighbours."""
    errors = [solve(problem, _moved(model, value), rho)[1] for value in grid]
    best = int(np.argmin(errors))
    low, high = grid[max(0, best - 1)], grid[min(len(grid) - 1, best + 1)]
    found = minimize_scalar(
        lambda value: solve(problem, _moved(model, value), rho)[1],
        bounds=(low, high),
        method="bounded",
        options={"maxiter": 25, "xatol": 1e-3 * (high - low)},
    )
    value = float(found.x) if found.fun < errors[best] else float(grid[best])
    return solve(problem, _moved(model, value))[0]


def _moved(model: Model, value: float) -> Model:
    return replace(model, shapes=(*model.shapes[:-1], float(value)))


def whiteness(errors: FloatArray) -> float:
    """Lag-one autocorrelation of a residual (m,); 0 is white."""
    return float(np.clip(np.corrcoef(errors[:-1], errors[1:])[0, 1], -1.0, 0.99))


def polish(problem: RegressionProblem, model: Model) -> Model:
    """All nonlinear parameters moved together to the best train error, once two or more effects are in."""
    free = [k for k, effect in enumerate(model.effects) if effect.shape is not None]
    if not free or len(model.effects) < 2:
        return model
    start = np.array(model.shapes)

    def at(move: FloatArray) -> Model:
        shapes = start.copy()
        for k, step in zip(free, move, strict=True):
            shapes[k] = _stepped(model.effects[k].name, float(start[k]), float(step))
        return replace(model, shapes=tuple(shapes.tolist()))

    found = minimize(
        lambda move: solve(problem, at(move))[1],
        np.zeros(len(free)),
        method="Nelder-Mead",
        bounds=[(-1.0, 1.0)] * len(free),
        options={
            "maxfev": 40 * len(free),
            "initial_simplex": _simplex(len(free)),
            "xatol": 1e-3,
            "fatol": 1e-9,
        },
    )
    return solve(problem, at(found.x))[0]


def _simplex(count: int) -> FloatArray:
    return np.vstack([np.zeros(count), 0.2 * np.eye(count)])


def _stepped(name: str, value: float, move: float) -> float:
    """A nonlinear parameter moved by -1 to 1: 2 ms of skew, a thousandth of a period, a factor of five."""
    if name == "sensor_latency":
        return value + 2e-3 * move
    return value * float(np.exp(move * (1e-3 if name == "transmission_ripple" else np.log(5.0))))


def predict(problem: RegressionProblem, record: Record, model: Model) -> FloatArray:
    """The channel (n,) at its own time stamps; the zero of a position is found again at standstill."""
    known, table = columns(problem, record, model)
    value = known + sum(model.coefficients[name] * column for name, column in table.items())
    if problem.channel == "load_position" and record.rest.sum() >= MIN_REST:
        value = value + np.average(record.trace.value - value, weights=record.rest)
    return np.asarray(value, dtype=np.float64)


def residual(problem: RegressionProblem, record: Record, model: Model) -> FloatArray:
    """Measured minus predicted (m,), in the compared band."""
    return _compared(problem, record, record.trace.value - predict(problem, record, model))


def _residual(problem: RegressionProblem, record: Record, model: Model) -> FloatArray:
    """Measured minus predicted at every sample (n,)."""
    return record.trace.value - predict(
        problem, record, model if model.coefficients else solve(problem, model)[0]
    )


def block_sums(errors: FloatArray, blocks: int = BLOCKS) -> FloatArray:
    """Sum of squares in consecutive blocks (blocks,)."""
    return np.array([np.sum(piece**2) for piece in np.array_split(errors, blocks)])


def inner_errors(problem: RegressionProblem, model: Model, folds: int = 4) -> FloatArray:
    """Errors (m,) on parts of the train recordings that were left out of the linear fit."""
    parts = [design(problem, record, model) for record in problem.train]
    y = np.concatenate([part[0] for part in parts])
    X = np.concatenate([part[1] for part in parts])
    errors = np.empty(len(y))
    for left_out in np.array_split(np.arange(len(y)), folds):
        fitted = np.ones(len(y), dtype=bool)
        fitted[left_out] = False
        error = y[left_out] - X[left_out] @ least_squares(X[fitted], y[fitted])
        errors[left_out] = error - error.mean() if problem.channel == "load_position" else error
    return errors


def noise_at_rest(problem: RegressionProblem) -> float:
    """Noise of the channel in the compared band [its unit], from differences of the target at standstill.

    Differences of neighbouring compared samples, so that a drift at rest does not count; the median of their
    magnitude, so that a settling motion does not either (0.6745 is the normal distribution's quartile).
    """
    levels = []
    for record in (*problem.train, problem.validate):
        compared = _compared(problem, record, record.trace.value)
        at_rest = compared[record.rest[record.keep] > 0.5] if record.rest.sum() >= MIN_REST else compared
        steps = np.diff(at_rest if len(at_rest) >= MIN_REST else compared)
        levels.append(float(np.median(np.abs(steps)) / 0.6745 / np.sqrt(2.0)))
    return float(np.median(levels))


def parameter_std(problem: RegressionProblem, model: Model) -> dict[str, float]:
    """Standard deviation of each coefficient and shape on the train recordings.

    The residual is correlated, so the number of independent samples is taken from its lag-one correlation
    (an AR(1) residual); the shapes' columns are differences of the prediction.
    """
    y_all: list[FloatArray] = []
    X_all: list[FloatArray] = []
    names: list[str] = []
    for record in problem.train:
        y, X, names = design(problem, record, model)
        slopes = [_shape_slope(problem, record, model, k) for k in range(len(model.shapes))]
        y_all.append(y)
        X_all.append(np.column_stack([X, *slopes]) if slopes else X)
    y, X = np.concatenate(y_all), np.concatenate(X_all)
    theta = np.array([model.coefficients[name] for name in names])
    errors = y - X[:, : len(names)] @ theta
    rho = float(np.clip(np.corrcoef(errors[:-1], errors[1:])[0, 1], 0.0, 0.99))
    variance = float(np.mean(errors**2)) * (1 + rho) / (1 - rho)
    size = np.maximum(np.linalg.norm(X, axis=0), 1e-300)
    spread = np.sqrt(np.maximum(np.diag(np.linalg.pinv((X / size).T @ (X / size))), 0.0) * variance) / size
    keys = [*names, *(e.name for e in model.effects)]
    return dict(zip(keys, spread.tolist(), strict=True))


def _shape_slope(problem: RegressionProblem, record: Record, model: Model, index: int) -> FloatArray:
    """Change of the prediction (m,) with one nonlinear parameter, by a small difference."""
    effect, value = model.effects[index], model.shapes[index]
    if effect.shape is None:
        return np.zeros(len(record.trace.time[record.keep]))
    reach = 1e-4 if effect.name == "sensor_latency" else 1e-3 * abs(value)
    sides = []
    for sign in (1.0, -1.0):
        shapes = (*model.shapes[:index], value + sign * reach, *model.shapes[index + 1 :])
        sides.append(predict(problem, record, replace(model, shapes=shapes)))
    slope = _compared(problem, record, (sides[0] - sides[1]) / (2 * reach))
    return slope - slope.mean() if problem.channel == "load_position" else slope
