"""Search for an effect whose fits have many valleys, such as a second gap: a pinion between two gaps chatters, and how
often it is met on the way is a whole number.

A simulation costs a hundredth of a fit. So many sets of values are simulated, the best of them are fitted, and what
comes nearest is varied at random and fitted again: an evolution strategy (mu + lambda) whose survivors are improved by
a local search.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from service.backlash.moves import REST_SPREAD, Moves, misfits
from service.backlash.moves_begun import Values, shared_at
from service.backlash.moves_fit import Fitted, Point, at_rest, fit, values_at
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
    Candidate,
    everywhere,
    fewer,
    on_a_few_moves,
    own_of_few,
    widened,
)
from service.identification.scene import Scene
from service.identification.selection import gone
from service.recording import FloatArray

SEED = 1
"""Of the random numbers: a recording is explained alike every time."""
SETS, WIDE = 50, 0.5
"""Sets that are simulated about every start, and how wide they lie there, in logarithms."""
FITTED = 12
"""How many of the starts are fitted beyond a few rounds, the best set of each."""
GENERATIONS, POPULATION, CHILDREN, KEPT = 3, 6, 60, 2
"""How often at most what has come nearest is varied; how many fits live on; how many sets are simulated about each of
them, and how many of those are fitted."""
WIDTHS = (0.03, 0.5)
"""Between which a set is varied, in logarithms."""
APART = 0.1
"""Difference of any amount, as a share, that makes a fit another."""
PROMISING, TAKEN = 0.98, 0.3
"""How much nearer to a few moves than the present fit one of the first fits must come for the others to be followed
(chosen: of a few moves' RMS two parts in a hundred are chance), and which share of what shows there it must take
(chosen: two gaps take about half of it or more; where the first fits take a fifth, the others took no more)."""
GAINS = 0.99
"""RMS, over that of the best before, from which on a generation gains nothing any more (chosen)."""
TURNS = 3
"""How often a fit of a few moves goes on from where its own numbers leave the pinions (chosen)."""
QUICK = 2
"""Rounds after which the worse half of the new fits is given up."""


def valleys(scene: Scene, found: Fitted, candidate: Candidate, seed: int = SEED) -> list[Fitted]:
    """The best fits of a few moves, each in a valley of its own, the best first; only one where none is promising."""
    rng = np.random.default_rng(seed)
    few = asked(found)
    own = widened((own_of_few(found),), candidate.model)[0]
    where = places_of_loads(few[0], found.model, found.at.shared, own_of_few(found))
    begun = [
        about(few, candidate, values, own, where, SETS, (WIDE, WIDE), rng)[:1]
        for values in everywhere(scene, found, candidate)
    ]
    alive = survivors(fitted_best(few, candidate, begun, FITTED), candidate)
    present = left_at_present(few, found)
    if not (alive and worth_following(present, alive[0].rms_with_motors)):
        return alive[:1]
    for _ in range(GENERATIONS):
        before, children = alive[0].rms_with_motors, []
        for one in alive:
            own = one.at.local[0]
            where = places_of_loads(few[0], one.model, one.at.shared, own)
            children.append(about(few, candidate, values_at(one), own, where, CHILDREN, WIDTHS, rng)[:KEPT])
        alive = survivors([*alive, *fitted_best(few, candidate, children, POPULATION)], candidate)
        if alive[0].rms_with_motors > GAINS * before:
            break
    return alive


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
) -> list[tuple[float, Point]]:
    """Sets about these values as they are simulated, the best first: their RMS and where a fit begins by them, every
    move in that of the effect's rests, or as the move before leaves it, in which it is described best. `own` (T, L) are
    the moves' other coordinates, and `where` (T, X) the loads lay beside their motors in the fit before [m]."""
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
    rms = np.sqrt(np.sum(np.min(squares, axis=0), axis=1) / ends[-1])
    return [(float(rms[k]), Point(shared[k], (local[k],))) for k in np.argsort(rms)]


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
    few: Sequence[Moves], candidate: Candidate, begun: Sequence[Sequence[tuple[float, Point]]], count: int
) -> list[Fitted]:
    """All fitted, but only the best `count` for more than a few rounds: how near a set comes as it is says little.
    These go on with their pinions where the moves before leave them: beside a wrong rest the right machine stays as far
    from the moves as a wrong one."""
    quick = sorted(
        (fit(few, candidate.model, at, QUICK) for part in begun for _, at in part),
        key=lambda f: f.rms_with_motors,
    )
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
