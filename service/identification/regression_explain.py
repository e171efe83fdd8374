"""Explain a channel that is linear in most parameters: from recordings to the verdict on one axis."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from service.identification.explanation import AxisExplanation, ErrorReport, Finding, Parameter, Prediction
from service.identification.regression import (
    Model,
    RegressionChannel,
    RegressionProblem,
    add,
    block_sums,
    inner_errors,
    noise_at_rest,
    parameter_std,
    polish,
    predict,
    regression_problem,
    residual,
    solve,
)
from service.identification.selection import Selection, Trial, independent_samples, select
from service.recording import FloatArray, Recording

CLEAN = 1.3
"""Residual over noise up to which a channel holds nothing to explain (the issue's own bound)."""


def explain_regression(
    train: Sequence[Recording],
    validate: Recording,
    axis: str,
    channel: RegressionChannel,
    tell: Callable[[str], None] = lambda _message: None,
) -> AxisExplanation | None:
    """The verdict on one axis in one channel; None where the recordings do not hold what the channel needs."""
    problem = regression_problem(train, validate, axis, channel)
    if problem is None:
        return None
    noise = noise_at_rest(problem)
    before = _trial(problem, solve(problem, Model())[0])
    if before.validation_rms <= CLEAN * noise:
        selection = Selection(before, before, (), (), ())
    else:

        def refine(trial: Trial[Model]) -> Trial[Model]:
            return _trial(problem, polish(problem, trial.model))

        selection = select(before, lambda trial, taken: _propose(problem, trial, taken), refine, tell)
    return _verdict(problem, axis, noise, selection)


def _trial(problem: RegressionProblem, model: Model) -> Trial[Model]:
    held_out = residual(problem, problem.validate, model)
    return Trial(
        model=model,
        train_rms=solve(problem, model)[1],
        validation_rms=_rms(held_out),
        validation_blocks=block_sums(held_out),
        inner_blocks=block_sums(inner_errors(problem, model)),
        independent=independent_samples(held_out),
    )


def _propose(
    problem: RegressionProblem, present: Trial[Model], taken: tuple[str, ...]
) -> Mapping[str, Trial[Model]]:
    """Every effect of the library that is not in yet, added and refitted."""
    return {
        effect.name: _trial(problem, add(problem, present.model, effect))
        for effect in problem.library
        if effect.name not in taken and effect.applies(problem.train[0].signals.torque is not None)
    }


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _report(problem: RegressionProblem, trial: Trial[Model]) -> ErrorReport:
    errors = residual(problem, problem.validate, trial.model)
    zero = problem.validate
    signal = residual(problem, zero, Model(coefficients=dict.fromkeys(trial.model.coefficients, 0.0)))
    return ErrorReport(
        train_rms=trial.train_rms,
        validation_rms=trial.validation_rms,
        normalised_rms=trial.validation_rms / max(_rms(signal), 1e-300),
        whiteness=float(np.corrcoef(errors[:-1], errors[1:])[0, 1]),
    )


def _parameters(problem: RegressionProblem, model: Model) -> dict[str, Parameter]:
    """Effects' own parameters first, then the declared model's; linear ones in the channel's unit per column's."""
    std = parameter_std(problem, model)
    found = {
        effect.shape[0]: Parameter(shape, std[effect.name], effect.shape[1])
        for effect, shape in zip(model.effects, model.shapes, strict=True)
        if effect.shape is not None
    }
    for name, value in model.coefficients.items():
        found[name] = Parameter(value, std[name], _unit(problem, name))
    return found


def _unit(problem: RegressionProblem, name: str) -> str:
    """Unit of a coefficient: the channel's unit over the column's."""
    top = {"motor_torque": "N m", "load_position": "m", "load_speed": "m"}[problem.channel]
    per = {
        "inertia": "/(m/s^2)", "viscous": "/(m/s)", "viscous_asymmetry": "/(m/s)", "spring_rate": "/m",
        "spring_curvature": "/m^2", "friction_slope": "/m", "friction_bow": "/m^2", "gain_error": "/m",
        "compliance_per_torque": "/N", "inertial_compliance": "/(m/s^2)",
    }  # fmt: skip
    return top + per.get(name, "")


def _verdict(
    problem: RegressionProblem, axis: str, noise: float, selection: Selection[Model]
) -> AxisExplanation:
    clean = selection.before.validation_rms <= CLEAN * noise
    finding: Finding = "effect" if selection.effects else ("none" if clean else "unknown")
    record = problem.validate
    return AxisExplanation(
        axis=axis,
        channel=problem.channel,
        finding=finding,
        noise_rms=noise,
        before=_report(problem, selection.before),
        after=_report(problem, selection.after),
        effects=selection.effects,
        indistinguishable=selection.rivals,
        candidates=selection.candidates,
        parameters=_parameters(problem, selection.after.model),
        evidence=_evidence(selection),
        predictions=(
            Prediction("before", record.trace.time, predict(problem, record, selection.before.model)),
            Prediction("after", record.trace.time, predict(problem, record, selection.after.model)),
        ),
    )


def _evidence(selection: Selection[Model]) -> tuple[str, ...]:
    lines = [f"{c.effect}: {c.why}" for c in selection.candidates]
    if any(effect == "sensor_latency" for effect in selection.effects):
        lines.append("the time skew was fitted on the train recordings and is not found again on validate")
    return tuple(lines)
