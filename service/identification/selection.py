"""Forward selection of effects, judged on moves that were not fitted, corrected for the search.

The same rule serves every channel: a ``Trial`` is one fitted model with its held-out errors block by block.
A candidate is taken when it lowers the held-out error of the validate recording by a material share, and when
the gain over all held-out blocks is significant after multiplication by the number of candidates tried.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from scipy.stats import t as student_t
from scipy.stats import wilcoxon

from service.identification.explanation import Candidate
from service.recording import FloatArray

LEVEL = 0.01
"""False-finding rate per recording, after correction for the search. Chosen below the 2 % that is aimed at."""
FAR_NEARER = 0.5
"""Share of a distance that is not a law which differs a little from the machine's any more (chosen)."""
MATERIAL = 0.02
"""Share of the held-out RMS that an effect must remove to be worth naming (chosen)."""
NEAR = 0.1
"""How much nearer an effect with more parameters must come than one with fewer, which it may contain (chosen)."""
UNKNOWN_NUMBERS = 1.3
"""How much of a held-out error may come from numbers that the train moves do not tell well, a friction at another speed
before all (chosen)."""
EXPLAINED = 0.9
"""Share of the excess variance, all but an order of magnitude, that one effect explains by itself; several that still
leave something are how a library imitates what it does not have (chosen)."""
WHOLLY = 0.98
"""Share from which on an effect is named whatever it leaves: it has predicted moves that nobody has fitted, and what is
left is how its law differs from the machine's (chosen)."""
PART = 0.5
"""Share of the excess variance that has to be explained for a name: less is a part of something else (chosen)."""
LEFT = 1.6
"""RMS over the noise up to which the effects of a model count as the whole explanation (chosen)."""
LEFT_BY_CLEAN = 1.25
"""RMS over what is expected up to which what is left may be next to nothing (chosen)."""
LEFT_BY_INNER = 1.1
"""Held-out RMS from which on what a model leaves of moves that it describes may be what one that contains it explains
(chosen: a constant force leaves up to this beside nothing else)."""
CHANGED = 4.0
"""Held-out RMS from which on the machine is not what it was in the train recordings, however well it fits these: what
impurities too small to matter leave there is less, and so does what has its right name (chosen)."""
MAX_EFFECTS = 4

ModelT = TypeVar("ModelT")


@dataclass(frozen=True)
class Trial(Generic[ModelT]):
    """A fitted model with its errors: sums of squares (blocks,) on validate and on left-out parts of train.

    ``independent`` is the number of independent samples in the validate residual. ``validation_rms`` is over the errors
    that are expected; ``doubt`` is the geometric mean of what the model's own doubts add to them, by which models are
    compared: an error that a model announces counts less, and the announcement counts against it. ``at_limits`` names
    the numbers of its last effect that stand where no such effect is.
    """

    model: ModelT
    train_rms: float
    validation_rms: float
    validation_blocks: FloatArray
    inner_blocks: FloatArray
    independent: float
    doubt: float = 1.0
    at_limits: tuple[str, ...] = ()

    @property
    def held_rms(self) -> float:
        """The held-out error by which models are compared: its logarithm is the predictive likelihood's, with the
        scale of all errors free."""
        return self.validation_rms * self.doubt

    @property
    def held_out(self) -> FloatArray:
        return np.concatenate([self.validation_blocks, self.inner_blocks])


@dataclass(frozen=True)
class Selection(Generic[ModelT]):
    """Outcome: the first and the last trial, effects in order of taking, all candidates, and rivals; `tried` are the
    trials of all candidates for the first effect, `witnessed` the effects of which another channel speaks; it may have
    `hinted` at more than any effect explains."""

    before: Trial[ModelT]
    after: Trial[ModelT]
    effects: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    rivals: tuple[tuple[str, str], ...]
    tried: tuple[Trial[ModelT], ...] = ()
    witnessed: tuple[str, ...] = ()
    hinted: bool = False


def left(trial: Trial[ModelT]) -> float:
    """What a model leaves unexplained: an effect that it lacks shows in the moves that were fitted and in those that
    were not. In these alone it may be numbers that are not known well enough, in the others a fit that did not end."""
    return min(trial.train_rms, trial.validation_rms)


def most_left(trial: Trial[ModelT]) -> float:
    """What a model leaves of the moves that were fitted or of those that were not, whichever is more."""
    return max(trial.train_rms, trial.validation_rms)


def shown(trial: Trial[ModelT]) -> float:
    """What shows that something is missing: an error in the moves that were fitted, or one in those that were not,
    larger than what numbers can do that are not known well enough."""
    return max(trial.train_rms, trial.validation_rms / UNKNOWN_NUMBERS)


