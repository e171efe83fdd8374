"""The effects of the library in a technician's words: what it is, what it does to the value, where to look."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Words:
    """One effect: a ``name`` that fits into a sentence, what it ``means``, what to ``check`` on the machine."""

    name: str
    means: str
    check: str


_WORDS = {
    "gantry_coupling": Words(
        "a pull of the other gantry side",
        "The bridge carries force from one side to the other, so that each side's motion shows up in its partner's.",
        "Look at the bridge's screws and bearings, and whether both sides stand parallel.",
    ),
    "machine_body_mode": Words(
        "a swinging machine body",
        "Each step pushes the whole machine, which swings on its feet, and the sensor on the carriage swings along.",
        "Look at the levelling feet and the floor bolts.",
    ),
    "hung_mass_mode": Words(
        "an elastically hung mass on the carriage",
        "Something on the carriage swings after each step: a head, a hose holder, a cover, a cable.",
        "Take hold of what is fixed to the carriage and try whether it is loose.",
    ),
    "stribeck_friction": Words(
        "more friction at very slow motion",
        "The guide holds the carriage more firmly at creeping speed than in motion.",
        "Look at lubrication, wipers and seals of the guide.",
    ),
    "curved_friction": Words(
        "friction that does not grow evenly with speed",
        "The friction rises with speed in a curve and not in a straight line.",
        "Look at the lubricant's type and temperature.",
    ),
    "asymmetric_friction": Words(
        "friction that differs by direction",
        "The carriage moves more easily one way than the other.",
        "Look at wipers, seals and the preload of the guide, and at a dragging cable chain.",
    ),
    "constant_force": Words(
        "a constant force",
        "Something always pulls the carriage the same way: gravity on a tilted axis, a weight, a spring balancer.",
        "Check the machine's level, and the weight balance where there is one.",
    ),
    "position_dependent_force": Words(
        "a force that changes along the travel",
        "Something pulls harder the further the carriage goes: a cable chain, a hose, a bellows.",
        "Follow cables, hoses and covers along the travel.",
    ),
    "gearbox_clearance": Words(
        "a second gap, in the gearbox",
        "Beside the gap between pinion and rack there is play before it: in the gearbox or the coupling.",
        "Check the coupling's screws and the gearbox's play with the motor held.",
    ),
    "position_dependent_backlash": Words(
        "backlash that changes along the rack",
        "The gap is not the same everywhere: an eccentric pinion, or a worn stretch of the rack.",
        "Check the pinion's runout, and the rack's teeth where the axis works most.",
    ),
    "sensor_latency": Words(
        "a time lag between motor and sensor signals",
        "One of the signals comes late, which shifts the moment at which the flanks seem to meet.",
        "Check whether a filter of the drive or the sensor was changed, and latency_us in the configuration.",
    ),
    "sensor_gain": Words(
        "a sensor that reads too much or too little",
        "The accelerometer's scale is off by a constant factor, or it sits at an angle.",
        "Check how the accelerometer is mounted, and its range setting.",
    ),
    "sensor_bias": Words(
        "a sensor that is off by a constant",
        "The accelerometer shows acceleration at rest beyond what its zero should.",
        "Check how the accelerometer is mounted; a drifting zero speaks for a failing sensor.",
    ),
    "sensor_filter": Words(
        "a slow accelerometer",
        "The accelerometer's own low-pass smooths what it feels: the load seems to move later and softer than it does.",
        "Check the accelerometer's bandwidth, and whether it was replaced by another type.",
    ),
    "speed_filter": Words(
        "a filter on the drive's speed value",
        "The drive smooths the speed that it reports, so that the motor seems to move later and softer than it does.",
        "Check the speed filter in the drive's parameters, and whether somebody changed it.",
    ),
    "preload_flank": Words(
        "a spring between the flanks",
        "Something presses the load towards the middle of the gap: a split pinion or a sprung one against backlash.",
        "Nothing is wrong if the pinion is built so: accept the model. Else look for what is clamped in the teeth.",
    ),
    "contact_nonlinearity": Words(
        "flanks that stiffen as they are pressed",
        "The tooth contact is soft at first touch and hard later: dirt or grease between the flanks, or worn teeth.",
        "Clean rack and pinion, and look at the tooth flanks.",
    ),
    "transmission_ripple": Words(
        "a ripple that repeats with the position",
        "Motor and carriage do not move in a constant ratio: tooth by tooth, or turn by turn, it comes and goes.",
        "Check pinion runout, tooth damage and the coupling's alignment.",
    ),
    "compliance": Words(
        "an elasticity in the drive train",
        "The drive train winds up under load more than the model has it.",
        "Check coupling, gearbox fixing and the pinion's seat.",
    ),
    "lost_motion": Words(
        "lost motion at reversal",
        "After a reversal the load follows only when the motor has turned a little way.",
        "Check coupling, gearbox and pinion seat for play.",
    ),
}


def effect_words(effect: str) -> Words:
    """Say an effect in words; one that has none is called by its name."""
    readable = effect.replace("_", " ")
    return _WORDS.get(
        effect, Words(readable, f"The model lacks {readable}.", "Look at what has changed there.")
    )


def named(effects: Sequence[str]) -> str:
    """Name effects in a sentence, the strongest first."""
    names = [effect_words(effect).name for effect in effects]
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


NOISE_ALONE = 1.5
"""Held-out error over the noise up to which a run is explained by its noise (chosen)."""


def finding_in_words(found: Mapping[str, Any]) -> str:
    """Say what an explanation found for one axis (an element of ``axes`` in its JSON), and what that was accepted does
    not show."""
    absent = found.get("absent", ())
    if not absent:
        return _finding(found)
    return (
        f"{_finding(found)} The run shows nothing of what was accepted for the model ({named(absent)}): it was "
        "mended, or has changed."
    )


def _finding(found: Mapping[str, Any]) -> str:
    accepted = found.get("accepted", ())
    model = f"accepted model (with {named(accepted)})" if accepted else "declared model"
    if found["finding"] == "none":
        left, noise = found["before"]["validation_rms"], found["noise_rms"]
        if not noise or left <= NOISE_ALONE * noise:
            return f"Nothing is missing: the {model} explains the run up to the sensor's noise."
        return (
            f"Nothing that matters was found missing: the {model} explains the run up to {left / noise:.1f} times the "
            "sensor's noise, as small impurities leave it that every machine has."
        )
    if found["finding"] == "unknown":
        where = f"Something is missing in the {model}" if accepted else "Something is missing"
        return (
            f"{where}, and no effect that Flankwatch knows explains it. Look for what is loose or has "
            "changed; the backlash value of this run may be off by more than its interval says."
        )
    rivals = [group for group in found["indistinguishable"] if len(group) > 1]
    lacking = f"The {model} lacks" if accepted else "The model lacks"
    said = f"{lacking} {named(found['effects'])}. {_change(found)}"
    if rivals:
        said += f" In these moves {named(rivals[0])} look alike; another move would tell them apart."
    return said


def _change(found: Mapping[str, Any]) -> str:
    before, after = found["before"]["backlash_m"], found["after"]["backlash_m"]
    if before is None or after is None:
        return ""
    return f"With it the backlash is {1e6 * after:.1f} µm; without it {1e6 * before:.1f} µm was believed."
