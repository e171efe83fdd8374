"""What every sound machine has a little of, and whether what was found is no more than that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from service.dynamics.effects.driven_library import DRIVEN
from service.identification.axis_numbers import deviations
from service.identification.held_out import Explained
from service.identification.selection import (
    CHANGED,
    LEFT,
    LEFT_BY_CLEAN,
    PART,
    Selection,
    Trial,
    distance,
    explained,
    left,
    most_left,
    shown,
)

LEFT_BY_ONE = 3.0
"""What an effect that explains nearly all by itself may leave, over what is expected: it is how its law differs from
the machine's (chosen)."""

NEXT_TO_ALL = 0.99
"""Share of what is missing in the held-out moves from which on it is everything, whatever is left (chosen)."""


class Impurity(NamedTuple):
    """The number that says how much there is of something, the most that a sound machine has of it, the most where
    it is the whole explanation of more than impurities leave, and what it repeats in; of what repeats, that is a share
    of the period."""

    number: str
    most: float
    most_of_all: float
    period: str | None = None


COMMON: Mapping[str, Impurity] = {
    "transmission_ripple": Impurity("ripple_amplitude", np.inf, 1e-3, period="ripple_period"),
    "contact_nonlinearity": Impurity("bend", 0.2, 0.0),
    "hung_mass_mode": Impurity("hung_ratio", 0.02, 0.0),
    "machine_body_mode": Impurity("body_ratio", 0.02, 0.0),
    "constant_force": Impurity("constant_force", 0.02, 0.0),
}
"""What every rack, flank, carriage and bed has a little of, and what is therefore no finding where it does not change
the backlash. Steel on steel in line contact has a bend of 1/9; twice that is none. Hoses, chains and covers of a
fiftieth of the load hang elastically on every carriage, and a body fifty times as heavy hardly moves. A bed that
falls by 2 mm in a metre is level enough to run, and pulls with a fiftieth of a m/s². A mesh has no
limit by itself: a slow error may be large; a thousandth of the pitch is small. What repeats with the rack's teeth or
more slowly is of its mesh."""
TOOTH = 3e-3
"""Pitch of the finest rack [m]: that of module 1. What repeats in less comes from within the transmission."""
SURELY = 2.0
"""Standard deviations by which a number is beyond what a sound machine has."""


def of_every_machine(selection: Selection[Explained]) -> bool:
    """Whether what was found is what every sound machine has, and leaves next to nothing, also in the moves that were
    not fitted, or explains a part of what is missing there and leaves no more than where the machine is what it was; if
    it explains nearly all by itself, no more than its law leaves that differs from the machine's."""
    before, after = selection.before, selection.after
    by_law = left(after) <= LEFT_BY_ONE and most_left(after) <= CHANGED
    described = shown(after) <= LEFT_BY_CLEAN or explained(before, after, NEXT_TO_ALL)
    everything = before.validation_rms > CHANGED and described
    foretold = shown(after) <= LEFT or (explained(before, after, PART) and most_left(after) <= CHANGED)
    whole = (by_itself(selection) and by_law) or (left(after) <= LEFT and foretold)
    return whole and common(selection, everything)


def by_itself(selection: Selection[Explained]) -> bool:
    """Whether one effect explains nearly all by itself."""
    return len(selection.effects) == 1 and explained(selection.before, selection.after)


def common(selection: Selection[Explained], everything: bool = False) -> bool:
    """Whether all that was found is what every sound machine has, and as much as such a machine may have; less, and
    nothing quicker than teeth, where it explains `everything` of more than impurities leave."""
    if not COMMON.keys() >= set(selection.effects):
        return False
    numbers = deviations(selection.after.model.fitted)
    for effect in selection.effects:
        impurity = COMMON[effect]
        periods = [both for name, both in numbers.items() if name.rpartition(".")[2] == impurity.period]
        if everything and any(value + SURELY * std < TOOTH for value, std in periods):
            return False
        per = min((value for value, _ in periods), default=1.0)
        most = per * impurity.most_of_all if everything else impurity.most
        of_axes = [both for name, both in numbers.items() if name.rpartition(".")[2] == impurity.number]
        if any(abs(value) - SURELY * std > most for value, std in of_axes):
            return False
    return True


def common_comes_as_near(selection: Selection[Explained]) -> bool:
    """Whether something that every sound machine has, as much as one may have, comes as near to all moves as what was
    found: then that is the likelier explanation."""
    near = (trial for trial in selection.tried if distance(trial) <= distance(selection.after))
    return any(is_common(selection, trial) for trial in near)


def common_suffices(selection: Selection[Explained]) -> bool:
    """Whether beside an effect whose law has many valleys, and imitates much, something that every sound machine has,
    as much as one may have, leaves next to nothing in all moves: then nothing else need be there."""
    if not any(DRIVEN[name].many_valleys for name in selection.effects if name in DRIVEN):
        return False
    return any(
        most_left(trial) <= LEFT_BY_CLEAN
        and not trial.at_limits
        and explained(selection.before, trial, PART)
        and is_common(selection, trial)
        for trial in selection.tried
    )


def is_common(selection: Selection[Explained], trial: Trial[Explained]) -> bool:
    """Whether the effect of a trial is what every sound machine has, and as much as one may have."""
    return common(taken_instead(selection, trial))


def indistinguishable(selection: Selection[Explained]) -> list[Selection[Explained]]:
    """The selections as if each of the rivals of one effect had been taken instead of it; none beside several."""
    if len(selection.effects) != 1:
        return []
    rivals = {name for pair in selection.rivals for name in pair} - set(selection.effects)
    others = (taken_instead(selection, trial) for trial in selection.tried)
    return [other for other in others if other.effects[0] in rivals]


def taken_instead(selection: Selection[Explained], trial: Trial[Explained]) -> Selection[Explained]:
    """The selection as if one that was tried had been taken, and nothing else."""
    return replace(selection, effects=(trial.model.fitted.model.effects[-1].name,), after=trial)
