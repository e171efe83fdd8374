"""What hides between motor and load, such as a second gap, searched with the motors' equations of motion as a witness
beside the accelerometer.

In the moves that are fitted one gap as wide as both imitates two in series, and in others a pinion that chatters
between them is foretold by no model whose numbers are not exact. But the motor feels what it meets, and when: where the
declared model leaves it far over the noise, two gaps take most of that away, in the moves that were fitted and in
those that were not. What swings with the load hides behind a chain that is not the machine's, too, and the motors tell
it from one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from service.backlash.moves_fit import Fitted, fit, values_at
from service.dynamics.driven_model import DrivenEffect
from service.identification.explanation import Candidate
from service.identification.held_out import DESCRIBED, Explained, trial_of
from service.identification.moves_carried import AGAINST, FIRST_ROUNDS, carried
from service.identification.moves_divided import jointly, led_through_rests, nearest_of, otherwise_divided
from service.identification.moves_end import HOPELESS, SOUND, settled
from service.identification.moves_finals import describes_all, judged
from service.identification.moves_looks import VALLEYS, noted
from service.identification.moves_lying import pinions_lie
from service.identification.moves_motors import CONTRADICTED, left_by_motors, nothing_left, of_moves
from service.identification.moves_ridges import at_all_frequencies, put_back
from service.identification.moves_starts import ROUNDS, candidates, unanswering
from service.identification.moves_starts import Candidate as DrivenCandidate
from service.identification.moves_valleys import (
    SEED,
    Begun,
    asked,
    begun_near,
    comes_nearer,
    left_at_present,
    nearest_with_motors,
    valleys,
    worth_following,
)
from service.identification.scene import Scene
from service.identification.selection import (
    CHANGED,
    EXPLAINED,
    LEFT,
    LEVEL,
    PART,
    UNKNOWN_NUMBERS,
    Selection,
    Trial,
    explained,
    gain_p_value,
    gone,
    gone_from_all,
    independent_samples,
)

LED = 2
"""How many of the valleys of a few moves are followed further on all moves (chosen)."""
BY_NUMBERS_ONLY = 1.8
"""What the motors' equations of motion may leave, over the noise, once the present model is fitted to them, too: it was
numbers by which they contradicted it, if these describe the samples, too (chosen: those with two gaps left 2.1 and
more, many others 1.4 to 1.7, before it was counted what a right model's force may be off by; since then one with two
left 1.5, and 1.5 of the samples)."""
SPOKEN = 3.0
"""What they leave then from which on something is hidden there though no fit found it (chosen: 34 machines that lack
nothing, or only what every sound one has a little of, left 2.2 and less, nine with two gaps 2.1 to 19, and two whose
motors felt nothing of them 1.0)."""
OF_FEW = 0.4
"""Share of what a few moves and their motors show from which on what takes it is fitted to all (chosen: two gaps
take about half of it or more where they are found at all, and up to two fifths on machines that have but one)."""
SEARCHES, AFAR = 3, 3.0
"""How often at most the valleys of a few moves are searched, and what the nearest may leave of these and their motors
if it is to be the right one (chosen: wrong ones left 3.5 and more on two machines with two gaps, right ones 2.6 and
less)."""
AGAIN = 3
"""How often at most what is not the finding is searched where it describes what was fitted (chosen)."""
HINT = 1.0 / 3.0
"""Share of what samples and motors show from which on something hides there, although no fit found it (chosen)."""
NO_GAP = 1e-6
"""Width below which a gap is none [m] (chosen: what a backlash is wanted to)."""


Near = dict[str, Begun]
"""What was begun near the present fit, by effect, until the search takes it over."""


def at_present(base: Fitted) -> Fitted:
    """The present model fitted to the samples and its motors' equations of motion."""
    return jointly(replace(base, moves=unanswering(base.moves)))


