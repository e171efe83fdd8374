"""The method of the paper as it stands, the readable reference: section III, eqs. (10) to (12), ten steps averaged.

M. Zenn, Keck, Beck, Herold, Melz: Automated backlash determination on rack-and-pinion drives, AIM 2023.

Symbols: t1, t2 the flanks part and meet; gamma_t1, gamma_t2 the thresholds; b the backlash; SL, j_lim of the step.
"""

from __future__ import annotations

from service.backlash import plausibility
from service.backlash.averaging import FEWEST_STEPS, StepValue, average
from service.backlash.detection import GAMMA_T1_NOISE, find_pass, standstill_noise
from service.backlash.integration import parted
from service.backlash.plausibility import Refusal
from service.backlash.results import AxisResult, Reason, StepResult
from service.backlash.signals import step_signals
from service.recording import Recording

METHOD = "paper"


def paper(recording: Recording, axis: str) -> AxisResult:
    """Backlash of one axis [m] by the paper's thresholds, or a named refusal."""
    refusal = plausibility.recorded(recording, axis)
    if refusal:
        return AxisResult(axis, "refused", METHOD, refusal.reason, refusal.detail)
    steps, values = [], []
    for index, move in enumerate(recording.moves):
        found = _step(recording, axis, index)
        if isinstance(found, Refusal):
            steps.append(StepResult(index, move.direction, "refused", found.reason, found.detail))
        else:
            value, t1, t2 = found
            values.append(value)
            steps.append(StepResult(index, move.direction, "ok", backlash=value.b, t1=t1, t2=t2))
    if len(values) < FEWEST_STEPS:
        return AxisResult(axis, "refused", METHOD, Reason.TOO_FEW_STEPS, "too few", steps=tuple(steps))
    mean = average(values)
    return AxisResult(axis, "ok", METHOD, None, None, mean.b, mean.interval_95, tuple(steps))


def _step(recording: Recording, axis: str, index: int) -> tuple[StepValue, float, float] | Refusal:
    signals = step_signals(recording, axis, index)
    if signals is None:
        return Refusal(Reason.STEP_INCOMPLETE, "The samples do not reach over the whole move.")
    gamma_t1 = GAMMA_T1_NOISE * standstill_noise(signals)
    found = find_pass(signals, gamma_t1)
    if found is None:
        return Refusal(Reason.NO_RELEASE, "No release and impact could be told apart.")
    late = found.t1_range[1] if recording.partner(axis) else found.t1
    value = StepValue(
        b=parted(signals, found.t1, found.t2),
        lower=parted(signals, late, found.t2_range[0]),
        upper=parted(signals, found.t1_range[0], found.t2_range[1]),
    )
    return value, found.t1, found.t2
