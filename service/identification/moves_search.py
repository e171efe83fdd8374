"""Search for what a model of moves lacks: every effect is refitted as an addition to the model, and judged on moves
that were not fitted.

A model that lacks something is driven into a corner of its parameters, from which a refit comes back slowly. So every
effect is started from several places: from the present fit, from the estimator's, which sees the middle of the moves
only, and from a fit to which all smooth effects were added at once. The effect's own shape (a frequency, a speed, a
period) is chosen there by a score test: the derivative of the residual with respect to a small dose of the effect,
projected off what the other parameters can do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from service.dynamics.driven_model import LINKS, DrivenEffect, Model
from service.identification.held_out import Explained, trial_of
from service.identification.moves import Moves, predict, residuals, some_of
from service.identification.moves_fit import (
    DIFFERENCE,
    Fitted,
    Point,
    best_of_each,
    costs_of_moves,
    fit,
    reconstructed,
    values_at,
    width,
)
from service.identification.scene import Scene, Values, point_at
from service.identification.selection import Trial
from service.recording import FloatArray

SHAPES = 2
"""Shapes of an effect from which it is started at each place, the best by the score."""
FEW, BRIEF = 4, 5
"""Moves and rounds with which starts are compared."""
FIRST_ROUNDS, ROUNDS = 6, 12
PROMISING = 4
"""Effects that are fitted further after a first look at all."""
FINALISTS = 2
"""Effects whose fit is finished with the motor's motion reconstructed from it."""
MORE, GAIN = 3, 0.005
"""How often a fit is continued, and the share of its RMS that it must gain to be continued again."""
ENDED, HOPELESS = 1.05, 4.0
"""RMS up to which a fit need not be begun elsewhere, and from which on more rounds do not help."""
FAR_OFF = 2.0
"""How much farther from a few moves than the best of all candidates one may be and still be fitted to all moves."""
SECOND = 0.9
"""How much nearer to the moves a place must be for a fit to begin there once more."""
PUT_BACK = ("turnover_speed", "turnover_spread", "coulomb", "viscous", "damping_ratio", "smear")
"""Parameters that a wrong model drives into a corner from which a fit comes back slowly."""


@dataclass(frozen=True)
class Candidate:
    """What a model becomes with an effect."""

    effect: DrivenEffect
    model: Model

    @property
    def name(self) -> str:
        return self.effect.name


def candidates(
    present: Model, library: Sequence[type[DrivenEffect]], taken: Sequence[str]
) -> list[Candidate]:
    """Every effect that is not in the model yet; a bridge only where two axes move together without one."""
    found = []
    for kind in library:
        bridge = kind.name == "gantry_coupling"
        if kind.name in taken or (bridge and (len(present.axes) < 2 or present.bridge)):
            continue
        effect = kind(present.axes)
        found.append(Candidate(effect, replace(present, effects=(*present.effects, effect))))
    return found


def scored(found: Fitted, candidate: Candidate, base: Values) -> list[Values]:
    """The candidate's shapes with the amounts that would take most from the residual, the best first.

    `found` is a fit of the model without the effect, `base` its values.
    """
    model, out = candidate.model, []
    amounts = [k for k, p in enumerate(model.parameters) if p.dose and p.name not in base]
    basis = np.linalg.qr(found.slopes.dense())[0]
    left = found.r - basis @ (basis.T @ found.r)
    for start in candidate.effect.starts:
        values = dict(candidate.effect.traded(dict(base) | dict(start)))
        slopes = score_slopes(found, model, values, amounts)
        slopes -= basis @ (basis.T @ slopes)
        H = slopes.T @ slopes + np.eye(len(amounts))
        step = np.linalg.solve(H, -slopes.T @ left)
        for k, u in zip(amounts, np.clip(step, -1.0, 1.0), strict=True):
            p = model.parameters[k]
            least = p.dose if p.low >= 0.0 else -np.inf
            values[p.name] = max(least, float(p.value(u)))
        out.append((float(step @ H @ step), values))
    return [values for _, values in sorted(out, key=lambda one: -one[0])]


def score_slopes(found: Fitted, model: Model, values: Values, amounts: Sequence[int]) -> FloatArray:
    """Derivative of the residuals with respect to the amounts' coordinates (N, amounts) at a fit."""
    shared = np.array([float(p.internal(values[p.name])) for p in model.parameters])
    sets = np.tile(shared, (1 + len(amounts), 1))
    for row, k in enumerate(amounts):
        sets[1 + row, k] += 10.0 * DIFFERENCE
    r = []
    for part, local in zip(found.moves, found.at.local, strict=True):
        own = np.zeros((len(local), width(model)))
        own[:, : local.shape[1]] = local
        r.append(residuals(part, predict(part, model, sets, np.tile(own, (len(sets), 1, 1)))))
    rows = np.hstack(r)
    return np.asarray(np.nan_to_num((rows[1:] - rows[0]).T / (10.0 * DIFFERENCE)))


def grounds(scene: Scene, found: Fitted) -> list[Fitted]:
    """The present model at the scene's places, on a few moves: where a score is taken too."""
    few, held = fewer(found), np.zeros(0, dtype=np.int64)
    return [
        fit(few, found.model, point_at(found.model, place, few), BRIEF, free=held)
        for place in (scene.rich, scene.smooth)
    ]