def hidden(
    scene: Scene,
    before: Trial[Explained],
    kinds: Sequence[type[DrivenEffect]],
    of_all: int,
    tell: Callable[[str], None],
    near: Near | None = None,
) -> Selection[Explained]:
    """What of these `kinds` hides between motor and load, if it takes `PART` of what samples and motors show away from
    the moves that were fitted, and of what the motors show from the others, beyond what chance does for the best
    `of_all` effects; the model before, where none does, and whether it is `hinted` at by less, or by motors that still
    contradict the model once it is fitted to them. Nothing is judged where the motors are not heard in the others, or
    contradict the model no longer then, and the samples are described. What describes samples and motors of the moves
    that were fitted, and yet is not the finding, is searched once more from elsewhere: something is there, and stands
    on a chain that foretells the others badly."""
    base, heard = before.model.fitted, as_heard_by_motors(before)
    tried = candidates(base.model, kinds, ()) if heard.validation_rms else []
    present = at_present(base) if tried else base
    by_motors = float(np.max(left_by_motors(present))) if tried else 0.0
    by_numbers = bool(tried) and by_motors <= BY_NUMBERS_ONLY and present.rms <= DESCRIBED
    found = list[tuple[Trial[Explained], Candidate, Gain]]()
    for seed in range(SEED, SEED + AGAIN * SEARCHES, SEARCHES):
        begun = [] if by_numbers else [one for c in tried for one in promising(scene, base, c, seed, near)]
        if not begun:
            break
        name, trial, gain = nearest_trial(scene, before, present, begun)
        tell(f"tried {name}: {gain.together[1]:.3f} with the motors (now {gain.together[0]:.3f})")
        said = judged_by_motors(name, gain, (before, trial), (heard, as_heard_by_motors(trial)), of_all)
        found.append((trial, said, gain))
        if said.accepted or gain.together[1] > DESCRIBED:
            break
    if not found:
        why = "needed by no motor once the model is fitted to them, too"
        why = why if by_numbers else "explains nothing of a few moves and their motors"
        none = tuple(Candidate(one.name, before.held_rms, 1.0, False, why) for one in tried)
        return Selection(before, before, (), none, (), hinted=by_motors > SPOKEN)
    trial, said, _ = found[-1]
    names = (said.effect,) if said.accepted else ()
    after = trial if said.accepted else before
    part = any(gain.is_of(HINT) for _, _, gain in found) and heard.validation_rms > CONTRADICTED
    hinted = not names and (part or by_motors > SPOKEN)
    return Selection(before, after, names, (said,), (), witnessed=names, hinted=hinted)


def nearest_trial(
    scene: Scene, before: Trial[Explained], present: Fitted, begun: Sequence[Fitted]
) -> tuple[str, Trial[Explained], Gain]:
    """The name and the trial of the nearest to all moves and their motors of what was fitted to a few, its play
    otherwise divided if it does not describe all, and what it takes of what is left at `present`."""
    nearest = on_all_moves(before.model.fitted, begun, present)
    name, gain = nearest.model.effects[-1].name, Gain.of(present, nearest)
    trial = trial_of(scene, nearest, thorough=gain.is_of(PART))
    if nothing_left(nearest) and describes_all(before, trial):
        return name, trial, gain
    near = nearest.rms <= (HOPELESS if gain.is_of(PART) else SOUND)
    divided = otherwise_divided(nearest) if near and not closed(nearest) else nearest
    gain = Gain.of(present, divided)
    if divided is not nearest:
        trial = trial_of(scene, divided, thorough=gain.is_of(PART))
    return name, trial, gain


def leads(scene: Scene, before: Trial[Explained], kinds: Sequence[type[DrivenEffect]], near: Near) -> bool:
    """Whether one of these `kinds`, begun near by, comes nearer to a few moves and their motors than the model before:
    then it is likely there, and else another effect may well be that takes less time to find. What was begun is kept
    in `near` for the search."""
    begin_near(scene, before, kinds, near)
    return any(comes_nearer(before.model.fitted, begun) for begun in near.values())


def may_lead(scene: Scene, before: Trial[Explained], kinds: Sequence[type[DrivenEffect]], near: Near) -> bool:
    """Whether one of these `kinds`, begun near by, takes enough of what shows to be followed; what was begun is kept in
    `near` for the search."""
    begin_near(scene, before, kinds, near)
    base = before.model.fitted
    return any(
        worth_following(left_at_present(begun.few, base), nearest_with_motors(begun))
        for begun in near.values()
    )


def begin_near(
    scene: Scene, before: Trial[Explained], kinds: Sequence[type[DrivenEffect]], near: Near
) -> None:
    """Begins what is not begun yet."""
    base = before.model.fitted
    for one in candidates(base.model, kinds, ()):
        near[one.name] = near.get(one.name) or begun_near(scene, base, one)


