"""Reasons in a technician's words: what it means and what to look at first."""

from __future__ import annotations

_WORDS = {
    "no_moves": "The recording holds no diagnostic step.",
    "channel_missing": "A signal is missing. Check that the drive and the accelerometer are both recorded.",
    "rate_too_low": "The samples come too slowly for a gap this short. Check the SYNC period and the "
    "sensor's rate.",
    "not_finite": "The signals hold values that are not numbers. The recording is damaged.",
    "implausible_magnitude": "The size of a signal cannot be right. Check units and scaling in the "
    "configuration.",
    "frame_loss": "Samples are missing where they matter. Check bus load, cabling and termination.",
    "step_incomplete": "The step was not recorded from rest to rest.",
    "sensor_flat": "The accelerometer shows no motion. Check that it is fixed to the carriage and powered.",
    "sensor_clipped": "The accelerometer was over its range. Check its range, and whether it is knocked.",
    "wrong_sign": "The accelerometer moves against the drive. Check how it is mounted, or its sign in the "
    "configuration.",
    "signals_disagree": "Motor and accelerometer do not describe the same motion. Check that the axes are "
    "not swapped.",
    "trajectory_not_followed": "The axis did not follow the step as commanded. Check for obstacles and "
    "drive limits.",
    "excitation": "The step was not as sharp as the method needs. Check jerk and limits in the "
    "configuration.",
    "no_release": "The flanks were not seen to part. The gap may be too small, or the step too soft.",
    "no_recontact": "The flanks were not seen to meet again. The step may be too short for the gap.",
    "gap_not_crossed": "The carriage did not cross the whole gap in the step. A longer or sharper step is "
    "needed.",
    "gap_too_short": "The gap was crossed faster than the samples can follow.",
    "steps_disagree": "The steps give different values. Look for loose parts, dirt in the rack, or a moving "
    "load.",
    "too_few_steps": "Too few steps were usable for a value.",
    "misfit": "The recording does not look like a rack with backlash. Something else moves, or is loose.",
    "gantry_partner_missing": "The other side of the gantry was not recorded; one side alone cannot be "
    "judged.",
    "interval_too_wide": "The value would be too uncertain to be of use.",
    "interrupted": "The service was stopped while the run was waiting or moving.",
}  # fmt: skip


def in_words(reason: str | None) -> str | None:
    """Say a reason in words; one that has none yet is shown by its name, readable."""
    if reason is None:
        return None
    return _WORDS.get(reason, reason.replace("_", " ").capitalize() + ".")
