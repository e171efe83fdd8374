"""The fits that come nearest: finished with the motor's motion reconstructed from them, compared, and ended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import permutations

import numpy as np

from service.backlash.moves_fit import Fitted, values_at
from service.dynamics.effects.driven_library import DRIVEN
from service.identification.held_out import DESCRIBED, Explained, trial_of
from service.identification.moves_carried import SECOND, as_other
from service.identification.moves_end import (
    AS_WELL,
    HOPELESS,
    HOWEVER_FAR,
    OF_ADDED,
    SOUND,
    ended,
    in_full,
    led_on,
    settled,
    with_own_errors,
)
from service.identification.moves_looks import ENDED, FAR_OFF
from service.identification.moves_motors import plainly_against
from service.identification.moves_rests import swings_at_all
from service.identification.moves_starts import ROUNDS, fitted_from
from service.identification.scene import Scene
from service.identification.selection import (
    LEFT,
    LEFT_BY_CLEAN,
    PART,
    UNKNOWN_NUMBERS,
    WHOLLY,
    Trial,
    distance,
    explained,
    gone,
    gone_from_all,
    most_left,
    shown,
)

FINALISTS = 2
"""Effects whose fit is finished with the motor's motion reconstructed from it, the nearest to all moves."""
OF_DESCRIBED = 4
"""How many of those that describe the moves that were fitted are finished however they foretell the others (chosen)."""
LEADERS = 3
"""How many of those that are nearest to the moves that were fitted are tried on each other's machines (chosen)."""
TAKEN = 1.0 / 4.0
"""Share of what shows in moves from which on an effect takes a part of it (chosen: before they were finished right ones
took seven tenths and more, of ten machines of which not much showed)."""
BEHIND = 1.5
"""How much farther from the moves than the best a fit may be and still be finished (chosen)."""


def finished(
    scene: Scene, present: Trial[Explained], trials: Mapping[str, Trial[Explained]]
) -> dict[str, Trial[Explained]]:
    """The trials, those of the finalists finished: first what describes the moves that it was fitted to with numbers
    that such an effect has, and all others, too, unless it ends where it describes the other moves. None, where not
    much shows in these moves, and none takes a part of that or of what shows in the others."""
    if present.train_rms < HOPELESS and not any(takes(present, trial) for trial in trials.values()):
        return dict(trials)
    last = finalists(present, trials)
    likely = [n for n in last if trials[n].train_rms <= LEFT_BY_CLEAN and not trials[n].at_limits]
    if likely and any(trials[name].at_limits for name in last):
        trials = finished_of(scene, present, trials, likely)
        if any(described(trials[name]) for name in likely):
            return dict(trials)
    return finished_of(scene, present, trials, last)


def takes(present: Trial[Explained], trial: Trial[Explained]) -> bool:
    """Whether an effect takes a part of what shows in the moves that were fitted, or in the others."""
    return gone(present.train_rms, trial.train_rms, TAKEN) or explained(present, trial, TAKEN)


def finished_of(
    scene: Scene, present: Trial[Explained], trials: Mapping[str, Trial[Explained]], last: Sequence[str]
) -> dict[str, Trial[Explained]]:
    """The trials, the `last` settled, tried on each other's machines, and ended if they may be named. The nearest is
    led on over further ridges before any is ended, unless it is near and the motors speak against it; what one of them
    contains is begun where it stands, and ended before it; what is far behind one that is ended and takes nearly all of
    what is missing is not. What comes closest to the moves that it was fitted to is ended, too, if it is plainly closer
    to them, or describes them, even if it describes the others not much worse: it may be the right one, on a chain that
    foretells the others badly."""
    done = settled_finalists(scene, present, trials, last)
    better = on_better_machines(scene, present, done)
    out = {**trials, **{name: t if t.model.ended else better[name] for name, t in done.items()}}
    name = min(done, key=lambda name: out[name].train_rms)
    if out[name].train_rms >= HOPELESS or not plainly_against(present, out[name]):
        out[name] = led_further(scene, present, out[name])
    sound = [name for name in done if not out[name].at_limits]
    near = leading({name: distance(out[name]) for name in sound}, FINALISTS)
    first = min(done, key=lambda name: distance(out[name]))
    closest = min(sound, key=lambda name: out[name].train_rms, default=first)
    contained = [(name, inner) for name in {first, *near} for inner in DRIVEN[name].contains if inner in out]
    for name, inner in contained:
        out[inner] = begun_there(scene, present, out[inner], out[name])
    near += [inner for _, inner in contained]
    if all(out[closest].train_rms < SECOND * out[name].train_rms for name in {first, *near} - {closest}):
        near.append(closest)
    for name in sorted({first, *near}, key=lambda name: len(out[name].model.fitted.model.parameters)):
        rivals = {n: trial for n, trial in out.items() if trial.model.ended and describes_all(present, trial)}
        if not (inner_suffices(name, out) or outdone(name, out[name], rivals)):
            out[name] = ended_if_named(scene, present, out[name])
    if inner_suffices(closest, out):
        return out
    return out | {closest: to_the_end(scene, out[closest], DESCRIBED, AS_WELL)}


