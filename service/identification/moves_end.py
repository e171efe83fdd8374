"""A fit brought to its end: with the motors' motion reconstructed from it until both agree, and out of the corners that
a wrong model drove it into.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from service.backlash.moves_begun import Values, begun_anew, expecting_its_own, point_at, shared_at
from service.backlash.moves_fit import Fitted, fit, values_at
from service.backlash.moves_parts import some_of
from service.backlash.moves_point import Point
from service.backlash.moves_refined import hearing_motors, reconstructed, zeros_alike
from service.dynamics.driven_model import LINKS
from service.identification.axis_numbers import covariance
from service.identification.held_out import DESCRIBED, NEAR, TOLD, Explained, overdamped, trial_of
from service.identification.moves_looks import ENDED, FROM_AFAR
from service.identification.moves_rests import (
    AT_FIRST,
    KNOWN,
    WORSE,
    at_near_frequencies,
    begun_as_left,
    how_known,
    swinging_on,
    swings_at_all,
)
from service.identification.moves_ridges import (
    as_motors_tell,
    hardly_damped_chain,
    other_sizes,
    over_ridges,
    put_back,
    swinging_otherwise,
)
from service.identification.moves_starts import (
    BRIEF,
    FINE,
    GAINED,
    ROUNDS,
    SUMMED,
    TOLERANCES,
    across_samples,
    begun_at,
    chain,
    fewer,
    fitted_from,
    how_few,
    own_of_few,
    speeds_first,
    unanswering,
)
from service.identification.scene import Scene
from service.identification.selection import LEFT, UNKNOWN_NUMBERS, Trial, most_left

BY_SETTLING = 0.5
"""Share of its RMS that a fit keeps when it is settled, below which others are settled beside it (chosen)."""
MORE, GAIN = 3, 0.005
"""How often a fit of what swings is continued, each time with the swings that it leaves, and the share of its RMS that
it must gain to be continued again."""
TURNS, STEADY = 8, 2.0
"""How often a fit and the reconstructed motion take turns at the end, and the change of the sum of squares, over the
noise, from which on they agree (chosen: a standard deviation of one number changes it by one)."""
STILL = 1e-4
"""Share of its RMS by which a fit changes between two turns that goes nowhere any more (chosen: ended at five times
as much, the fit of the shared Stribeck pair was still on its way)."""
FEW_ROUNDS = 4
"""Rounds of a fit between two turns of a motion that a wrong chain may have made."""
CORNER = ("turnover_speed", "turnover_spread", "damping_ratio", *TOLERANCES)
"""Numbers in a corner that a fit is led out of by the loads' speeds; the guide's friction is kept."""
RIDGE = 0.995
"""RMS, over that of a fit, from which on another valley is a better one (chosen)."""
PLAINLY_NEARER = 0.9
"""RMS, over that of the declared model's fit, below which it lies in another valley and not elsewhere in the same one
(chosen)."""
FURTHER = 3
"""How often a fit that may be the right one is led over further ridges at most (chosen)."""
OF_PINION = 1.0 / 3.0
"""Share of a drive's mass that is begun with as the pinion's (chosen; the fit finds it)."""
SOUND = 2.0
"""RMS from which on the declared model is not finished: it lacks something, and is only what is improved on (chosen; up
to 1.6 it may be called sound)."""
HOPELESS = NEAR
"""RMS from which on neither more rounds nor what still swings makes a fit's effect the right one, and another start
only where it takes a part of what is missing."""
OF_ADDED, HOWEVER_FAR, LOOKED_FOR_NEXT = (ENDED, HOPELESS), (ENDED, np.inf), (HOPELESS, np.inf)
"""Between which RMS another valley is looked for: of a model with an added effect that takes less than a part of what
is missing, of which hardly any is the right one in another valley; of one from which all others begin, or whose effect
takes a part; and of a fit that `steady` ends next, which looks for the others."""
CORNERED = 4.5
"""Standard deviations of its prior beyond which no mass and no spring of a chain is."""
AS_GOOD = 1.01
"""How much farther from the moves a fit with a sound damping is where any damping is as good (chosen)."""
AS_WELL = 1.1
"""How much farther from the moves a fit with a sound damping may be, or one that is begun elsewhere (chosen)."""
EXPECTED = 1.02
"""RMS of whitened residuals up to which they are as expected (chosen: right fits that left between 1.00 and 1.02 were
led nowhere over ridges, four of four, and one that left 1.12 to 1.04)."""
WIDER, UNREACHED = 1.02, 0.1
"""By what a gap is multiplied whose second flank may not be reached, and the share of what the sum of squares would
rise by, if it were known as closely as the fit claims, up to which it is not (chosen)."""


def settled(found: Fitted, rounds: int, ridges: tuple[float, float] = OF_ADDED) -> Fitted:
    """The fit continued with the motors' motion reconstructed from it, a move that stands out begun anew, and where it
    is not near, in another valley: between RMS of `ridges`, of what swings from the least on; a caller that looks for
    it next, or has, gives others."""
    found = begun_anew(found)
    on = fit(reconstructed(found), found.model, found.at, rounds)
    first, last = ridges
    if (ENDED if swings_at_all(on.model) else first) <= on.rms < last:
        on = over_ridges(on)
    on = begun_as_left(on, rounds) if on.rms >= HOPELESS and swings_at_all(on.model) else on
    return on if on.rms >= HOPELESS else followed(on, rounds)


def settled_present(found: Fitted, rounds: int, elsewhere: bool) -> Fitted:
    """The same of the declared model. Where it lacks something it is only improved on, in the best of its valleys, and
    where it lacks much, or none `elsewhere` is asked for, in that where it stands: its numbers are not the machine's,
    however closely they are found, and whichever effect is the right one leads out of it."""
    on = fit(reconstructed(found), found.model, found.at, rounds)
    on = over_ridges(on) if elsewhere and SOUND < on.rms < HOPELESS else on
    return on if on.rms > SOUND else followed(on, rounds)


def declared_end(fits: Iterable[Fitted], rounds: int, smooth: float) -> Fitted:
    """Where the fits of the declared model end that is nearest: the first, or the best of all where settling takes most
    of what it leaves, so that how near it came before says little; or where the motors tell another valley. No other
    valley is asked for where with all `smooth` effects next to nothing is left, by that RMS, and without them much,
    begun there, too: one of these is missing, and is missing in all valleys."""
    ends, elsewhere = list[Fitted](), smooth > UNKNOWN_NUMBERS
    for found in fits:
        ends.append(settled_present(found, rounds, elsewhere))
        if ends[-1].rms > BY_SETTLING * found.rms:
            break
    nearest = min(ends, key=lambda f: f.rms)
    if elsewhere and nearest.rms > SOUND and (told := as_motors_tell(nearest)) is not nearest:
        other = settled_present(told, rounds, elsewhere)
        return other if other.rms < PLAINLY_NEARER * nearest.rms else nearest
    return nearest


def led_on(found: Fitted, near: float = HOPELESS, places: Sequence[Values] = ()) -> Fitted:
    """A fit that may be the right one and yet leaves more than noise, over further ridges and followed from there as
    long as that is nearer: what lies near a valley is searched, and the right one may lie behind the next, where the
    effect is of another size, or where it swings at another frequency, on its machine or as that is at one of the
    `places`. One that is hopeless, and yet `near`, only where the chain is another."""
    for _ in range(FURTHER):
        if not UNKNOWN_NUMBERS <= found.rms < near:
            break
        on = over_ridges(found)
        if found.rms < HOPELESS:
            on = over_ridges(found, other_sizes) if on.rms > RIDGE * found.rms else on
            on = swinging_otherwise(found, places) if on.rms > RIDGE * found.rms else on
        further = on if on.rms >= HOPELESS or on.rms > RIDGE * found.rms else followed(on, ROUNDS)
        if further.rms >= found.rms:
            break
        found = further
    return found


def followed(on: Fitted, rounds: int) -> Fitted:
    """A fit that may be the right one, out of its corners and in turns with the motors' motion."""
    return swung_in(as_damped(in_turns(out_of_corner(on, rounds))))