def gone(before: float, after: float, share: float) -> bool:
    """Whether so large a share of the variance beyond what is expected is gone, by two RMS over what is expected."""
    return after**2 - 1.0 <= (1.0 - share) * (before**2 - 1.0)


def explained(before: Trial[ModelT], after: Trial[ModelT], share: float = EXPLAINED) -> bool:
    """Whether so large a share of what is missing in the held-out moves is gone; by default nearly all."""
    return gone(before.validation_rms, after.validation_rms, share)


def gone_from_all(before: Trial[ModelT], after: Trial[ModelT], share: float) -> bool:
    """Whether so large a share is gone from the moves that were fitted and from the held-out ones."""
    return explained(before, after, share) and gone(before.train_rms, after.train_rms, share)


def leads_on(first: Trial[ModelT], present: Trial[ModelT], taken: int, most: int) -> bool:
    """Whether what was taken may be the first of `most` effects that explain everything, the strongest first: of as
    many equal ones each explains as much of the excess variance, in the held-out moves and in those that were fitted,
    unless not much is left of these."""
    share = taken / most
    in_train = present.train_rms <= LEFT or gone(first.train_rms, present.train_rms, share)
    return in_train and explained(first, present, share)


def distance(trial: Trial[ModelT]) -> float:
    """How far a model is from all moves, by the likelihood: the logarithms of the errors add up."""
    return trial.train_rms * trial.held_rms


def imitated(present: Trial[ModelT], trials: Mapping[str, Trial[ModelT]], nearest: Trial[ModelT]) -> bool:
    """Whether what comes far nearer to all moves than the `nearest` of what passed, or explains nearly all where that
    does not, is no such effect, by the limits that its numbers are at: something that no library has acts, and what
    passed is a part of its likeness."""
    beyond = [t for t in trials.values() if t.at_limits and distance(t) < distance(nearest)]
    everything = any(explained(present, t) for t in beyond) and not explained(present, nearest)
    return everything or any(distance(t) < FAR_NEARER * distance(nearest) for t in beyond)


def sole_fit(present: Trial[ModelT], trials: Mapping[str, Trial[ModelT]], least: float) -> str | None:
    """The one effect that explains nearly all that shows in the moves that were fitted, more than `least`, and leaves
    next to nothing there, where others were tried and none explains a part of it: numbers that these moves do not tell
    may spoil what it says of others, but there is no doubt which it is."""
    if present.train_rms <= least or len(trials) < 2:
        return None
    part = [n for n, t in trials.items() if gone(present.train_rms, t.train_rms, PART)]
    if len(part) != 1:
        return None
    only = trials[part[0]]
    whole = gone(present.train_rms, only.train_rms, EXPLAINED) and only.train_rms <= LEFT_BY_CLEAN
    return part[0] if whole else None


def gain_p_value(before: Trial[ModelT], after: Trial[ModelT]) -> float:
    """Probability of such a gain by chance over the held-out blocks, one-sided.

    The best of three: a paired t-test, which sees a large gain in few blocks; a signed-rank test (Wilcoxon
    1945), which sees a small one in all; and the likelihood ratio of the frozen predictions, whose inverse
    bounds the probability (Markov's inequality) for as many samples as are independent. Tripled for that.
    """
    gain = before.held_out - after.held_out
    if not np.isfinite(gain).all() or np.allclose(gain, 0.0, atol=1e-12 * float(before.held_out.sum())):
        return 1.0
    by_rank = float(wilcoxon(gain, alternative="greater").pvalue)
    error = max(float(np.std(gain, ddof=1)), 1e-9 * float(np.abs(gain).mean())) / np.sqrt(len(gain))
    by_mean = float(student_t.sf(float(gain.mean()) / error, len(gain) - 1))
    samples = min(before.independent, after.independent)
    evidence = samples * np.log(before.held_rms / max(after.held_rms, 1e-300))
    return min(1.0, 3.0 * min(by_rank, by_mean, float(np.exp(-max(0.0, evidence)))))


def independent_samples(errors: FloatArray) -> float:
    """How many samples of a residual (n,) count, by its lag-one correlation (AR(1))."""
    rho = float(np.clip(np.corrcoef(errors[:-1], errors[1:])[0, 1], 0.0, 0.999))
    return len(errors) * (1.0 - rho) / (1.0 + rho)