def settled_finalists(
    scene: Scene, present: Trial[Explained], trials: Mapping[str, Trial[Explained]], last: Sequence[str]
) -> dict[str, Trial[Explained]]:
    """The trials of the `last` with the motor's motion reconstructed from their fits, without those that are left as
    they are: all but the nearest, where none is anywhere near; what swings, which comes last, if it is far behind; and
    what does not describe the moves that it was fitted to and is far behind one that describes all, unless that one
    contains it: until its own motion is reconstructed it is no nearer from there, either. What is ended stays so. What
    takes a part of what the present model leaves is led over ridges even where it is hopeless: the right effect may
    stand there on a wrong chain."""
    done = dict[str, Trial[Explained]]()
    if min(trials[name].train_rms for name in last) > FAR_OFF * HOPELESS:
        last = last[:1]
    for name in sorted(last, key=lambda name: swings_at_all(trials[name].model.fitted.model)):
        trial, nearest = trials[name], min((other.train_rms for other in done.values()), default=np.inf)
        rivals = {rival: other for rival, other in done.items() if described(other)}
        behind = nearest <= ENDED and trial.train_rms >= BEHIND * nearest
        behind = behind or (trial.train_rms > DESCRIBED and outdone(name, trial, rivals))
        if trial.model.ended:
            done[name] = trial
        elif not behind or any(name in DRIVEN[other].contains for other in done):
            part = gone(present.train_rms, trial.train_rms, PART)
            found, ridges = with_own_errors(trial.model.fitted), HOWEVER_FAR if part else OF_ADDED
            done[name] = judged(scene, present, settled(found, ROUNDS, ridges))
    return done


def begun_there(
    scene: Scene, present: Trial[Explained], inner: Trial[Explained], outer: Trial[Explained]
) -> Trial[Explained]:
    """The trial of what another effect contains, or a nearer one that is begun where that one ended: else it is not
    judged by what it explains, but by the valley in which it was left."""
    found = inner.model.fitted
    again = as_other(found, outer.model.fitted)
    if again is found:
        return inner
    return min(inner, judged(scene, present, settled(again, ROUNDS, HOWEVER_FAR)), key=distance)


def on_better_machines(
    scene: Scene, present: Trial[Explained], trials: Mapping[str, Trial[Explained]]
) -> dict[str, Trial[Explained]]:
    """The trials, or nearer ones with the same effect, begun on the machine of another that foretells the held-out
    moves better and is about as near to those that were fitted: two effects may do much the same in these, on two
    machines, and only one of the machines is right."""
    out = dict(trials)
    for name, other in permutations(leading({n: t.train_rms for n, t in trials.items()}, LEADERS), 2):
        there = trials[other]
        if there.validation_rms < SECOND * out[name].validation_rms:
            found, machine = out[name].model.fitted, values_at(there.model.fitted)
            values = values_at(found)
            again = fitted_from(found, values | {k: v for k, v in machine.items() if k in values}, ROUNDS)
            out[name] = min(out[name], judged(scene, present, again), key=distance)
    return out


def ended_if_named(scene: Scene, present: Trial[Explained], trial: Trial[Explained]) -> Trial[Explained]:
    """The trial with its fit ended where it may be named, as it is or with its effects as they are simulated for a
    value."""
    if may_be_named(present, trial):
        return to_the_end(scene, trial)
    full = as_for_a_value(scene, trial)
    return to_the_end(scene, full) if full is not trial and may_be_named(present, full) else full


def as_for_a_value(scene: Scene, trial: Trial[Explained]) -> Trial[Explained]:
    """The trial of a fit that is not far off with its effects as they are simulated for a value, if that is nearer: a
    law in coarser pieces may have driven the chain to where the motors speak against it."""
    found = trial.model.fitted
    full = in_full(found) if trial.train_rms <= LEFT else found
    nearer = full is not found and full.rms < SECOND * trial.train_rms
    return trial_of(scene, full) if nearer else trial