def wider_where_unreached(found: Fitted) -> Fitted:
    """The fit with every gap wider whose second flank the load need not come to: where another axis holds it, it may
    come there only because the gap is as wide as the fit says. A slope that is taken there claims that the moves tell
    how wide it is, and shows nothing of how well they are described by one that is wider."""
    for axis in found.model.axes if len(found.model.axes) > 1 else ():
        values, gap = values_at(found), f"{axis}.backlash"
        k = [p.name for p in found.model.parameters].index(gap)
        others = np.delete(np.arange(len(values)), k)
        here, wider = (
            fitted_from(found, {**values, gap: by * values[gap]}, FEW_ROUNDS, others) for by in (1.0, WIDER)
        )
        claimed = (wider.at.shared[k] - here.at.shared[k]) ** 2 / covariance(found)[k, k]
        if claimed > 1.0 and wider.r @ wider.r - here.r @ here.r < UNREACHED * claimed:
            found = fit(found.moves, found.model, wider.at, 0)
    return found


def out_of_corner(found: Fitted, rounds: int) -> Fitted:
    """The fit, or a nearer one begun with a typical chain where a mass or a spring of it is as no machine's: the motion
    of the motors that was made with such a chain fits no other, so it is made anew before the two are compared."""
    if found.rms < ENDED or not cornered(found):
        return found
    begun = fitted_from(found, put_back(found, chain(found.model)), rounds)
    return min(found, fit(reconstructed(begun), begun.model, begun.at, rounds), key=lambda f: f.rms)


