"""The entry of the analysis: one result per axis of a recording, by the best method whose verdict is ok.

immediate   the paper's method, a tenth of a second; several percent, and an interval that says so
refined     the model fit, seconds to tens of seconds; a fraction of a micrometre
estimate    both: the refined result, or the immediate where the fit's refusal speaks of the fit alone
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from service.backlash.admission import admit
from service.backlash.meaning import at_each_place
from service.backlash.model_fit import METHOD, model_fit_axes
from service.backlash.pairing import swapped
from service.backlash.paper import paper
from service.backlash.results import OF_THE_METHOD, AxisResult, Reason, Refusal
from service.dynamics.compiling import compiled_apart
from service.recording import Recording


def immediate(recording: Recording) -> tuple[AxisResult, ...]:
    """Backlash of every axis by the paper's method, in the order of the recording's description."""
    return at_each_place(recording, lambda part: tuple(paper(part, axis.name) for axis in part.axes))


def refined(recording: Recording) -> tuple[AxisResult, ...]:
    """Backlash of every axis by the model fit, both axes of a gantry together; a value or a named refusal."""
    compiled_apart()
    return at_each_place(recording, _refined)


def _refined(recording: Recording) -> tuple[AxisResult, ...]:
    """The fits of one place."""
    refusals = {axis.name: admit(recording, axis.name) for axis in recording.axes}
    for pair in recording.gantry:
        doubted = [name for name in pair if in_doubt(refusals.get(name))]
        if doubted:
            refusals |= dict.fromkeys(doubted, swapped(recording, pair))
    results: dict[str, AxisResult] = {}
    for axis in recording.axes:
        if axis.name not in results:
            results |= _fitted(recording, axis.name, refusals)
    return tuple(results[axis.name] for axis in recording.axes)


def in_doubt(refusal: Refusal | None) -> bool:
    """Whether an axis is refused only until the machine was asked on which side its sensor sits."""
    return refusal is not None and refusal.reason is Reason.SENSORS_IN_DOUBT


def best(first: Sequence[AxisResult], second: Sequence[AxisResult]) -> tuple[AxisResult, ...]:
    """Per axis the refined result (``second``), or the immediate one (``first``) where it stands beside a refusal.

    What the fit refuses for the run itself is refused: the plain method looks less closely, its value would be wrong.
    Where both refuse, the fit's reason counts: it had the last look.
    """
    pairs = zip(first, second, strict=True)
    return tuple(plain if stands(fit) and plain.verdict == "ok" else fit for plain, fit in pairs)


def stands(fit: AxisResult) -> bool:
    """Whether the plain value stands beside this answer of the fit: a refusal that says nothing of the run."""
    return fit.verdict == "refused" and fit.reason in OF_THE_METHOD


def estimate(recording: Recording) -> tuple[AxisResult, ...]:
    """Backlash of every axis of a recording by the best method; a value or a named refusal."""
    return best(immediate(recording), refined(recording))


def _fitted(recording: Recording, axis: str, refusals: Mapping[str, Refusal | None]) -> dict[str, AxisResult]:
    """The fit of an axis and its partner; none where either's recording cannot be used."""
    refusal, partner = refusals[axis], recording.partner(axis)
    if refusal:
        return {axis: _refused(axis, refusal)}
    if partner is not None and refusals.get(partner):
        detail = (
            f"{axis} and {partner} are fitted together, and {partner} cannot be used: see its own reason."
        )
        return {axis: _refused(axis, Refusal(Reason.GANTRY_PARTNER_MISSING, detail))}
    return model_fit_axes(recording, axis)


def _refused(axis: str, refusal: Refusal) -> AxisResult:
    return AxisResult(axis, "refused", METHOD, refusal.reason, refusal.detail)
