"""Reasons in a technician's words: what it means and what to look at first."""

from __future__ import annotations

import re

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
    "sensors_in_doubt": "It does not show at once which accelerometer sits on which side; the refined value follows.",
    "sensors_swapped": "The accelerometers of two axes seem to be swapped. Check which is fixed to which carriage.",
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
    "program_fault": "Flankwatch itself failed. Please report it, with the journal of the service.",
    "BusNotOpened": "The CAN interface could not be opened. Check that it is up.",
    "BusLost": "The CAN interface went away. Check the adapter and its plug.",
    "BusOff": "The CAN bus switched itself off. Check cable, termination and bit rate.",
    "BusSilent": "Nothing was heard on the CAN bus. Check the supply of the drives and the cable.",
    "BusOverloaded": "The CAN bus carries more than it can.",
    "NodeSilent": "A drive does not answer. Check its supply and its node number.",
    "NodeRestarted": "A drive restarted during the run. Check its supply.",
    "WrongDevice": "Another device than expected answers. Check the node numbers in the configuration.",
    "ObjectRefused": "A drive refused a setting that the run needs.",
    "DriveFault": "A drive reported a fault. See its display and its manual.",
    "StateTransitionTimeout": "A drive could not be switched on. Check emergency stop, brake and supply.",
    "MoveRefused": "A drive refused to move.",
    "MoveNotFinished": "A step was not finished in time. Check for obstacles, brake and drive limits.",
    "SensorSilent": "Nothing came from the accelerometer. Check its plug and its supply.",
    "SensorTooSlow": "The accelerometer sends too slowly. Check its setting.",
    "SensorFault": "The accelerometer reported a fault of its own.",
    "SamplesMissing": "Samples were lost on the way. Check bus load, cabling and termination.",
    "NotPermitted": "The machine was not in a state in which the axis may move.",
    "RunStopped": "The run was stopped before its end.",
}


def in_words(reason: str | None) -> str | None:
    """Say a reason in words; one that has none is shown by its name, made readable."""
    if reason is None:
        return None
    readable = re.sub(r"(?<=[a-z])(?=[A-Z])|_", " ", reason).capitalize() + "."
    return _WORDS.get(reason, readable)
