"""The value of a run with a revised model: the declared one and the effects that were accepted for an axis.

``Reviser`` is the narrow door to the numerics. Behind it stand ``by_refitting``, which the service uses: it fits the
model with the effects to the run; and ``by_explaining``, for an explainer of one's own: it explains the run beside a
neighbour and takes the value of the model with the effects, but only when they are found in the run again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from service.backlash.results import AxisResult, Reason
from service.identification.explain import explain
from service.identification.explanation import (
    Accepted,
    AxisExplanation,
    CannotExplain,
    ErrorReport,
    Explanation,
)
from service.identification.revise import revised_values
from service.recording import Recording

Effects = Mapping[str, tuple[str, ...]]
"""By axis, the names of the effects that its model has beyond the declared one."""

Explainer = Callable[
    [Sequence[Recording], Recording, Callable[[str], None], Mapping[str, Accepted]], Explanation
]
"""``service.identification.explain.explain``, or what stands for it."""

METHOD = "revised_model"


class Reviser(Protocol):
    """Computes the backlash of the axes in ``effects`` with these effects in their models."""

    def __call__(
        self, recording: Recording, effects: Effects, others: Sequence[Recording]
    ) -> Sequence[AxisResult]:
        """One result per axis of ``effects``.

        Parameters
        ----------
        recording : the run
        others : neighbouring runs of the same axes, which may judge a fit or show where it begins, and lend it no
            value
        """


def by_refitting(
    recording: Recording, effects: Effects, others: Sequence[Recording]
) -> tuple[AxisResult, ...]:
    """Fit the run with the effects in the model; refuse a value where they leave more than the noise. A neighbour may
    show where to begin."""
    out = []
    for axis, names in effects.items():
        try:
            value = revised_values(recording, _moving_with(recording, axis, names), names, others)[axis]
        except CannotExplain as error:
            out.append(_refused(axis, str(error)))
            continue
        if value.explained:
            out.append(AxisResult(axis, "ok", METHOD, None, None, value.backlash, value.interval_95))
        else:
            out.append(_refused(axis, f"it leaves {value.misfit:.1f} times the residual of a right model"))
    return tuple(out)


def _moving_with(recording: Recording, axis: str, effects: Sequence[str]) -> tuple[str, ...]:
    """The axis and those that are fitted with it, in the recording's order."""
    if "gantry_coupling" in effects:
        return tuple(a.name for a in recording.axes)
    return next((pair for pair in recording.gantry if axis in pair), (axis,))


def by_explaining(
    recording: Recording,
    effects: Effects,
    others: Sequence[Recording],
    explainer: Explainer = explain,
) -> tuple[AxisResult, ...]:
    """Fit to the run, judge on a neighbour, take the model's value; the next neighbour where one is refused.

    The values before and after of an explanation are those of the recording that was fitted.
    """
    found: dict[str, AxisResult] = {}
    for other in others:
        open_axes = {axis: names for axis, names in effects.items() if not _is_ok(found.get(axis))}
        if open_axes:
            found |= _judged_on(recording, open_axes, other, explainer)
    return tuple(found.get(axis) or _refused(axis, "there is no neighbouring run") for axis in effects)


def revised_value(found: AxisExplanation, effects: Sequence[str]) -> AxisResult:
    """Take an axis' value out of an explanation, or refuse it.

    A run in which nothing is missing has none of the effects: there the revised model, its effects at zero, is
    the declared one.
    """
    if found.finding == "none":
        return _value(found.axis, found.before)
    if found.finding == "effect" and set(effects) <= set(found.effects):
        return _value(found.axis, found.after)
    answer = ", ".join(found.effects) or "something unknown"
    return _refused(found.axis, f"the model check of this run found {answer} instead of {', '.join(effects)}")


def _judged_on(
    recording: Recording, effects: Effects, other: Recording, explainer: Explainer
) -> dict[str, AxisResult]:
    try:
        answer = explainer([recording], other, lambda _text: None, {})
    except CannotExplain as error:
        return {axis: _refused(axis, str(error)) for axis in effects}
    explained = {found.axis: found for found in answer.axes}
    return {
        axis: revised_value(explained[axis], names) for axis, names in effects.items() if axis in explained
    }


def _is_ok(result: AxisResult | None) -> bool:
    return result is not None and result.verdict == "ok"


def _value(axis: str, report: ErrorReport) -> AxisResult:
    if report.backlash is None:
        return _refused(axis, "the model gives no backlash for this run")
    return AxisResult(axis, "ok", METHOD, None, None, report.backlash, report.interval_95)


def _refused(axis: str, why: str) -> AxisResult:
    detail = (
        f"the accepted model revision does not explain this run: {why}. The effect may have ended or changed; the "
        "value by the declared model stands beside it. See the model check of the run"
    )
    return AxisResult(axis, "refused", METHOD, Reason.MISFIT, detail)
