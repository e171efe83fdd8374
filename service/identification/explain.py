"""Close the loop: from recordings of a machine to what its declared model lacks, with the error before and after.

One verdict per axis, in the channel that says most: load acceleration against the measured motor motion where
there are diagnostic moves, else motor minus load, else the torque balance at the motor.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from service.dynamics.compiling import compiled_apart
from service.identification.axis_explain import explain_axes
from service.identification.checks import check_recordings
from service.identification.explanation import Accepted, AxisExplanation, CannotExplain, Explanation
from service.identification.regression import RegressionChannel
from service.identification.regression_explain import explain_regression
from service.recording import Recording

MIN_MOVES = 4
"""Moves that a recording needs for a verdict: two in each direction."""
MIN_ACCELERATION_HZ = 500.0
NOTHING: Mapping[str, Accepted] = {}


def explain(
    train: Sequence[Recording],
    validate: Recording,
    tell: Callable[[str], None] = lambda _message: None,
    accepted: Mapping[str, Accepted] = NOTHING,
    patience: float = 1.0,
) -> Explanation:
    """What the model of each axis lacks: the declared one, or the one that was accepted since.

    Parameters
    ----------
    train : recordings that the models are fitted to
    validate : the recording that judges them; only where the pinion or a position sensor has its zero is found
        again in it
    tell : called with a line of progress now and then
    accepted : by axis, what its model has by an accepted revision, as far as diagnostic moves tell; beyond it is
        searched as long as the moves show it, and else beyond the declared model
    patience : how much longer than a few minutes at most what moves lack is searched for; 2 is twice as long

    Raises
    ------
    CannotExplain : the recordings allow no verdict; the message says why and what to do
    """
    check_recordings(train, validate)
    compiled_apart()
    found: list[AxisExplanation] = []
    for axes in _groups(validate):
        found += _explain_group(train, validate, axes, tell, accepted, patience)
    return Explanation(tuple(found))


def _groups(validate: Recording) -> list[tuple[str, ...]]:
    """Axes one by one; two that make the same moves together, since a bridge between them may be undeclared."""
    if len(validate.axes) == 2 and not validate.gantry and validate.moves:
        return [(validate.axes[0].name, validate.axes[1].name)]
    paired = {name for pair in validate.gantry for name in pair}
    lacking = paired - {axis.name for axis in validate.axes}
    if lacking:
        raise CannotExplain(
            f"{', '.join(sorted(lacking))} moves a gantry with another axis and was not recorded; record both axes."
        )
    return [*validate.gantry, *((a.name,) for a in validate.axes if a.name not in paired)]


def _explain_group(
    train: Sequence[Recording],
    validate: Recording,
    axes: tuple[str, ...],
    tell: Callable[[str], None],
    accepted: Mapping[str, Accepted],
    patience: float,
) -> list[AxisExplanation]:
    everything = (*train, validate)
    if all((a, c) in r.traces for r in everything for a in axes for c in ("motor_speed", "acceleration")):
        _moves_allow(everything, axes)
        return list(explain_axes(train, validate, axes, tell, accepted, patience))
    found = []
    for axis in axes:
        one = _explain_regression(train, validate, axis, tell)
        if one is None:
            raise CannotExplain(
                f"axis {axis}: no pair of channels that a residual could be taken of was recorded throughout; "
                "record motor speed and load acceleration, or a load position, or the motor torque"
            )
        found.append(one)
    return found


def _moves_allow(recordings: Sequence[Recording], axes: Sequence[str]) -> None:
    for number, recording in enumerate(recordings):
        name = "validate" if number == len(recordings) - 1 else f"train recording {number + 1}"
        if len(recording.moves) < MIN_MOVES:
            raise CannotExplain(
                f"{name} holds {len(recording.moves)} diagnostic moves, at least {MIN_MOVES} are needed to tell a "
                "model from chance; run the diagnostic steps and record them"
            )
        for axis in axes:
            trace = recording.traces[axis, "acceleration"]
            rate = (len(trace) - 1) / float(trace.time[-1] - trace.time[0])
            if rate < 0.9 * MIN_ACCELERATION_HZ:
                raise CannotExplain(
                    f"{name}, {axis} acceleration: {rate:.0f} Hz, at least {MIN_ACCELERATION_HZ:.0f} Hz"
                )


def _explain_regression(
    train: Sequence[Recording], validate: Recording, axis: str, tell: Callable[[str], None]
) -> AxisExplanation | None:
    channels: tuple[RegressionChannel, ...] = ("load_position", "load_speed", "motor_torque")
    for channel in channels:
        found = explain_regression(train, validate, axis, channel, tell)
        if found is not None:
            return found
    return None