def fewer(found: Fitted) -> tuple[Moves, ...]:
    """The few moves with which starts are compared."""
    return tuple(some_of(part, FEW) for part in unanswering(found.moves)[:1])


def begun(scene: Scene, found: Fitted, candidate: Candidate) -> list[Values]:
    """Values from which the candidate is started, see the module's text."""
    present = values_at(found)
    shapes = scored(found, candidate, present)[:SHAPES]
    own = {p.name for p in candidate.effect.parameters}
    kept = {p.name for p in candidate.model.parameters}
    out = [*shapes]
    for place in (scene.rich, scene.smooth):
        free = {k: v for k, v in place.items() if k in own or k not in kept}
        base = {k: v for k, v in place.items() if k in kept} | dict(candidate.effect.instead(free))
        out.append({**present, **{k: v for k, v in shapes[0].items() if k in own}, **base})
    out.append({k: v for k, v in shapes[0].items() if not k.endswith(PUT_BACK)})
    at_rich = {k: v for k, v in scene.rich.items() if k in kept and not k.endswith(PUT_BACK)}
    out.append(at_rich | {k: v for k, v in shapes[0].items() if k in own})
    return out


def placed(place: Fitted, candidate: Candidate) -> Fitted:
    """The effect's own numbers fitted alone where the present model is put at one of the scene's places."""
    names = [p.name for p in candidate.model.parameters]
    own = np.array([names.index(p.name) for p in candidate.effect.parameters])
    at = point_at(candidate.model, scored(place, candidate, values_at(place))[0], place.moves)
    return fit(place.moves, candidate.model, at, BRIEF, free=own)


@dataclass(frozen=True)
class Brief:
    """What a fit of a few moves found: its RMS, its values, and how all moves begin by it."""

    model: Model
    rms: float
    values: Values
    local: tuple[FloatArray, ...]


def noted(found: Fitted, moves: Sequence[Moves]) -> Brief:
    return Brief(found.model, found.rms, values_at(found), alike(moves, found))


def compared(scene: Scene, found: Fitted, at_places: Sequence[Fitted], candidate: Candidate) -> list[Brief]:
    """The candidate's best two fits of a few moves, of one from each of its starts; the best first."""
    few = fewer(found)
    starts = [point_at(candidate.model, values, few) for values in begun(scene, found, candidate)]
    starts += [placed(place, candidate).at for place in at_places]
    brief = [fit(few, candidate.model, at, BRIEF) for at in starts]
    other = softer_contact(values_at(min(brief, key=lambda f: f.rms)), candidate.model)
    if other:
        brief.append(fit(few, candidate.model, point_at(candidate.model, other, few), BRIEF))
    return [noted(one, found.moves) for one in sorted(brief, key=lambda f: f.rms)[:2]]


def carried(moves: Sequence[Moves], brief: Brief, rounds: int) -> Fitted:
    """What was fitted to a few moves, fitted to all."""
    return fit(moves, brief.model, begun_at(moves, brief.model, brief.values, brief.local), rounds)


def refitted(found: Fitted, brief: Sequence[Brief], least: float) -> Fitted:
    """The candidate on all moves, from the best of its fits of a few; `least` is the RMS of the best of all
    candidates there. One that is far from it only takes the moves' zeros along."""
    moves = unanswering(found.moves)
    if brief[0].rms > FAR_OFF * least:
        return carried(moves, brief[0], 1)
    best = brief[:2] if brief[0].rms > 0.9 * brief[1].rms else brief[:1]
    return min((carried(moves, one, FIRST_ROUNDS) for one in best), key=lambda f: f.rms)


def seconded(found: Fitted, best: Fitted, first: Fitted, candidate: Candidate) -> Fitted:
    """The candidate, fitted `first`, begun once more with the machine that the best of all candidates found: while an
    axis moves, effects are alike that are not at its turning points, and the best has left the declared model's
    corner."""
    few, held = fewer(found), np.zeros(0, dtype=np.int64)
    ground = fit(few, found.model, point_at(found.model, values_at(best), few), BRIEF, free=held)
    brief = fit(few, candidate.model, placed(ground, candidate).at, BRIEF)
    if brief.rms > SECOND * first.rms:
        return first
    again = carried(first.moves, noted(brief, first.moves), FIRST_ROUNDS)
    return min(first, again, key=lambda f: f.rms)


def softer_contact(values: Values, model: Model) -> Values | None:
    """The values with shaft and contact exchanged where the contact is the stiffer one: beside a light pinion a linear
    model cannot tell them apart, and what bends or parts is the contact."""
    link, out = LINKS[model.lumps][-1], dict(values)
    for axis in model.axes:
        shaft, contact = f"{axis}.{link}_stiffness", f"{axis}.contact_stiffness"
        if values[contact] > values[shaft]:
            out |= {shaft: values[contact], contact: values[shaft]}
    return None if out == dict(values) else out


