"""How two gaps divide the play of one: fits to samples and motors' equations of motion together, continued through
where the moves' loads and pinions lie, and begun with the play otherwise divided."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from service.backlash.moves import Moves
from service.backlash.moves_begun import Values
from service.backlash.moves_fit import Fitted, fit, values_at
from service.backlash.moves_point import Point
from service.backlash.moves_refined import reconstructed
from service.identification.moves_carried import AGAINST
from service.identification.moves_end import RIDGE
from service.identification.moves_lying import first_elsewhere, lying_as_left, pinions_lie
from service.identification.moves_ridges import FAR_NEARER, NEARER, hardly_damped
from service.identification.moves_starts import (
    BRIEF,
    ROUNDS,
    begun_at,
    fitted_from,
    own_of_few,
    softer_contact,
)
from service.identification.moves_valleys import QUICK, asked, by_rests
from service.identification.selection import UNKNOWN_NUMBERS

TURNS = 2
"""How often a fit with its motors asked and the reconstructed motion take turns (chosen)."""
STEPS, PATIENCE = 8, 3
"""How often at most a fit goes on from where its own numbers leave loads and pinions, and how often at least (chosen:
the first steps lead uphill, out of what fitted with pinions that lay elsewhere)."""
SHARES, NEAR_BY = np.linspace(0.05, 0.95, 19), np.array([0.02, 0.04, 0.08])
"""Shares of all play with which the backlash is begun, and how far from the one that is reached afterwards (chosen)."""
HELD = (0.125, 0.25, 0.5, 0.7, 1.4, 2.0, 4.0)
"""Over those of a fit, what holds a pinion with which it is begun (chosen)."""
DIVIDED, COMPARED, FOLLOWED = 6, 8, (3, 1)
"""How often at most a fit is begun with its play otherwise divided; how many of each kind of beginnings are compared;
and how many are fitted to all moves, of those from afar and of those from near by (chosen)."""


def jointly(found: Fitted) -> Fitted:
    """The fit continued to the samples and to its motors' equations of motion, in turns with the motors' motion, the
    first move of a recording begun with its pinion where these describe it best."""
    lie = pinions_lie(found.model)
    for turn in range(TURNS):
        moves = reconstructed(found, asked=True)
        at = first_elsewhere(moves, found.model, found.at) if lie and not turn else found.at
        found = fit(moves, found.model, at, ROUNDS)
    return found


def led_through_rests(found: Fitted) -> Fitted:
    """The fit, or the nearest of those that go on from it with every move begun where the one before leaves load and
    pinion by the numbers found so far: a move that is begun elsewhere draws the shared numbers after it, and by itself
    hardly tells where it began."""
    best = on = found
    for turn in range(STEPS if pinions_lie(found.model) else 0):
        moves, at = lying_as_left(on.moves, on.model, on.at)
        begun = reconstructed(replace(on, moves=moves, at=at), asked=True)
        on = fit(begun, on.model, at, ROUNDS)
        best, before = min(best, on, key=lambda f: f.rms_with_motors), best
        if turn >= PATIENCE and best.rms_with_motors > RIDGE * before.rms_with_motors:
            break
    return best


def otherwise_divided(found: Fitted) -> Fitted:
    """The fit, or the nearest that begins with its pinions otherwise held, its play otherwise divided between the two
    gaps, or on a chain that is hardly damped, by samples and motors together, then from near by, as long as that is
    nearer and more than noise is left: a few moves choose where all are fitted, and choose none that comes no nearer
    to them and leaves more than unknown numbers do. It is begun elsewhere at least once however near it is: what
    the noise is put at may be too much."""
    for turn in range(DIVIDED):
        if turn and found.rms_with_motors < 1.0:
            break
        few, own = asked(found), (own_of_few(found),)
        present = fit(few, found.model, Point(found.at.shared, own), BRIEF).rms_with_motors
        best = nearest_of(begun_elsewhere(few, found, present, near_by=turn > 0), FOLLOWED[turn > 0])
        if present > UNKNOWN_NUMBERS and best[0].rms_with_motors > NEARER * present:
            break
        starts = (fitted_from(found, values_at(one), 0) for one in best)
        before, near = found, nearest_of(map(jointly, starts), FOLLOWED[0])
        led = (
            led_through_rests(one) for one in near if one.rms_with_motors < AGAINST * near[0].rms_with_motors
        )
        found = nearest_of([found, *led], 1)[0]
        if found.rms_with_motors > RIDGE * before.rms_with_motors:
            break
    return found


def begun_elsewhere(few: Sequence[Moves], found: Fitted, present: float, near_by: bool) -> list[Fitted]:
    """Fits of a few moves, of which a fit leaves so much at `present`, from its numbers with its pinions otherwise
    held; where none of these comes plainly nearer, with its play otherwise divided, and on other chains, too."""
    held = promising_of_few(few, found, held_otherwise(found))
    if any(one.rms_with_motors < FAR_NEARER * present for one in held):
        return held
    divided = promising_of_few(few, found, divisions(found, near_by))
    chains = () if near_by else hardly_damped(found.model, values_at(found))
    return [*held, *divided, *promising_of_few(few, found, chains)]


def promising_of_few(few: Sequence[Moves], found: Fitted, ways: Iterable[Values]) -> list[Fitted]:
    """Fits of a few moves from these values, of those that come nearest after a few rounds."""
    begun = (begun_at(few, found.model, values, (own_of_few(found),)) for values in ways)
    quick = nearest_of((fit(few, found.model, at, QUICK) for at in begun), COMPARED)
    return [by_rests(few, fit(few, found.model, one.at, BRIEF - QUICK)) for one in quick]


def nearest_of(fits: Iterable[Fitted], count: int) -> list[Fitted]:
    """The fits that are nearest to their moves and motors."""
    return sorted(fits, key=lambda f: f.rms_with_motors)[:count]


def held_otherwise(found: Fitted) -> Iterator[Values]:
    """The values of a fit with what holds its pinions between their gaps larger or smaller, with its damping and
    without."""
    present, held = values_at(found), found.model.effects[-1].held
    undamped = {name: v for name, v in present.items() if not name.endswith("damping_ratio")}
    for values in (present, undamped):
        for by in HELD:
            yield {name: by * v if name.endswith(held) else v for name, v in values.items()}


def divisions(found: Fitted, near_by: bool) -> Iterator[Values]:
    """The values of a fit with all play otherwise divided, somewhat, or from end to end without its damping, which a
    wrong division drives into a corner; with its chain and with shaft and contact exchanged if the contact is the
    stiffer one."""
    present = values_at(found)
    gaps = [(f"{axis}.backlash", f"{axis}.clearance") for axis in found.model.axes]
    both = [present[first] + present[second] for first, second in gaps]
    now = sum(present[first] for first, _ in gaps) / sum(both)
    shares = now + np.concatenate((-NEAR_BY, NEAR_BY)) if near_by else SHARES
    kept = {name: v for name, v in present.items() if near_by or not name.endswith("damping_ratio")}
    for values in filter(None, (kept, softer_contact(kept, found.model))):
        for share in np.clip(shares, SHARES[0], SHARES[-1]):
            yield dict(found.model.effects[-1].divided(values, 1.0 - share))
