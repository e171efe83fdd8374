"""Over the ridges between the valleys of a fit.

How a chain swings is much the same with its springs or its masses otherwise divided, and a delay is much the same as a
clock that is off: a fit that has gone one of these ways ends in a valley of its own, a little off the moves and far off
others. A round of a few moves is cheap beside one of all, so many other chains are tried on these, and all moves are
fitted only from one that a few say to be nearer.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from service.backlash.moves import Moves
from service.backlash.moves_begun import Values, point_at, shared_at
from service.backlash.moves_fit import Fitted, fit, values_at
from service.backlash.moves_point import Point, limits
from service.dynamics.driven_model import LINKS, Model
from service.identification.held_out import overdamped
from service.identification.moves_looks import FROM_AFAR
from service.identification.moves_starts import (
    BRIEF,
    GUIDE,
    ROUNDS,
    RUBBED,
    SUMMED,
    TOLERANCES,
    Candidate,
    across_samples,
    begun_at,
    chain,
    fewer,
    fitted_from,
    on_all_axes,
    own_of_few,
    softer_contact,
    speeds_first,
    strong_of_one_sign,
)
from service.identification.moves_valleys import QUICK, SEED, asked
from service.recording import FloatArray

PUT_BACK = ("turnover_speed", "turnover_spread", "coulomb", "viscous", "damping_ratio", "smear")
"""Parameters that a wrong model drives into a corner from which a fit comes back slowly."""
CHAINS, WIDTHS = 20, (0.1, 1.0)
"""How many beginnings are tried, and between which shares of the priors' widths they differ (chosen)."""
FOLLOWED, LAST = 6, 2
"""How many of them are followed by as many rounds as starts are compared with, and how many of those to their end."""
FREQUENCIES = np.geomspace(6.0, 120.0, 28)
"""At which an effect is begun that swings otherwise than found [Hz] (chosen: from twice as far off, a fit of few moves
ends in another valley)."""
NEAR_ONES = 8
"""How many of these are continued (chosen)."""
OTHERWISE = 0.75
"""RMS of a few moves and their motors, over that of the present fit, up to which the motors speak for another valley
(chosen: where both end in the same one it is about as great)."""
LIGHT, SPRINGS = 0.01, np.geomspace(0.4, 2.5, 5)
"""Damping ratio of a chain that is hardly damped, and by what its springs are multiplied there (chosen: twice the
damping led to the planted chain, too, where no other beginning did, and four times did not)."""
COMPARED, AFTER = 8, 3
"""How many of those are followed after a few rounds, and how many of these to their end (chosen: the last of the eight
led to a planted chain)."""
OF_COULOMB = (0.97, 0.6)
"""Shares of a guide's friction that are begun with as Coulomb friction (chosen: a dry guide, and one that is well
lubricated)."""
SAME, NO_NEARER = 1.0, 0.98
"""Difference of every number, in standard deviations of its prior, within which a fit is in the same place, and the RMS
over that of before down to which it is (chosen: what is expected of the noise moves it by two parts in a hundred)."""
FAR_NEARER = 0.9
"""How much nearer to all moves a fit must be led across samples for nothing else to be tried (chosen)."""
NEARER = 0.99
"""How much nearer to a few moves another valley must be (chosen; all moves decide)."""


def over_ridges(found: Fitted, others: Callable[[Fitted], Iterator[FloatArray]] | None = None) -> Fitted:
    """The fit begun once more in the valley that a few moves say is nearer, or itself where they say none is, or all
    moves do not; from ``other_chains`` unless other beginnings are given, and with friction otherwise divided. Before
    that it is led across samples, and nothing else is tried where this leads far nearer. What begins on another machine
    is followed however far it is after a few rounds: it comes from farther than what begins near by, and may lead on.
    What was done in vain is not done again from the same place."""
    if not others and looked_about(found):
        return found
    on = found if others else across(found)
    if on.rms < FAR_NEARER * found.rms:
        return on
    found = on
    few, own = fewer(found), (own_of_few(found),)
    here = fit(few, found.model, Point(found.at.shared, own), BRIEF)
    starts = (others or other_chains)(found)
    tried = [fit(few, found.model, Point(shared, own), QUICK) for shared in starts]
    begun = [one.at for one in leading(tried, FOLLOWED)]
    machines = (put_back(found), put_back(found, chain(found.model)), on_typical_chain(found))
    back = [begun_at(few, found.model, values, own) for values in machines]
    near = [fit(few, found.model, at, BRIEF) for at in begun]
    near += [
        speeds_first(few, found.model, at, lasting, BRIEF)
        for at in (here.at, *back[1:])
        for lasting in SUMMED
    ]
    near += [
        fit(few, found.model, begun_at(few, found.model, v, own), BRIEF) for v in otherwise_rubbing(found)
    ]
    far = [fit(few, found.model, at, BRIEF) for at in back]
    on = if_nearer(found, here, [fit(few, found.model, f.at, ROUNDS) for f in (*leading(near, LAST), *far)])
    if on is not found or others:
        return on
    return replace(found, at=replace(found.at, in_vain=(found.rms, found.at.shared)))