@dataclass(frozen=True)
class Limits:
    """When an effect is taken, and when the search ends.

    Attributes
    ----------
    material : share of the held-out RMS that an effect must remove
    enough : RMS of ``shown`` (after a first effect: of ``left``) at which nothing is left to explain
    further : the same two for every effect after the first, where what is left may be the fit's own imperfection; with
        it the search ends with an effect that is ``explained`` by itself and leaves no more than ``last``, and where no
        ``most`` effects can explain everything
    sole : RMS in the moves that were fitted from which on the ``sole_fit`` need remove no material share
    """

    material: float = MATERIAL
    enough: float = 0.0
    further: tuple[float, float] | None = None
    last: float = np.inf
    most: int = MAX_EFFECTS
    sole: float = np.inf

    def of_next(self, taken: Sequence[str]) -> tuple[float, float]:
        """``material`` and ``enough`` for the effect after those that were taken."""
        return self.further if taken and self.further else (self.material, self.enough)

    @property
    def of_containing(self) -> float:
        """Share by which an effect must come nearer than one that it contains: as much as a further one."""
        return self.further[0] if self.further else self.material

    def reached(self, first: Trial[ModelT], present: Trial[ModelT], taken: int) -> bool:
        """Whether the search ends with what was taken."""
        if not self.further:
            return False
        alone = explained(first, present) and left(present) <= self.last
        return alone or not leads_on(first, present, taken, self.most)


ORDINARY = Limits()


def select(
    before: Trial[ModelT],
    propose: Callable[[Trial[ModelT], tuple[str, ...]], Mapping[str, Trial[ModelT]]],
    refine: Callable[[Trial[ModelT]], Trial[ModelT]] = lambda trial: trial,
    tell: Callable[[str], None] = lambda _message: None,
    challenge: Callable[[Trial[ModelT], Trial[ModelT]], Trial[ModelT]] = lambda present, _best: present,
    limits: Limits = ORDINARY,
    size: Callable[[Trial[ModelT]], int] = lambda _trial: 0,
    contains: Callable[[str], Sequence[str]] = lambda _name: (),
    nearly: Callable[[str], Sequence[str]] = lambda _name: (),
    without: Callable[[Trial[ModelT], str], Trial[ModelT]] | None = None,
) -> Selection[ModelT]:
    """Add effects one after the other until none is significant and material. It also ends where the truth is only
    ``imitated``.

    ``propose(trial, taken)`` returns the fitted trial of every candidate added to the present model, or none where
    it is known that none will do; ``refine`` refits the one that was taken together with those before it;
    ``challenge(present, best)`` gives the present model another chance from where the best candidate ended, so that
    no effect is named for having led the fit out of a poor valley. ``size`` is a model's number of parameters: of
    effects that come equally near the one with the fewest is taken. ``contains`` names the effects that one becomes
    when some of its numbers are zero: it is passed over for them unless it removes as much more as a further effect
    must, or nearly all that they leave, and it is no rival of theirs; taken after them, it is named in their place.
    ``nearly`` names the effects whose law is the same but for what little of a recording tells: they are rivals as
    long as one comes nearly as near. ``without(trial, name)`` refits a model without one of its effects: what led
    the search to another may have been a part of that one's likeness.
    """
    present: Trial[ModelT] = before
    taken: tuple[str, ...] = ()
    first = before
    log: list[Candidate] = []
    rivals: list[tuple[str, str]] = []
    tried: tuple[Trial[ModelT], ...] = ()
    for _ in range(limits.most):
        missing = left if taken else shown
        material, enough = limits.of_next(taken)
        if missing(present) <= enough:
            break
        trials = propose(present, taken)
        if not trials:
            break
        present = challenge(present, min(trials.values(), key=distance))
        first, tried = (first, tried) if taken else (present, tuple(trials.values()))
        if missing(present) <= enough:
            break
        judged = _judged(present, trials, material, limits.sole)
        accepted = [name for name, candidate in judged.items() if candidate.accepted]
        passed = _without_containing(accepted, trials, contains, limits.of_containing)
        log = [candidate for candidate in log if candidate.effect not in judged]
        nearest = min((trials[name] for name in passed), key=distance, default=None)
        if nearest is None or imitated(present, trials, nearest):
            log += judged.values()
            break
        best = _smallest_near({name: trials[name] for name in passed}, size)
        log += [_only(best, candidate) for candidate in judged.values()]
        rivals += [(best, name) for name in passed if _rival(best, name, trials, nearly)]
        refined = refine(trials[best])
        worse = distance(refined) > (1.0 + NEAR) * distance(trials[best])
        present, taken = trials[best] if worse else refined, (*taken, best)
        tell(f"{best}: held-out RMS {present.validation_rms:.4g}")
        if without:
            present, taken = _thinned(present, taken, without)
        if limits.reached(first, present, len(taken)):
            break
    named = tuple(n for n in taken if not any(n in contains(other) for other in taken))
    return Selection(first, present, named, tuple(log), tuple(r for r in rivals if r[0] in named), tried)


