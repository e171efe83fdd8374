"""Search for an effect whose fits have many valleys, such as a second gap: a pinion between two gaps chatters, and how
often it is met on the way is a whole number.

A simulation costs a hundredth of a fit. So many sets of values about the present machine are simulated, and the best of
them fitted. But a model that lacks something has gone to a corner from which few ways lead out: fits begin on typical
machines that are drawn at random, too, however far from the moves these are as they are. What comes nearest is varied
at random and fitted again: an evolution strategy (mu + lambda) whose survivors are improved by a local search.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from service.backlash.moves import Moves
from service.backlash.moves_begun import Values, shared_at
from service.backlash.moves_fit import Fitted, fit, values_at
from service.backlash.moves_point import Point
from service.backlash.moves_predicted import REST_SPREAD, misfits
from service.backlash.moves_refined import at_rest
from service.dynamics.driven_effect import HELD_WIDER
from service.dynamics.driven_model import Model
from service.identification.moves_lying import (
    axis_of,
    left_lying,
    lying_as_left,
    lying_now,
    motors_asked,
    pinions,
)
from service.identification.moves_starts import (
    BRIEF,
    GUIDE,
    TOO_MUCH,
    Candidate,
    begun_at,
    fewer,
    near_by,
    on_a_few_moves,
    own_of_few,
    widened,
)
from service.identification.scene import Scene
from service.identification.selection import gone
from service.recording import FloatArray

SEED = 1
"""Of the random numbers: a recording is explained alike every time."""
SETS, WIDE = 25, 0.5
"""Sets that are simulated about every start, and how wide they lie there, in logarithms; as wide lie typical machines
about the typical one."""
DRAWN, LEAST = 24, 0.035
"""How many typical machines are drawn (chosen: one in ten leads to where the planted one does, if its play is divided
about alike), and the least share of all play that either gap has on them."""
FITTED, DRAWN_FITTED = 8, 10
"""How many of the starts, the best set of each, and of the machines that were drawn, are fitted beyond a few rounds."""
GENERATIONS, POPULATION, CHILDREN, KEPT = 3, 6, 60, 2
"""How often at most what has come nearest is varied; how many fits live on; how many sets are simulated about each of
them, and how many of those are fitted."""
WIDTHS = (0.03, 0.5)
"""Between which a set is varied, in logarithms."""
APART = 0.1
"""Difference of any amount, as a share, that makes a fit another."""
PROMISING, TAKEN = 0.98, 0.15
"""How much nearer to a few moves than the present fit one of the first fits must come for the others to be followed
(chosen: of a few moves' RMS two parts in a hundred are chance), and which share of what shows there it must take
(chosen: two gaps take about half of it or more as a rule; on a machine where the first fits took a fifth, the others
led to its second gap, and to a backlash 9 um nearer)."""
AHEAD = 0.95
"""RMS of a few moves and their motors, over that of the present fit, that an effect begun near by comes to where it is
asked for before others (chosen: most machines with two gaps come to less, few with one; only the order depends on
it)."""
GAINS = 0.99
"""RMS, over that of the best before, from which on a generation gains nothing any more (chosen)."""
TURNS = 3
"""How often a fit of a few moves goes on from where its own numbers leave the pinions (chosen)."""
QUICK, FROM_AFAR = 2, 4
"""Rounds after which the worse half of the new fits is given up, and of those that begin on machines drawn anew."""


class Begun(NamedTuple):
    """Fits of a `few` moves from about the numbers of the present fit, and the random numbers that go on after them."""

    few: tuple[Moves, ...]
    fits: list[Fitted]
    rng: np.random.Generator


def valleys(
    scene: Scene, found: Fitted, candidate: Candidate, seed: int = SEED, near: Begun | None = None
) -> list[Fitted]:
    """The best fits of a few moves, each in a valley of its own, the best first; only one where none is promising, and
    none where more is missing than the effect can do. What was begun `near` by with this seed is not begun again."""
    if found.rms > TOO_MUCH:
        return []
    few, begun, rng = near or begun_near(scene, found, candidate, seed)
    own = widened((own_of_few(found),), candidate.model)
    drawn = (
        begun_at(few, candidate.model, values, own) for values in typical_machines(found, candidate, rng)
    )
    from_afar = fitted_best(few, candidate, drawn, FROM_AFAR, DRAWN_FITTED)
    alive = survivors([*begun, *from_afar], candidate)
    present = left_at_present(few, found)
    if not (alive and worth_following(present, alive[0].rms_with_motors)):
        return alive[:1]
    for _ in range(GENERATIONS):
        before, children = alive[0].rms_with_motors, list[Point]()
        for one in alive:
            at = one.at.local[0]
            where = places_of_loads(few[0], one.model, one.at.shared, at)
            children += about(few, candidate, values_at(one), at, where, CHILDREN, WIDTHS, rng)[:KEPT]
        alive = survivors([*alive, *fitted_best(few, candidate, children, QUICK, POPULATION)], candidate)
        if alive[0].rms_with_motors > GAINS * before:
            break
    return alive


def comes_nearer(found: Fitted, near: Begun) -> bool:
    """Whether what was begun near by comes `AHEAD` of the present fit on a few moves and their motors."""
    return nearest_with_motors(near) < AHEAD * left_at_present(near.few, found)


def nearest_with_motors(begun: Begun) -> float:
    """RMS that the nearest of what was begun leaves of its moves and their motors."""
    return min(f.rms_with_motors for f in begun.fits)


def begun_near(scene: Scene, found: Fitted, candidate: Candidate, seed: int = SEED) -> Begun:
    """Fits of a few moves from about the numbers of the present fit."""
    few, rng = asked(found), np.random.default_rng(seed)
    own = widened((own_of_few(found),), candidate.model)
    where = places_of_loads(few[0], found.model, found.at.shared, own_of_few(found))
    begun = [
        about(few, candidate, values, own[0], where, SETS, (WIDE, WIDE), rng)[0]
        for values in near_by(scene, found, candidate)
    ]
    return Begun(few, fitted_best(few, candidate, begun, QUICK, FITTED), rng)


def typical_machines(found: Fitted, candidate: Candidate, rng: np.random.Generator) -> Iterator[Values]:
    """The effect on typical machines with the friction and all play of a fit, their other numbers drawn at random, and
    the play divided from hardly any to nearly all."""
    kept = {k: v for k, v in values_at(found).items() if k.endswith(("backlash", *GUIDE))}
    drawn = [p for p in candidate.model.parameters if p.logarithmic and p.name not in kept]
    wide = {p.name: HELD_WIDER * WIDE if p.name.endswith(candidate.effect.held) else WIDE for p in drawn}
    most = np.log(1.0 / LEAST - 1.0)
    for k in range(DRAWN):
        machine = {p.name: p.typical * float(np.exp(wide[p.name] * rng.standard_normal())) for p in drawn}
        share = 1.0 / (1.0 + np.exp(most * (1.0 - 2.0 * (k + rng.random()) / DRAWN)))
        yield dict(candidate.effect.divided({**machine, **kept}, share))


def worth_following(present: float, nearest: float) -> bool:
    """Whether others are followed where the nearest of the first fits leaves so much of a few moves that the present
    model leaves so much of."""
    return nearest < PROMISING * present and gone(present, nearest, TAKEN)


def asked(found: Fitted) -> tuple[Moves, ...]:
    """The few moves of a fit with their motors asked: where a second gap divides the play of one, the motor meets what
    lies between them before it meets the load."""
    at = Point(found.at.shared, (own_of_few(found),))
    return motors_asked(fewer(found), found.model, at)


def left_at_present(few: Sequence[Moves], found: Fitted) -> float:
    """RMS that the model of a fit leaves of a few of its moves and their motors, fitted to these."""
    return fit(few, found.model, on_a_few_moves(found).at, BRIEF).rms_with_motors


def about(
    few: Sequence[Moves],
    candidate: Candidate,
    values: Values,
    own: FloatArray,
    where: FloatArray,
    sets: int,
    widths: tuple[float, float],
    rng: np.random.Generator,
) -> list[Point]:
    """Where fits begin by sets about these values, the best first as they are simulated, every move in that of the
    effect's rests, or as the move before leaves it, in which it is described best. `own` (T, L) are the moves' other
    coordinates, and `where` (T, X) the loads lay beside their motors in the fit before [m]."""
    narrow, broad = np.log(widths)
    wide = np.exp(rng.uniform(narrow, broad, sets))
    varied = [values, *(candidate.effect.varied(values, w, rng) for w in wide[1:])]
    shared = np.stack([shared_at(candidate.model, one) for one in varied])
    rests = [candidate.effect.rests(one) for one in varied]
    ends = few[0].ends
    tried, squares = [], []
    sides = [
        np.stack([at_rest(own, candidate.model, rest[k]) for rest in rests]) for k in range(len(rests[0]))
    ]
    for local in (*sides, as_left(few[0], candidate.model, shared, sides[0], where)):
        r = misfits(few[0], candidate.model, shared, local)
        tried.append(local)
        squares.append(np.nan_to_num(np.add.reduceat(r**2, ends[:-1], axis=1), nan=np.inf))
    best = np.argmin(squares, axis=0)
    local = np.take_along_axis(np.stack(tried), best[None, ..., None], axis=0)[0]
    nearest = np.argsort(np.sum(np.min(squares, axis=0), axis=1))
    return [Point(shared[k], (local[k],)) for k in nearest]


def as_left(few: Moves, model: Model, shared: FloatArray, local: FloatArray, where: FloatArray) -> FloatArray:
    """Sets (S, T, L) with the pinions where the moves before leave them, and the loads at `where` (T, X)."""
    out, numbers = local.copy(), [model.numbers(one) for one in shared]
    for (k, p), left in left_lying(few, model, shared, local).items():
        x = axis_of(model, p)
        gap = np.array([one[f"{model.axes[x]}.backlash"] for one in numbers])[:, None]
        place = np.where(np.isfinite(left), left, 0.0)
        out[..., k] = p.internal(place)
        out[..., 2 * x] = (where[:, x] + 0.5 * few.s * gap - place) / REST_SPREAD[0]
    return out


def places_of_loads(few: Moves, model: Model, shared: FloatArray, own: FloatArray) -> FloatArray:
    """Where the loads lie when moves begin, beside their motors [m], by coordinates (P,) and (T, L): (T, X)."""
    values, out = model.numbers(shared), np.empty((len(own), len(model.axes)))
    for x, axis in enumerate(model.axes):
        out[:, x] = REST_SPREAD[0] * own[:, 2 * x] - 0.5 * few.s * values[f"{axis}.backlash"]
    for k, p in pinions(model):
        out[:, axis_of(model, p)] += lying_now(few, model, shared[None], own[None], k)[0]
    return out


def fitted_best(
    few: Sequence[Moves], candidate: Candidate, begun: Iterable[Point], rounds: int, count: int
) -> list[Fitted]:
    """All fitted, but only the best `count` for more than a few `rounds`. These go on with their pinions where the
    moves before leave them: beside a wrong rest the right machine stays as far from the moves as a wrong one."""
    quick = sorted((fit(few, candidate.model, at, rounds) for at in begun), key=lambda f: f.rms_with_motors)
    return [by_rests(few, f) for f in quick[:count]]


def by_rests(few: Sequence[Moves], found: Fitted) -> Fitted:
    """The nearest of a fit of a few moves and of those that go on from where the moves before leave the pinions."""
    best = on = found
    for _ in range(TURNS):
        moves, at = lying_as_left(few, on.model, on.at)
        on = fit(moves, on.model, at, BRIEF // 2)
        on = fit(few, on.model, as_anywhere(on), 0)
        best = min(best, on, key=lambda f: f.rms_with_motors)
    return best


def as_anywhere(found: Fitted) -> Point:
    """The point of a fit whose moves say where its pinions were left, among moves that do not."""
    local = []
    for part, own in zip(found.moves, found.at.local, strict=True):
        out = own.copy()
        for k, p in pinions(found.model):
            out[:, k] = p.internal(lying_now(part, found.model, found.at.shared[None], own[None], k)[0])
        local.append(out)
    return Point(found.at.shared, tuple(local))


def survivors(fits: Sequence[Fitted], candidate: Candidate) -> list[Fitted]:
    """The best of the fits, of those that ended alike the better one."""
    amounts = [p.name for p in candidate.effect.parameters if not p.dose and p.low == 0.0]
    out: list[Fitted] = []
    for one in sorted(fits, key=lambda f: f.rms_with_motors):
        if len(out) < POPULATION and all(apart(one, other, amounts) for other in out):
            out.append(one)
    return out


def apart(one: Fitted, other: Fitted, amounts: Sequence[str]) -> bool:
    """Whether two fits differ in any of the amounts."""
    return any(abs(one.value(n) - other.value(n)) > APART * other.value(n) for n in amounts)