def across(found: Fitted) -> Fitted:
    """The fit led on across samples on a few moves; itself where these or all moves say that it comes no nearer."""
    few = fewer(found)
    here = fit(few, found.model, Point(found.at.shared, (own_of_few(found),)), BRIEF)
    return if_nearer(found, here, [across_samples(few, here)])


def looked_about(found: Fitted) -> bool:
    """Whether other valleys were looked for in vain from where a fit stands, or from near by and as near to the moves:
    on the floor of a valley what no sample tells wanders on."""
    if found.at.in_vain is None:
        return False
    rms, before = found.at.in_vain
    if before.shape != found.at.shared.shape or found.rms < NO_NEARER * rms:
        return False
    return bool(np.max(np.abs(found.at.shared - before)) < SAME)


def as_motors_tell(found: Fitted) -> Fitted:
    """The fit of one axis begun once more where its motor says that it stands in a wrong valley, or itself where that
    leaves no more than the samples, or says none that is far nearer: a few moves and their motor are fitted from
    typical machines with hardly any to much friction, by the load's speed first. The samples of an axis that is pressed
    against one flank all the way are described by many a machine about as well, and its motor feels most of all how
    much friction there is."""
    if len(found.model.axes) > 1:
        return found
    few = asked(found)
    here = fit(few, found.model, Point(found.at.shared, (own_of_few(found),)), BRIEF)
    if here.rms_with_motors <= here.rms:
        return found
    rubbing = [p for p in found.model.parameters if p.name.endswith(GUIDE[0])]
    machines = ({p.name: float(p.value(u)) for p in rubbing} for u in RUBBED)
    begun = (point_at(found.model, values, few) for values in machines)
    near = [speeds_first(few, found.model, at, SUMMED[0], FROM_AFAR) for at in begun]
    best = min(near, key=lambda f: f.rms_with_motors)
    best = fit(few, best.model, best.at, ROUNDS)
    if best.rms_with_motors > OTHERWISE * here.rms_with_motors:
        return found
    return fitted_from(found, values_at(best), ROUNDS)


def if_nearer(found: Fitted, here: Fitted, others: Sequence[Fitted]) -> Fitted:
    """The fit, or the one that is begun where the best of `others` ended on a few moves, if that is nearer to these
    than the fit `here`, and to all moves, too."""
    best = leading(others, 1)[0]
    if best.rms > NEARER * here.rms:
        return found
    return min(found, fitted_from(found, values_at(best), ROUNDS), key=lambda f: f.rms)


def swinging_otherwise(found: Fitted, places: Sequence[Values] = ()) -> Fitted:
    """The fit begun once more with its last effect swinging at another frequency, and out of the corners that the wrong
    one drove the machine into, or on the machine as it is at one of the `places`; itself where that is not nearer, or
    nothing swings."""
    effect = found.model.effects[-1] if found.model.effects else None
    if effect is None or effect.free_swing is None:
        return found
    few = fewer(found)
    here = fit(few, found.model, Point(found.at.shared, (own_of_few(found),)), BRIEF)
    tried = leading(at_all_frequencies(few, found.model, (put_back(found), *places)), FOLLOWED)
    return if_nearer(found, here, [fit(few, found.model, one.at, ROUNDS) for one in tried])


def hardly_damped_chain(found: Fitted) -> Fitted:
    """The fit begun once more on a chain that hardly damps; itself where a few moves or all say that none is nearer."""
    few, own = fewer(found), (own_of_few(found),)
    here = fit(few, found.model, Point(found.at.shared, own), BRIEF)
    machines = (begun_at(few, found.model, v, own) for v in hardly_damped(found.model, values_at(found)))
    tried = leading([fit(few, found.model, at, QUICK) for at in machines], COMPARED)
    near = leading([fit(few, found.model, one.at, BRIEF) for one in tried], AFTER)
    return if_nearer(found, here, [fit(few, found.model, one.at, ROUNDS) for one in near])


def hardly_damped(model: Model, values: Values) -> Iterator[Values]:
    """The values with other springs between motor and flanks that hardly damp: a wrong chain is damped until it does
    not chatter, and from there no fit finds the one that does."""
    links = LINKS[model.lumps]
    for factors in product(SPRINGS, repeat=len(links)):
        out = dict(values)
        for axis, (link, factor) in product(model.axes, zip(links, factors, strict=True)):
            out[f"{axis}.{link}_stiffness"] *= factor
            out[f"{axis}.{link}_damping_ratio"] = LIGHT
        yield out