def promising(
    scene: Scene, base: Fitted, candidate: DrivenCandidate, first: int = SEED, near: Near | None = None
) -> list[Fitted]:
    """The fits of a few moves in the candidate's best valleys, of those that are not hopeless and take `OF_FEW` of what
    the present model leaves of these moves and their motors. Where a search begins is chance: they are searched again
    if the nearest is `AFAR`, or if none is promising where the samples are described and only the motors are not, as
    it is a gap that they speak of as a rule. The first search takes over what was begun `near` by."""
    present = left_at_present(asked(base), base)
    out = list[Fitted]()
    for seed in range(first, first + SEARCHES):
        begun = near.pop(candidate.name, None) if near and seed == SEED else None
        found = valleys(scene, base, candidate, seed, begun)
        sound = [one for one in found if one.rms_with_motors < HOPELESS]
        out += [one for one in sound if gone(present, one.rms_with_motors, OF_FEW)]
        followed = bool(found) and worth_following(present, found[0].rms_with_motors)
        afar = min((one.rms_with_motors for one in out), default=np.inf) > AFAR
        if not (afar if out else followed and base.rms <= LEFT):
            break
    return nearest_of(out, VALLEYS)


def on_all_moves(base: Fitted, begun: Sequence[Fitted], present: Fitted) -> Fitted:
    """The nearest to all moves and their motors of what was fitted to a few: at once, for the samples alone may lead
    out of a valley that both have found, and where that takes a `HINT` of what is left at `present`, of the nearest
    `LED` that are about as near through their rests, or where no pinion lies, after some rounds to the samples, too,
    until one describes all."""

    def carried_on(one: Fitted, rounds: int) -> Fitted:
        return jointly(carried(base, noted(one, base.moves), rounds))

    at_once = sorted(((carried_on(one, 0), one) for one in begun), key=lambda pair: pair[0].rms_with_motors)
    nearest = at_once[0][0]
    if not Gain.of(present, nearest).is_of(HINT):
        return nearest
    out = list[Fitted]()
    for now, one in at_once[:LED]:
        if now.rms_with_motors > AGAINST * nearest.rms_with_motors:
            break
        for rounds in (0,) if pinions_lie(now.model) else (0, FIRST_ROUNDS):
            out.append(led_through_rests(carried_on(one, rounds) if rounds else now))
            if nothing_left(out[-1]):
                return out[-1]
    return min(out, key=lambda f: f.rms_with_motors)


def swinging(
    scene: Scene, before: Trial[Explained], kinds: Sequence[type[DrivenEffect]], tell: Callable[[str], None]
) -> dict[str, Trial[Explained]]:
    """What of these `kinds` swings, begun at all frequencies and compared by samples and motors together: a mass that
    swings with its machine shows in the fitted moves hardly otherwise than a chain that is not the machine's, but what
    holds it back the motors feel. Of those that take `PART` of what a few moves and their motors show, and leave no
    more of these and then of all than what may describe them, by name."""
    base, out = before.model.fitted, dict[str, Trial[Explained]]()
    few = asked(base)
    present = left_at_present(few, base)
    for candidate in candidates(base.model, kinds, ()):
        fits = at_all_frequencies(few, candidate.model, (put_back(base), scene.smooth))
        best = min(fits, key=lambda f: f.rms_with_motors)
        best = fit(few, best.model, best.at, ROUNDS)
        tell(f"tried {candidate.name} at all frequencies: {best.rms_with_motors:.3f} (now {present:.3f})")
        if best.rms_with_motors < SOUND and gone(present, best.rms_with_motors, PART):
            of_all = on_all_moves(base, (best,), at_present(base))
            if of_all.rms < SOUND:
                out[candidate.name] = judged(scene, before, settled(of_all, ROUNDS))
    return out


class Gain(NamedTuple):
    """What a model with something hidden takes from the moves that were fitted: RMS before and after of samples and
    motors together, and of the motors alone."""

    together: tuple[float, float]
    of_motors: tuple[float, float]

    @classmethod
    def of(cls, present: Fitted, nearest: Fitted) -> Gain:
        together = (present.rms_with_motors, nearest.rms_with_motors)
        before, after = (float(np.sqrt(np.mean(f.motors**2))) for f in (present, nearest))
        return cls(together, (before, after))

    def is_of(self, share: float) -> bool:
        """Whether such a share of the excess variance is gone from both; motors that did not contradict the model
        before do not contradict this one."""
        first, left = self.of_motors
        heard = gone(first, left, share) if first > CONTRADICTED else left <= CONTRADICTED
        return heard and gone(*self.together, share)