def judged(scene: Scene, present: Trial[Explained], found: Fitted) -> Trial[Explained]:
    """The trial of a fit, with the motors' motion in the held-out moves followed only where it may be named."""
    brief = trial_of(scene, found, thorough=False)
    return trial_of(scene, found) if may_be_named(present, brief) else brief


def led_further(scene: Scene, present: Trial[Explained], trial: Trial[Explained]) -> Trial[Explained]:
    """The trial, or one of its fit led on; also of a hopeless one, if a part of what the present model leaves is gone:
    the right effect may stand there on a wrong chain."""
    part = gone(present.train_rms, trial.train_rms, PART)
    further = led_on(trial.model.fitted, np.inf if part else HOPELESS, (scene.smooth,))
    return trial if further is trial.model.fitted else trial_of(scene, further)


def inner_suffices(name: str, trials: Mapping[str, Trial[Explained]]) -> bool:
    """Whether an effect contains one whose fit is ended and leaves next to nothing: what it has beside that explains
    nothing more."""
    inner = (trials[other] for other in DRIVEN[name].contains if other in trials)
    return any(trial.model.ended and shown(trial) <= LEFT_BY_CLEAN for trial in inner)


def outdone(name: str, trial: Trial[Explained], rivals: Mapping[str, Trial[Explained]]) -> bool:
    """Whether an effect is far behind one of these rivals whose law is not nearly its own."""
    far = distance(trial)
    return any(
        far > BEHIND * distance(other) and name not in DRIVEN[rival].nearly for rival, other in rivals.items()
    )


def to_the_end(
    scene: Scene, trial: Trial[Explained], near: float = SOUND, as_well: float = UNKNOWN_NUMBERS
) -> Trial[Explained]:
    """The trial with its fit ended where it is `near` the moves that it was fitted to, but does not describe the others
    `as_well`: the noise of the speed, taken for the motor's motion, may have driven its numbers away."""
    return ended(scene, trial) if trial.train_rms < near and describes_its_own_only(trial, as_well) else trial


def describes_its_own_only(trial: Trial[Explained], as_well: float = UNKNOWN_NUMBERS) -> bool:
    """Whether the moves that were fitted are described better than the others, by more than `as_well`."""
    return trial.validation_rms > as_well * max(1.0, trial.train_rms)


def leading(found: Mapping[str, float], count: int, behind: float = BEHIND) -> list[str]:
    """The names of the nearest, none that is so far `behind` the nearest."""
    least = min(found.values(), default=np.inf)
    return [
        name for name in sorted(found, key=lambda name: found[name])[:count] if found[name] <= behind * least
    ]


def finalists(present: Trial[Explained], trials: Mapping[str, Trial[Explained]]) -> list[str]:
    """The nearest to all moves, and the nearest to those that were fitted, and what describes those where the present
    model leaves much: where a fit has not ended, each may mislead."""
    by_train = {name: trial.train_rms for name, trial in trials.items()}
    own = [name for name in leading(by_train, OF_DESCRIBED) if by_train[name] <= ENDED]
    nearest = leading({n: distance(t) for n, t in trials.items()}, FINALISTS)
    return list(dict.fromkeys([*nearest, *leading(by_train, 1), *(own if present.train_rms > SOUND else ())]))


def may_be_named(present: Trial[Explained], trial: Trial[Explained]) -> bool:
    """Whether a fit may be that of a name once it is ended: next to nothing is left of the moves that it was fitted to,
    or not much, or half of what the present one leaves is gone, and the motors do not speak against it."""
    if trial.train_rms <= LEFT_BY_CLEAN:
        return True
    near = trial.train_rms <= LEFT or gone(present.train_rms, trial.train_rms, PART)
    return near and not plainly_against(present, trial)


def describes_all(present: Trial[Explained], trial: Trial[Explained]) -> bool:
    """Whether a model describes the moves that were fitted and the others, or next to all that the present one leaves
    of both, with numbers that there are."""
    return described(trial) or (gone_from_all(present, trial, WHOLLY) and not trial.at_limits)


def described(trial: Trial[Explained]) -> bool:
    """Whether a model leaves next to nothing of all moves, with numbers that there are."""
    return most_left(trial) <= DESCRIBED and not trial.at_limits