def cornered(found: Fitted) -> bool:
    """Whether a mass or a spring of a fit's chain is as no machine's."""
    links = {f"{link}_{of}" for link in LINKS[found.model.lumps] for of in ("mass", "stiffness")}
    numbers = zip(found.model.parameters, found.at.shared, strict=True)
    return any(abs(u) >= CORNERED for p, u in numbers if p.name.rpartition(".")[2] in links)


def in_turns(found: Fitted) -> Fitted:
    """The best of the fits to the motion of the motors that is reconstructed from the one before, each of a few rounds,
    until they stand still. A wrong chain makes a motion that fits it, and the way from there leads uphill first."""
    best = on = found
    for _ in range(TURNS):
        if best.rms < DESCRIBED:
            break
        before, on = on, fit(reconstructed(on), on.model, on.at, FEW_ROUNDS)
        best = min(best, on, key=lambda f: f.rms)
        if abs(on.rms - before.rms) < STILL * on.rms:
            break
    return best


def as_damped(found: Fitted) -> Fitted:
    """The fit with the damping ratios that no chain has at their typical values, if the moves are described about as
    well: of a spring so stiff that no sample tells how it swings, any damping is as good. Else they stand in a corner,
    from which the way back leads over a ridge, and over a second one where the friction came along; the nearer is
    taken."""
    names = overdamped(found)
    if not names:
        return found
    free = np.array([k for k, p in enumerate(found.model.parameters) if p.name not in names])
    values = {name: v for name, v in values_at(found).items() if name not in names}
    damped = fitted_from(found, values, ROUNDS, free)
    if damped.rms >= AS_GOOD * found.rms:
        out = begun_by_speeds(found)
        if out.rms < min(damped.rms, AS_WELL * found.rms) and not overdamped(out):
            return out
    return fit(found.moves, found.model, damped.at, 0) if damped.rms < AS_WELL * found.rms else found