def judged_by_motors(
    name: str,
    gain: Gain,
    trials: tuple[Trial[Explained], Trial[Explained]],
    heard: tuple[Trial[Explained], Trial[Explained]],
    of_all: int,
) -> Candidate:
    """The judgement on an effect by the trials of the model without it and with it, and as the motors hear them: over
    what is left of these with it, where that is less than the noise of their equations was put at. Where the motors
    contradict the model without it in no moves, the samples speak of it if nearly all is gone that they show."""
    (before, after), (of_before, of_after) = trials, heard
    contradicted = of_before.validation_rms > CONTRADICTED * min(1.0, of_after.validation_rms)
    content = gain.of_motors[0] <= CONTRADICTED and not contradicted
    p_value = min(1.0, of_all * gain_p_value(*(trials if content else heard)))
    spoken = content or (contradicted and gone(*gain.of_motors, PART))
    witness = "samples" if content else "motors"
    if not (spoken and gain.is_of(PART)):
        why = "leaves the motors' equations of motion as they are"
    elif content and not gone_from_all(before, after, EXPLAINED):
        why = "what the motors do not speak of, and it leaves a part of what the samples show"
    elif not (content or explained(of_before, of_after, PART) or told_by_samples(gain, before, after)):
        why = "takes from the motors' equations of motion in the moves that were fitted only"
    elif after.train_rms > LEFT:
        why = f"what the {witness} speak of, but it leaves too much of the moves that were fitted"
    elif after.validation_rms > max(UNKNOWN_NUMBERS, before.validation_rms):
        why = f"what the {witness} speak of, but it raises the held-out error"
    elif after.validation_rms > CHANGED and not explained(before, after, PART):
        why = f"what the {witness} speak of, but it leaves the other moves as they are"
    elif p_value >= LEVEL:
        why = "gain within what chance does"
    elif nothing := (*after.at_limits, *closed(after.model.fitted)):
        why = f"only with {', '.join(nothing)} where no such effect is"
    else:
        why = f"what the {witness} speak of, in the held-out moves, too"
        return Candidate(name, after.held_rms, p_value, True, why)
    return Candidate(name, after.held_rms, p_value, False, why)


def told_by_samples(gain: Gain, before: Trial[Explained], after: Trial[Explained]) -> bool:
    """Whether samples and motors of the moves that were fitted are described together, and half of what the samples of
    the others show is explained: where a pinion chatters between two gaps, its motor feels each meeting of the flanks,
    and a model foretells those only with numbers that are exact."""
    return gain.together[1] < DESCRIBED and explained(before, after, PART)


def closed(found: Fitted) -> tuple[str, ...]:
    """The gaps, by name, that are as good as closed: of what divides all play from none only one gap is left, and what
    is moved behind it is no load, but for example a sensor that rings on its mount."""
    values = values_at(found)
    first, second = ([f"{axis}.{gap}" for axis in found.model.axes] for gap in ("backlash", "clearance"))
    none = [name for name in first if values[name] < NO_GAP]
    return (*none, *(second if all(values[name] < NO_GAP for name in second) else ()))


def as_heard_by_motors(trial: Trial[Explained]) -> Trial[Explained]:
    """The trial with what is left of the motors' equations of motion in the held-out moves as its errors there, every
    move in its own block; an error of 0 where no torque was recorded in them."""
    held = trial.model.held
    left = of_moves(replace(trial.model.fitted, moves=(held.simulated,), at=held.at))
    if not left:
        return replace(trial, validation_rms=0.0, validation_blocks=np.zeros(0), independent=0.0, doubt=1.0)
    moves = [np.concatenate(of_move) for of_move in left]
    errors = np.concatenate(moves)
    return replace(
        trial,
        validation_rms=float(np.sqrt(np.mean(errors**2))),
        validation_blocks=np.array([float(np.sum(move**2)) for move in moves]),
        independent=independent_samples(errors),
        doubt=1.0,
    )
