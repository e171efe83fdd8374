"""Which step to command: the conditions of section III and the information that a step holds about the gap.

Section III asks of the jerk-limited step that v_max < v_lim and a_max < a_lim, so that the acceleration changes
its sign at one clear time t0, that the pinion passes the gap completely, and that the pass lasts much longer than
a sample. Among the steps that meet this on machines from soft and rough to stiff and smooth, the one is proposed
whose samples say most about b: the Fisher information of the model's own sensitivities, with the accelerometer's
noise, everything else about the machine as nuisance under its prior, and the load's state at the start of every
step free. What the information does not know - how far the model's structure carries - is added as in the fit.

Symbols: SL, j_lim length and jerk of the step; b the backlash; T duration of the step.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from service.backlash.step_information import Sampled, Sensing, information, machine, sampled
from service.dynamics.driven_model import Model
from service.dynamics.trajectory import JerkLimitedStep, jerk_limited_step
from service.recording import FloatArray

KEPT_FREE = 0.9
"""Share of v_lim and a_lim that a step may use. Chosen: the controller's overshoot needs the rest."""

PERIODS = 5.0
"""Samples of the slower channel in the pass, at least: "much longer than the sampling time" of section III."""

LATEST = 0.75
"""Share of T by which the flanks must have met: from there on the motor brakes less and less."""

RANGE_OF_MACHINES = 0.7
"""Prior standard deviations by which the soft, rough and the stiff, smooth machine differ from the typical."""

SHORTEST, LONGEST = 1e-3, 20e-3
SOFTEST, SHARPEST = 20.0, 2000.0
CANDIDATES = 9
"""Steps that are tried: SL [m], j_lim [m/s³], so many of each, evenly in the logarithm."""

NEARLY = 1.1
"""Among the intervals after ten steps within this factor of the best, the gentlest step is taken."""

FEWEST, MOST = 10, 40
WORST = 0.5
"""Steps of a run: ten as in section V, more where they help. Half width over b beyond which a value is none."""


@dataclass(frozen=True)
class Systematic:
    """Standard deviation that what a model lacks is expected to add: `floor` [m] and `share` of the backlash.

    A run's own interval knows better, from its residual. Chosen: what the residuals of our own sound machines, which
    are not of the model's kind, come to (tests/benchmarks/accuracy.py).
    """

    floor: float
    share: float


CHAIN_OF_TWO = Systematic(0.11e-6, 1.2e-3)
"""A single axis, gear and pinion as masses."""

GANTRY_OF_LUMPS = Systematic(0.22e-6, 3e-3)
"""A gantry."""


@dataclass(frozen=True)
class Limits:
    """Of the axis: v_lim [m/s], a_lim [m/s²], jerk [m/s³] and travel [m]."""

    v: float
    a: float
    jerk: float
    travel: float


@dataclass(frozen=True)
class Proposal:
    """A step and what a run of it is expected to give.

    Attributes
    ----------
    length, jerk : SL [m], j_lim [m/s³]
    duration, v_max, a_max : of the step [s], [m/s], [m/s²]
    steps : how many
    gap_time : of the shortest pass among the machines considered [s]
    half_width : of the 95 % interval [m], on the least favourable machine
    noise_alone : the same by the noise only, without what the model's structure is worth [m]
    """

    length: float
    jerk: float
    duration: float
    v_max: float
    a_max: float
    steps: int
    gap_time: float
    half_width: float
    noise_alone: float


@dataclass(frozen=True)
class NoStep:
    """No step can measure the gap: the `limit` that is in the way, and what to do about it."""

    limit: str
    detail: str


@dataclass(frozen=True)
class _Judged:
    """A step on the machines considered: shortest pass [s], information about ln b of one step of each direction."""

    step: JerkLimitedStep
    gap_time: float
    informations: tuple[FloatArray, ...]


def propose(
    limits: Limits, sensing: Sensing, b: float, structure: Systematic, wanted: float, axes: int = 1
) -> Proposal | NoStep:
    """The step that measures a gap of about b [m] best, or why none can.

    Parameters
    ----------
    wanted : half width [m] that more than ten steps are spent for
    axes : 2 for a gantry, whose axes are fitted together
    """
    inside = list(_candidates(limits))
    if not inside:
        return _no_room(limits)
    model = Model(tuple(f"X{k + 1}" for k in range(axes)), 2 if axes == 1 else 1)
    judged = [_judged(model, step, sensing, b) for step in inside]
    sound = [found for found in judged if isinstance(found, _Judged)]
    if not sound:
        return _most_common([found for found in judged if isinstance(found, NoStep)])
    after_ten = [_half_widths(found, sensing, b, structure, FEWEST)[0] for found in sound]
    near = [found for found, half in zip(sound, after_ten, strict=True) if half <= NEARLY * min(after_ten)]
    gentlest = min(near, key=lambda found: found.step.a_max)
    best = _proposal(gentlest, sensing, b, structure, wanted)
    if best.half_width > WORST * b:
        return NoStep(
            "noise",
            f"The best step gives {b * 1e6:.0f} ± {best.half_width * 1e6:.1f} µm; the accelerometer's noise of "
            f"{sensing.noise:g} m/s² is too much for so small a gap: take a quieter sensor or a higher rate.",
        )
    return best