def begun_by_speeds(found: Fitted) -> Fitted:
    """The model of a fit fitted once more from the nearest of fits of a few moves by the loads' speeds, where every way
    is quickly tried: with the numbers of a corner put back, and with the chain put back. One that is damped as no chain
    is comes last; where none is about as near as the fit, it stays."""
    few, tried = fewer(found), []
    for names in (CORNER, (*TOLERANCES, *chain(found.model))):
        values = {name: v for name, v in values_at(found).items() if not name.endswith(names)}
        at = point_at(found.model, values, few)
        tried += [speeds_first(few, found.model, at, lasting, FROM_AFAR) for lasting in SUMMED]
    best = min(tried, key=lambda f: (bool(overdamped(f)), f.rms))
    if best.rms > AS_WELL * found.rms:
        return found
    at = begun_at(found.moves, found.model, values_at(best), zeros_alike(found.moves, best))
    return fit(found.moves, found.model, at, ROUNDS)


def swung_in(found: Fitted) -> Fitted:
    """The fit continued, every move beginning as the move before it left what swings, as closely as the moves are
    described as well. Where that is not close, though the moves are described, the first of those that swing at a
    frequency close by and are: on the way to where all moves agree a fit stops at many places."""
    best = tied(found, found.at, KNOWN)
    if swings_at_all(found.model) and how_known(best.moves) > TOLD and best.rms < DESCRIBED:
        for at in at_near_frequencies(found):
            other = tied(found, at, (AT_FIRST, *KNOWN[:-1], *KNOWN[-2:]))
            if how_known(other.moves) <= TOLD:
                return other
    return best


def tied(found: Fitted, at: Point, steps: Sequence[float]) -> Fitted:
    """The fit continued from a point with its moves tied to those before them, ever closer by these steps: the closest
    that is about as near, or itself."""
    closer, best = replace(found, at=at), found
    for known in steps if swings_at_all(found.model) else ():
        moves, at = swinging_on(closer.moves, found.model, closer.at, min(known, how_known(found.moves)))
        closer = fit(moves, found.model, at, ROUNDS)
        best = closer if closer.rms < WORSE * found.rms else best
    return best


def ended(scene: Scene, trial: Trial[Explained]) -> Trial[Explained]:
    """The fit of a model that may be the right one, its effects as they are simulated for a value, continued while it
    gains; steadied where it may be the whole explanation."""
    lacks_something = trial.model.fitted.model == scene.declared and trial.train_rms > SOUND
    if trial.model.ended or lacks_something:
        return trial
    best = with_own_errors(in_full(trial.model.fitted))
    more = MORE if swings_at_all(best.model) else 1
    for _ in range(more if best.rms < HOPELESS else 0):
        further = settled(best, ROUNDS, LOOKED_FOR_NEXT)
        gained, best = best.rms - further.rms, min(best, further, key=lambda f: f.rms)
        if gained < GAIN * best.rms:
            break
    foretold = most_left(trial) <= ENDED
    best = steady(with_errors_of_added(scene, best), not foretold) if best.rms <= LEFT else best
    out = trial if best is trial.model.fitted else trial_of(scene, best)
    if best.rms <= LEFT and out.validation_rms > ENDED:
        further = led_across(best)
        out = out if further is best else trial_of(scene, further)
    return replace(out, model=replace(out.model, ended=True))


def with_own_errors(found: Fitted) -> Fitted:
    """The fit with the errors that are expected of its own model, once, where its effects make something else of the
    speeds' noise: else a filter that is undone, and sharpens it, is described by a delay and by masses that damp it."""
    known = all(part.judged is not None for part in found.moves)
    if known or not any(effect.own_errors for effect in found.model.effects):
        return found
    return fit(expecting_its_own(found), found.model, found.at, ROUNDS)


def with_errors_of_added(scene: Scene, found: Fitted) -> Fitted:
    """The fit of a model with an added effect, with the errors that are expected of it where it stands: those of the
    declared model, which lacks the effect, were expected on a machine that is damped otherwise, and weigh the samples
    for that one."""
    if len(found.model.effects) <= len(scene.declared.effects):
        return found
    return fit(expecting_its_own(found), found.model, found.at, ROUNDS)


