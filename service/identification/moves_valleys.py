"""Search for an effect whose fits have many valleys, such as a second gap: a pinion between two gaps chatters, and how
often it is met on the way is a whole number.

A simulation costs a hundredth of a fit. So many sets of values are simulated, the best of them are fitted, and what
comes nearest is varied at random and fitted again: an evolution strategy (mu + lambda) whose survivors are improved by
a local search.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from service.backlash.moves import Moves, misfits, predict, with_motors_asked
from service.backlash.moves_begun import Values, shared_at
from service.backlash.moves_fit import Fitted, Point, at_rest, fit, values_at
from service.identification.moves_starts import (
    BRIEF,
    Candidate,
    begun_at,
    everywhere,
    fewer,
    on_a_few_moves,
    own_of_few,
    widened,
)
from service.identification.scene import Scene
from service.recording import FloatArray

SEED = 1
"""Of the random numbers: a recording is explained alike every time."""
SETS, WIDE = 50, 0.5
"""Sets that are simulated about every start, and how wide they lie there, in logarithms."""
FITTED = 12
"""How many of the starts are fitted beyond a few rounds, the best set of each."""
GENERATIONS, POPULATION, CHILDREN, KEPT = 3, 6, 60, 2
"""How often what has come nearest is varied; how many fits live on; how many sets are simulated about each of them, and
how many of those are fitted."""
WIDTHS = (0.03, 0.5)
"""Between which a set is varied, in logarithms."""
APART = 0.1
"""Difference of any amount, as a share, that makes a fit another."""
PROMISING = 0.98
"""How much nearer to a few moves than the present fit one of the first fits must come for the others to be followed
(chosen: of a few moves' RMS two parts in a hundred are chance)."""
QUICK = 2
"""Rounds after which the worse half of the new fits is given up."""


def valleys(scene: Scene, found: Fitted, candidate: Candidate) -> list[Fitted]:
    """The best fits of a few moves, each in a valley of its own, the best first; only one where none is promising."""
    rng = np.random.default_rng(SEED)
    few = asked(found)
    own = widened((own_of_few(found),), candidate.model)[0]
    begun = [
        about(few, candidate, values, own, SETS, (WIDE, WIDE), rng)[:1]
        for values in everywhere(scene, found, candidate)
    ]
    alive = survivors(fitted_best(few, candidate, begun, FITTED), candidate)
    present = fit(few, found.model, on_a_few_moves(found).at, 0)
    if not alive or alive[0].rms_with_motors > PROMISING * present.rms_with_motors:
        return alive[:1]
    for _ in range(GENERATIONS):
        children = [
            about(few, candidate, values_at(one), one.at.local[0], CHILDREN, WIDTHS, rng)[:KEPT]
            for one in alive
        ]
        alive = survivors([*alive, *fitted_best(few, candidate, children, POPULATION)], candidate)
    return alive


def asked(found: Fitted) -> tuple[Moves, ...]:
    """The few moves of a fit with their motors asked: where a second gap divides the play of one, the motor meets what
    lies between them before it meets the load."""
    own = own_of_few(found)
    return tuple(
        with_motors_asked(
            part,
            found.model,
            found.at.shared,
            predict(part, found.model, found.at.shared[None], own[None]).force()[0],
            by_noise=True,
        )
        for part in fewer(found)
    )


def about(
    few: Sequence[Moves],
    candidate: Candidate,
    values: Values,
    own: FloatArray,
    sets: int,
    widths: tuple[float, float],
    rng: np.random.Generator,
) -> list[tuple[float, Point]]:
    """Sets about these values as they are simulated, the best first: their RMS and where a fit begins by them, every
    move in that of the effect's rests in which it is described best. `own` (T, L) are the moves' other coordinates."""
    narrow, broad = np.log(widths)
    wide = np.exp(rng.uniform(narrow, broad, sets))
    varied = [values, *(candidate.effect.varied(values, w, rng) for w in wide[1:])]
    shared = np.stack([shared_at(candidate.model, one) for one in varied])
    rests = [candidate.effect.rests(one) for one in varied]
    ends = few[0].ends
    tried, squares = [], []
    for k in range(len(rests[0])):
        local = np.stack([at_rest(own, candidate.model, rest[k]) for rest in rests])
        r = misfits(few[0], candidate.model, shared, local)
        tried.append(local)
        squares.append(np.nan_to_num(np.add.reduceat(r**2, ends[:-1], axis=1), nan=np.inf))
    best = np.argmin(squares, axis=0)
    local = np.take_along_axis(np.stack(tried), best[None, ..., None], axis=0)[0]
    rms = np.sqrt(np.sum(np.min(squares, axis=0), axis=1) / ends[-1])
    return [(float(rms[k]), Point(shared[k], (local[k],))) for k in np.argsort(rms)]


def fitted_best(
    few: Sequence[Moves], candidate: Candidate, begun: Sequence[Sequence[tuple[float, Point]]], count: int
) -> list[Fitted]:
    """All fitted, but only the best `count` for more than a few rounds: how near a set comes as it is says little.
    These begin with every move's zeros found anew: where a load rests tells only once the machine is about right, and
    beside a wrong rest the right machine stays as far from the moves as a wrong one."""
    quick = sorted(
        (fit(few, candidate.model, at, QUICK) for part in begun for _, at in part),
        key=lambda f: f.rms_with_motors,
    )
    best = ((f.model, begun_at(few, f.model, values_at(f), f.at.local)) for f in quick[:count])
    return [fit(few, model, at, BRIEF) for model, at in best]


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