def at_all_frequencies(few: Sequence[Moves], model: Model, machines: Sequence[Values]) -> list[Fitted]:
    """Fits of a few moves that are begun with machines of these values whose last effect swings at any frequency, as
    strong as it may well be; none if it does not swing. One frequency is as good as the next but near the right one,
    so all are begun, and those continued that are nearest then."""
    effect = model.effects[-1]
    if effect.free_swing is None:
        return []
    frequency, strong = effect.free_swing[0], strong_of_one_sign(Candidate(effect, model))
    held = np.zeros(0, dtype=np.int64)
    fits = list[Fitted]()
    names = {p.name for p in model.parameters}
    for machine, hz in product(machines, FREQUENCIES):
        kept = {name: value for name, value in machine.items() if name in names}
        values = {**kept, **on_all_axes(effect, {frequency: float(hz)}), **strong}
        still = fit(few, model, point_at(model, values, few), QUICK, free=held)
        fits.append(fit(few, model, still.at, QUICK))
    near = sorted(fits, key=lambda f: f.rms_with_motors)[:NEAR_ONES]
    return [fit(few, model, one.at, BRIEF - QUICK) for one in near]


def put_back(found: Fitted, too: Collection[str] = ()) -> Values:
    """The values of a fit without those that a wrong model drives into a corner, those of a link that is damped as none
    is, and what is given `too`, without the axis' name."""
    odd = tuple(name.removesuffix("damping_ratio") for name in overdamped(found))
    return {
        name: v
        for name, v in values_at(found).items()
        if not name.endswith(PUT_BACK) and not name.startswith(odd) and name.rpartition(".")[2] not in too
    }


def on_typical_chain(found: Fitted) -> Values:
    """The play, the friction and the effects of a fit, for a machine that is typical in all else: masses, springs and
    contact that were found beside something else may stand where no way leads out, however near the effect is."""
    own = {p.name for effect in found.model.effects for p in effect.parameters}
    kept = {name for name in own if not name.endswith(TOLERANCES)}
    return {k: v for k, v in values_at(found).items() if k in kept or k.endswith(("backlash", *GUIDE))}


def otherwise_rubbing(found: Fitted) -> Iterator[Values]:
    """The values of a fit with the friction of every guide, as much at the mean speed of the moves, otherwise divided
    into Coulomb and viscous: what tells them apart is how the load stops, and a fit that stops it otherwise, by a
    chain that is not the machine's, finds its way back over a ridge only."""
    values, moves = values_at(found), [move for part in found.moves for move in part.made]
    speed = sum(move.length for move in moves) / sum(move.duration for move in moves)
    for share in OF_COULOMB:
        out = dict(values)
        for axis in found.model.axes:
            coulomb, viscous = (f"{axis}.{name}" for name in GUIDE)
            friction = values[coulomb] + speed * values[viscous]
            out |= {coulomb: share * friction, viscous: (1.0 - share) * friction / speed}
        yield out


def leading(fits: Sequence[Fitted], count: int) -> list[Fitted]:
    """The fits that are nearest to their moves."""
    return sorted(fits, key=lambda f: f.rms)[:count]


def other_chains(found: Fitted) -> Iterator[FloatArray]:
    """Coordinates (P,) of a fit with another chain between motor and flanks: where the contact is the stiffer one it
    and the shaft exchanged, then at random about the fit's and without what a clock or a smear adds."""
    model = found.model
    short = [p.name.rpartition(".")[2] for p in model.parameters]
    plain = np.where([name in TOLERANCES for name in short], 0.0, found.at.shared)
    if exchanged := softer_contact(values_at(found), model):
        yield shared_at(model, exchanged)
    yield from scattered(found, plain, [name in chain(model) for name in short])


def other_sizes(found: Fitted) -> Iterator[FloatArray]:
    """Coordinates (P,) of a fit with other numbers of its last effect, and out of the corners that the wrong ones drove
    it into: a hung mass that swings at another frequency takes the guide's friction for its own damping."""
    model = found.model
    own = {p.name for p in model.effects[-1].parameters} if model.effects else set()
    yield from scattered(found, shared_at(model, put_back(found)), [p.name in own for p in model.parameters])


def scattered(found: Fitted, about: FloatArray, moved: Sequence[bool]) -> Iterator[FloatArray]:
    """Coordinates (P,) at random about given ones, those that are `moved` each by a share of its prior's width."""
    rng, which = np.random.default_rng(SEED), np.flatnonzero(moved)
    for width in np.geomspace(*WIDTHS, CHAINS):
        shared = about.copy()
        shared[which] += width * rng.standard_normal(len(which))
        yield np.clip(shared, *limits(found.model).T)