def _candidates(limits: Limits) -> Iterator[JerkLimitedStep]:
    """The steps within the limits, with one clear t0 each: neither v_lim nor a_lim is reached."""
    lengths = np.geomspace(SHORTEST, max(SHORTEST, min(LONGEST, limits.travel)), CANDIDATES)
    jerks = np.geomspace(min(SOFTEST, limits.jerk), min(SHARPEST, limits.jerk), CANDIDATES)
    for length in np.unique(lengths[lengths <= limits.travel]):
        for jerk in np.unique(jerks):
            step = jerk_limited_step(float(length), float(jerk), 1e6, 1e6)
            if step.v_max <= KEPT_FREE * limits.v and step.a_max <= KEPT_FREE * limits.a:
                yield step


def _no_room(limits: Limits) -> NoStep:
    """Which limit even the shortest and softest step breaks."""
    if limits.travel < SHORTEST:
        return NoStep(
            "travel", f"The axis travels {limits.travel * 1e3:g} mm only; a step needs 1 mm and more."
        )
    step = jerk_limited_step(SHORTEST, min(SOFTEST, limits.jerk), 1e6, 1e6)
    if step.v_max > KEPT_FREE * limits.v:
        limit, reached, allowed, unit = "velocity", step.v_max, limits.v, "m/s"
    else:
        limit, reached, allowed, unit = "acceleration", step.a_max, limits.a, "m/s²"
    return NoStep(
        limit,
        f"Even a step of 1 mm with {step.jerk:g} m/s³ reaches {reached:.3g} {unit}, and the axis' limit is "
        f"{allowed:.3g} {unit}, a tenth of which is kept free: raise the {limit} limit for the diagnostic run.",
    )


def _most_common(found: Sequence[NoStep]) -> NoStep:
    """The limit that stops most steps that the axis could make, in the words of the one that comes nearest."""
    limit, _ = Counter(no.limit for no in found).most_common(1)[0]
    others = sorted({no.limit for no in found} - {limit})
    beside = f" (other steps fail by: {', '.join(others)})" if others else ""
    last = [no for no in found if no.limit == limit][-1]
    return replace(last, detail=f"No step within the limits can measure the gap{beside}. {last.detail}")


def _judged(model: Model, step: JerkLimitedStep, sensing: Sensing, b: float) -> _Judged | NoStep:
    """The step on each machine of the range: the conditions, then the information."""
    gap_times, informations = [], []
    for shift in (-RANGE_OF_MACHINES, 0.0, RANGE_OF_MACHINES):
        point = machine(model, b, shift)
        answer = sampled(model, point, step, sensing)
        passed = _conditions(answer, step, sensing, b)
        if isinstance(passed, NoStep):
            return passed
        gap_times.append(passed)
        informations.append(information(model, answer, sensing))
    return _Judged(step, min(gap_times), tuple(informations))


def _conditions(sampled: Sampled, step: JerkLimitedStep, sensing: Sensing, b: float) -> float | NoStep:
    """The time that the pass takes [s], or which condition of section III the step breaks."""
    told = f"A step of {step.length * 1e3:.1f} mm with {step.jerk:.0f} m/s³"
    forward = sampled.response.relative[0, 0, 0]
    parted, met = (np.flatnonzero(forward < level) for level in (0.5 * b, -0.5 * b))
    if not len(met) or not len(parted) or sampled.time[met[0]] > LATEST * step.duration:
        return NoStep(
            "crossing",
            f"{told} does not bring the flanks together while the motor brakes; the gap is too wide for it: allow a "
            "longer step, or more acceleration.",
        )
    lasting = float(sampled.time[met[0]] - sampled.time[parted[0]])
    period = 1.0 / min(sensing.speed_rate, sensing.acceleration_rate)
    if lasting < PERIODS * period:
        return NoStep(
            "sampling",
            f"{told} passes the gap in {lasting * 1e3:.1f} ms, {lasting / period:.1f} samples of the slower channel, "
            f"and {PERIODS:g} are needed: sample faster, or allow a smaller jerk.",
        )
    peak = float(np.max(np.abs(sampled.response.acceleration[0])))
    if peak > sensing.range:
        return NoStep(
            "sensor range",
            f"{told} makes a blow of {peak:.0f} m/s², beyond the sensor's {sensing.range:.0f} m/s²: choose its larger "
            "range.",
        )
    return lasting


def _proposal(found: _Judged, sensing: Sensing, b: float, structure: Systematic, wanted: float) -> Proposal:
    """The fewest steps that reach `wanted`, at least ten; ten where no number does."""
    counts = range(FEWEST, MOST + 1, 2)
    halves = {n: _half_widths(found, sensing, b, structure, n) for n in counts}
    n = next((n for n in counts if halves[n][0] <= wanted), FEWEST)
    s = found.step
    return Proposal(s.length, s.jerk, s.duration, s.v_max, s.a_max, n, found.gap_time, *halves[n])


def _half_widths(
    found: _Judged, sensing: Sensing, b: float, structure: Systematic, n: int
) -> tuple[float, float]:
    """Half width of the 95 % interval [m] after n steps on the least favourable machine, and by the noise alone.

    The backlash is the first parameter; its coordinate is a logarithm over its spread. The rounding of the motor's
    speed is an error of the input: what it integrates to over the pass.
    """
    spread = Model(("X1",)).parameters[0].spread
    by_noise = max(
        b * spread * float(np.sqrt(np.linalg.inv(0.5 * n * info + np.eye(len(info)))[0, 0]))
        for info in found.informations
    )
    rounding = sensing.speed_lsb / np.sqrt(12.0) * np.sqrt(found.gap_time / sensing.speed_rate / n)
    noise = float(np.hypot(by_noise, rounding))
    whole = float(np.linalg.norm((noise, structure.floor, structure.share * b)))
    return 1.96 * whole, 1.96 * noise