def steady(found: Fitted, elsewhere: bool = True) -> Fitted:
    """The fit continued until it and the motion of the motors that is reconstructed from it agree: each takes the other
    along, and the numbers that no sample tells by itself, such as the parts of friction, arrive last. Every move may
    wander as the noise of its speed lets it; what leaves more than is expected then is led over further ridges, and to
    chains that hardly damp: one that damps what the machine's does not is a valley of its own. Not `elsewhere` where
    it describes all moves: no other valley describes more. Masses, springs and dampings that no chain
    has are left here once more. A hopeless fit stays what it is."""
    if found.rms >= HOPELESS:
        return found
    if cornered(found):
        found = min(found, begun_by_speeds(found), key=lambda f: f.rms)
    white = agreed(whitened(found, True))
    others = ((over_ridges, EXPECTED), (hardly_damped_chain, ENDED)) if elsewhere else ()
    for another, least in others:
        other = another(white) if white.rms > least else white
        white = agreed(other) if other.rms < RIDGE * white.rms else white
    still = whitened(white, False)
    damped = as_damped(still)
    return wider_where_unreached(
        still if damped is still else whitened(agreed(whitened(damped, True)), False)
    )


def whitened(found: Fitted, white: bool) -> Fitted:
    """The fit at the same point, its residuals whitened or not."""
    moves = [replace(m, white=white) for m in found.moves]
    return fit(moves, found.model, found.at, 0, free=found.free)


def agreed(found: Fitted) -> Fitted:
    """The fit and the motion of the motors that is reconstructed from it, in turns until they agree."""
    for turn in range(TURNS):
        on = fit(hearing_motors(found), found.model, found.at, ROUNDS, tolerance=FINE)
        change, found = abs(float(on.r @ on.r - found.r @ found.r)), on
        if turn and change < STEADY:
            break
    return found


def led_across(found: Fitted) -> Fitted:
    """The fit led on across samples by all that its moves and their motors say, on a few moves first, and agreed from
    there; itself where it comes no nearer. The samples alone may be described a little better by a chain that the
    motors speak against."""
    moves, own = hearing_motors(found), (own_of_few(found),)
    few = tuple(some_of(part, how_few(found)) for part in unanswering(moves)[:1])
    here = fit(few, found.model, Point(found.at.shared, own), BRIEF, tolerance=FINE)
    on = across_samples(few, here)
    if on.squares > here.squares - GAINED:
        return found
    begun = begun_at(moves, found.model, values_at(on), found.at.local)
    present, there = (fit(moves, found.model, at, ROUNDS, tolerance=FINE) for at in (found.at, begun))
    if there.squares > present.squares - GAINED:
        return found
    return wider_where_unreached(whitened(agreed(whitened(there, True)), False))


def in_full(found: Fitted) -> Fitted:
    """The fit with its effects as they are simulated for a value, and with gear and pinion apart if it is near."""
    effects = tuple(effect.refined for effect in found.model.effects)
    lumps = 2 if found.rms < HOPELESS else found.model.lumps
    model = replace(found.model, effects=effects, lumps=lumps)
    if model == found.model:
        return found
    values = values_at(found) if lumps == found.model.lumps else parted(values_at(found), model.axes)
    return fit(found.moves, model, Point(shared_at(model, values), found.at.local), ROUNDS)


def parted(values: Values, axes: Sequence[str]) -> Values:
    """The values with the one mass of every drive as gear and pinion, on two springs that are as soft together."""
    out = dict(values)
    for axis in axes:
        stiffness, mass, damping = (
            values[f"{axis}.drive_{n}"] for n in ("stiffness", "mass", "damping_ratio")
        )
        for link, share in (("gear", 1.0 - OF_PINION), ("pinion", OF_PINION)):
            out[f"{axis}.{link}_stiffness"], out[f"{axis}.{link}_mass"] = 2.0 * stiffness, share * mass
            out[f"{axis}.{link}_damping_ratio"] = damping
    return out