def begun_at(moves: Sequence[Moves], model: Model, values: Values, local: tuple[FloatArray, ...]) -> Point:
    """The point with these values and every move's zeros fitted there, from a search and from `local`, so that no wrong
    zero drives the values away."""
    searched, held = point_at(model, values, moves), np.zeros(0, dtype=np.int64)
    starts = (searched, Point(searched.shared, local))
    return best_of_each([fit(moves, model, at, BRIEF, free=held) for at in starts])


def alike(moves: Sequence[Moves], found: Fitted) -> tuple[FloatArray, ...]:
    """The zeros of all moves as they are in a fit of a few: moves of one direction begin much alike."""
    of, own, errors = found.moves[0].s, found.at.local[0], costs_of_moves(found, 0)
    best = {s: own[np.flatnonzero(of == s)[np.argmin(errors[of == s])]] for s in np.unique(of)}
    return tuple(np.stack([best.get(s, np.zeros(own.shape[1])) for s in part.s]) for part in moves)


def unanswering(moves: Sequence[Moves]) -> tuple[Moves, ...]:
    """The moves with a motion that does not answer to the force: quicker, and good enough for comparing effects."""
    return tuple(replace(part, echoes=(), reference=None) for part in moves)


def settled(found: Fitted, rounds: int) -> Fitted:
    """The fit continued with the motors' motion reconstructed from it. One that is not near begins once more with the
    numbers put back that a wrong model drives into a corner."""
    moves = reconstructed(found)
    on = fit(moves, found.model, found.at, rounds)
    if on.rms < ENDED:
        return on
    put_back = {name: v for name, v in values_at(found).items() if not name.endswith(PUT_BACK)}
    again = fit(moves, found.model, begun_at(moves, found.model, put_back, found.at.local), rounds)
    return min(on, again, key=lambda f: f.rms)


def propose(
    scene: Scene,
    library: Sequence[type[DrivenEffect]],
    present: Trial[Explained],
    taken: tuple[str, ...],
    tell: Callable[[str], None],
) -> dict[str, Trial[Explained]]:
    """Every effect that is not in yet, fitted on all train moves; the best few fitted to the end."""
    base = present.model.fitted
    found: dict[str, Fitted] = {}
    at_places = grounds(scene, base)
    brief = {
        candidate.name: compared(scene, base, at_places, candidate)
        for candidate in candidates(base.model, library, taken)
    }
    least = min(fits[0].rms for fits in brief.values())
    for name, fits in brief.items():
        found[name] = refitted(base, fits, least)
        tell(f"tried {name}: {found[name].rms:.3f} (now {base.rms:.3f})")
    best = min(found.values(), key=lambda f: f.rms)
    for candidate in candidates(base.model, library, taken) if best.rms < SECOND * base.rms else ():
        if best.rms < SECOND * found[candidate.name].rms:
            found[candidate.name] = seconded(base, best, found[candidate.name], candidate)
    for name in sorted(found, key=lambda n: found[n].rms)[:PROMISING]:
        found[name] = fit(found[name].moves, found[name].model, found[name].at, ROUNDS)
    finalists = sorted(found, key=lambda n: found[n].rms)[:FINALISTS]
    for name in finalists:
        found[name] = settled(found[name], ROUNDS)
    return {name: trial_of(scene, f, thorough=name in finalists) for name, f in found.items()}


def ended(scene: Scene, trial: Trial[Explained]) -> Trial[Explained]:
    """The fit of a model that may be the right one, begun once more with the machine of the estimator and of the smooth
    fit, and continued while it gains."""
    best = trial.model.fitted
    for place in (scene.rich, scene.smooth):
        if best.rms > ENDED:
            best = min(best, elsewhere(best, place), key=lambda f: f.rms)
    for _ in range(MORE if best.rms < HOPELESS else 0):
        further = settled(best, ROUNDS)
        gained, best = best.rms - further.rms, min(best, further, key=lambda f: f.rms)
        if gained < GAIN * best.rms:
            break
    return trial if best is trial.model.fitted else trial_of(scene, best)


def elsewhere(found: Fitted, place: Values) -> Fitted:
    """The model fitted from the effects' numbers as found, and the machine's as they are at a place."""
    machine = {p.name for p in replace(found.model, effects=found.model.effects[:1]).parameters}
    values = values_at(found) | {name: value for name, value in place.items() if name in machine}
    moves = unanswering(found.moves)
    return settled(
        fit(moves, found.model, begun_at(moves, found.model, values, found.at.local), ROUNDS), ROUNDS
    )


def challenged(scene: Scene, present: Trial[Explained], best: Trial[Explained]) -> Trial[Explained]:
    """The present model fitted once more from where the best candidate ended, without the candidate's effect, so that
    no effect is named for having led the fit out of a poor valley."""
    now, other = present.model.fitted, best.model.fitted
    keep = [[p.name for p in other.model.parameters].index(p.name) for p in now.model.parameters]
    at = Point(other.at.shared[keep], tuple(local[:, : width(now.model)] for local in other.at.local))
    again = settled(fit(other.moves, now.model, at, ROUNDS), ROUNDS)
    return trial_of(scene, again) if again.rms < 0.99 * now.rms else present
