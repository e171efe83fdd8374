"""What every method asks of a recording before it looks for a gap: one gate, so that none answers where it must not."""

from __future__ import annotations

from service.backlash import plausibility
from service.backlash.pairing import paired
from service.backlash.results import Reason, Refusal
from service.backlash.signals import StepSignals, axis_signals, step_signals
from service.recording import Recording


def admit(recording: Recording, axis: str) -> Refusal | None:
    """Why the recording of an axis cannot be analysed by any method, or None: samples, units, signs, sensors."""
    refusal = plausibility.recorded(recording, axis) or accompanied(recording, axis)
    if refusal:
        return refusal
    steps = list(whole_steps(recording, axis).values())
    return plausibility.moved(recording, axis, steps) or paired(recording, axis)


def accompanied(recording: Recording, axis: str) -> Refusal | None:
    """Refuse one axis of a gantry without the other: its pull may be half the gap, and nothing here shows it."""
    partner = recording.partner(axis)
    if partner is None or all(recording.trace(partner, channel) for channel in plausibility.CHANNELS):
        return None
    return Refusal(
        Reason.GANTRY_PARTNER_MISSING,
        f"{axis} and {partner} move one bridge and pull at each other, and {partner} was not recorded (motor speed and "
        "acceleration); record both axes of the gantry in one run.",
    )


def whole_steps(recording: Recording, axis: str, tau: float = 0.0) -> dict[int, StepSignals]:
    """The steps that were recorded whole, by index, the accelerometer's stamps set back by tau [s]."""
    signals = axis_signals(recording, axis)
    if signals is None:
        return {}
    steps = (step_signals(signals, index, move, tau) for index, move in enumerate(recording.moves))
    return {step.index: step for step in steps if step is not None}