def _thinned(
    present: Trial[ModelT], taken: tuple[str, ...], without: Callable[[Trial[ModelT], str], Trial[ModelT]]
) -> tuple[Trial[ModelT], tuple[str, ...]]:
    """The model without those of its earlier effects without which it comes as near to all moves."""
    for name in taken[:-1]:
        shorter = without(present, name)
        if distance(shorter) <= (1.0 + NEAR) * distance(present):
            present, taken = shorter, tuple(other for other in taken if other != name)
    return present, taken


def _without_containing(
    passed: Sequence[str],
    trials: Mapping[str, Trial[ModelT]],
    contains: Callable[[str], Sequence[str]],
    share: float,
) -> list[str]:
    """Those that contain no other of them, or remove `share` more of the held-out RMS than each that they contain, or
    nearly all that it leaves."""
    return [
        name
        for name in passed
        if all(_more_than(trials[inner], trials[name], share) for inner in contains(name) if inner in passed)
    ]


def _more_than(inner: Trial[ModelT], trial: Trial[ModelT], share: float) -> bool:
    """Whether an effect removes such a `share` more of the held-out RMS than one that it contains, or nearly all that
    this leaves of all moves, where that is more than the right one leaves."""
    most = inner.held_rms > LEFT_BY_INNER and gone_from_all(inner, trial, EXPLAINED)
    return most or trial.held_rms < (1.0 - share) * inner.held_rms


def _smallest_near(trials: Mapping[str, Trial[ModelT]], size: Callable[[Trial[ModelT]], int]) -> str:
    """Of those that come about as near to all moves as the nearest the one with the fewest parameters."""
    least = min(distance(trial) for trial in trials.values())
    near = [name for name, trial in trials.items() if distance(trial) <= (1.0 + NEAR) * least]
    return min(near, key=lambda name: (size(trials[name]), distance(trials[name])))


def _rival(
    best: str, name: str, trials: Mapping[str, Trial[ModelT]], nearly: Callable[[str], Sequence[str]]
) -> bool:
    """Whether another effect explains the moves as the best one does."""
    return name != best and alike(trials[best], trials[name], NEAR if name in nearly(best) else MATERIAL)


def _only(best: str, candidate: Candidate) -> Candidate:
    """The candidate as it is logged: only the best of a round is taken."""
    if candidate.effect == best or not candidate.accepted:
        return candidate
    why = f"significant, but {best} explains more"
    return Candidate(candidate.effect, candidate.validation_rms, candidate.p_value, False, why)


def _judged(
    present: Trial[ModelT], trials: Mapping[str, Trial[ModelT]], material: float, sole: float
) -> dict[str, Candidate]:
    """All candidates of a round, which must remove a `material` share; the ``sole_fit`` has only to gain at all."""
    only = sole_fit(present, trials, sole)
    return {
        name: _judge(name, present, trial, len(trials), 0.0 if name == only else material)
        for name, trial in trials.items()
    }


def _judge(name: str, before: Trial[ModelT], after: Trial[ModelT], tried: int, share: float) -> Candidate:
    p_value = min(1.0, tried * gain_p_value(before, after))
    material = after.held_rms < (1.0 - share) * before.held_rms
    honest = after.inner_blocks.sum() <= before.inner_blocks.sum()
    if not material:
        gained = after.train_rms < before.train_rms
        worse = after.held_rms > before.held_rms
        why = "lowers the train error and raises the held-out one" if gained and worse else "no material gain"
    elif not honest:
        why = "gains nothing on left-out parts of the train recordings"
    elif p_value >= LEVEL:
        why = "gain within what chance does"
    elif after.at_limits:
        why = f"only with {', '.join(after.at_limits)} where no such effect is"
    else:
        why = "significant and material on held-out moves"
    accepted = bool(material and honest and p_value < LEVEL and not after.at_limits)
    return Candidate(name, after.held_rms, p_value, accepted, why)


def alike(best: Trial[ModelT], other: Trial[ModelT], share: float) -> bool:
    """Two explanations are alike when the held-out errors differ by less than is material: what differs then beyond
    chance is as likely how a law differs from the machine's."""
    return other.held_rms < (1.0 + share) * best.held_rms
