"""The recordings of one axis, or of two that move together, ready to be fitted: the declared model, and the places
from which fits are started."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from scipy.fft import next_fast_len

from service.backlash.model_fit import GANTRY, SINGLE
from service.backlash.model_fit_data import measure
from service.backlash.model_fit_gantry import gantry_fit
from service.backlash.model_fit_stages import Staged, staged_fit
from service.backlash.model_fit_start import closed_form
from service.backlash.moves import TAIL, Moves, moves_of
from service.backlash.moves_begun import Values, begun_anew, point_at, resettled, with_expected_errors
from service.backlash.moves_fit import Fitted, fit, values_at
from service.backlash.moves_parts import few_of, some_of
from service.backlash.plausibility import clipped
from service.dynamics.driven_effect import Case
from service.dynamics.driven_model import LINKS, DrivenEffect, Model
from service.dynamics.driven_parameters import Parameter
from service.dynamics.driven_parameters import Values as SetValues
from service.dynamics.effects.driven_bodies import MotorWander, at_rest
from service.identification.bridge_zero import bridge_zero, moved_to
from service.identification.rest_spectrum import heard_at_rest, swings_before
from service.identification.rest_zero import zero_wanders
from service.recording import FloatArray, Recording

HELD = ("constant", "skew")
"""What the declared model does not have: a constant force, and a skew between the channels."""
NOT_SMOOTH = (
    "machine_body_mode",
    "hung_mass_mode",
    "transmission_ripple",
    "gearbox_clearance",
    "contact_nonlinearity",
    "preload_flank",
    "gantry_coupling",
    "sensor_filter",
)
"""Effects whose place in a fit has to be searched for, or that are nearly another one; the others are added all at once
for a start."""
ROUNDS, FIRST_ROUNDS = 16, 6
"""Rounds of a fit, and those after which only the nearest of several starts is continued."""
OF_SMOOTH = 5
"""Moves, at most, of every recording by which all smooth effects are first fitted (chosen: on six machines the fit of
all then ends within 4 % of where one of all alone does, or nearer, in a fifth less time)."""
MUCH = 4.0
"""RMS of a few moves from which on so much is missing that neither more rounds nor all moves tell more of the machine
(chosen)."""
BRIEFLY = replace(SINGLE, in_vain=16.0)
"""How the estimator looks for where fits begin: where few steps leave four times the noise all of them tell no more
(chosen: there a pinion is driven to where it swings too fast for the grid, and every pass takes long)."""


@dataclass(frozen=True)
class ChannelTolerance(DrivenEffect):
    """What every chain of measurement does: time stamps off by about the time that a frame takes on the bus, and a
    sensor whose own filter smears an impact a little. No effects, but both change an impact by more than the noise.
    Part of the declared model."""

    name: ClassVar[str] = "channel_tolerance"
    means: ClassVar[str] = "time stamps are rounded, and the sensor has a bandwidth"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("clock_offset", "s", 0.0, 3e-5, logarithmic=False),
        Parameter("smear", "s", 0.0, 1e-4, logarithmic=False, low=0.0, high=4e-4),
    )

    def restate(self, values: SetValues) -> SetValues:
        return {**values, **{f"{a}.skew": values[f"{a}.clock_offset"] for a in self.axes}}

    def measure(self, predicted: FloatArray, case: Case) -> FloatArray:
        out = predicted.copy()
        for _, axis, x in self.each(case.model):
            out[:, :, x] = smeared(predicted[:, :, x], case.values[f"{axis}.smear"] / case.h)
        return out


def smeared(course: FloatArray, spread: FloatArray) -> FloatArray:
    """Courses (S, T, K) as a filter without delay passes them, whose answer has the standard deviation `spread` (S,)
    in samples; the ends are held."""
    if not np.any(spread):
        return course
    K, room = course.shape[-1], 8
    length = next_fast_len(K + 2 * room, real=True)
    while length % 2 == 0:  # an even one has a line at half the rate, which the cut ends turn into a shift
        length = next_fast_len(length + 1, real=True)
    held = np.concatenate(
        (course, course[..., -1:].repeat(length - K - room, -1), course[..., :1].repeat(room, -1)), axis=-1
    )
    omega = 2.0 * np.pi * np.fft.rfftfreq(length)
    passed = np.exp(-0.5 * (omega * spread[:, None]) ** 2)[:, None]
    return np.asarray(np.fft.irfft(np.fft.rfft(held) * passed, length)[..., :K])


@dataclass(frozen=True)
class Scene:
    """Recordings ready to be fitted.

    Attributes
    ----------
    rich : values that the estimator found in the middle of the moves with everything free
    smooth : values of a fit of whole moves with all smooth effects added
    plain : values that the closed form finds, others typical: no model of the machine that lacks something drives them
    coupled : values that the estimator found for two axes that are not declared to be a gantry as if they were one
    heard : frequency of what swings on between the moves [Hz]; none where only noise is heard
    zero_wanders : whether an accelerometer's zero goes its way while the axis rests
    clipped : axes whose accelerometer stays at an end of its range in one of the recordings
    smooth_left : RMS that the fit with all smooth effects leaves, over the noise
    """

    train: tuple[Moves, ...]
    validate: Moves
    declared: Model
    rich: Values
    smooth: Values
    coupled: Values
    heard: float | None = None
    plain: Values = field(default_factory=dict)
    zero_wanders: bool = False
    clipped: tuple[str, ...] = ()
    smooth_left: float = np.inf

    @property
    def places(self) -> tuple[Values, ...]:
        """Where fits are begun."""
        return self.rich, self.smooth, self.plain


def estimator_together(recording: Recording, axes: tuple[str, ...]) -> Values:
    """What the estimator's fit of a gantry finds in the middle part of the moves."""
    return values_of(gantry_fit(measure(recording, axes, range(len(recording.moves))), GANTRY))


def values_of(staged: Staged) -> Values:
    found, model = staged.best.fit, staged.best.problem.model
    return {p.name: found.value(model, p.name) for p in model.parameters}


def estimator_alone(recording: Recording, axis: str) -> Values:
    """One axis as if nothing pulled on it, with two masses between motor and rack."""
    measured = measure(recording, (axis,), range(len(recording.moves)))
    return values_of(staged_fit(measured, Model((axis,), 2), {axis: closed_form(recording, axis)}, BRIEFLY))


def estimated(recording: Recording, axes: tuple[str, ...], gantry: bool) -> tuple[Values, Values]:
    """What the estimator finds by the declared model, and for two axes without a bridge what it finds with one."""
    together = estimator_together(recording, axes) if len(axes) == 2 else {}
    if gantry:
        return together, {}
    alone = {k: v for axis in axes for k, v in lumped(estimator_alone(recording, axis), axis).items()}
    return alone, {k: v for axis in axes for k, v in lumped(together, axis).items()} if together else {}


def in_closed_form(recording: Recording, axes: Sequence[str], lumps: int) -> Values:
    """What the closed form says of the axes, under the names that it has as effects; its springs are alike."""
    out: dict[str, float | None] = {}
    for axis in axes:
        guess = closed_form(recording, axis)
        soft = (len(LINKS[lumps]) + 1) / guess.compliance if guess.compliance else None
        out |= {f"{axis}.{link}_stiffness": soft for link in (*LINKS[lumps], "contact")}
        out |= {
            f"{axis}.backlash": guess.backlash,
            f"{axis}.coulomb": guess.friction,
            f"{axis}.constant_force": guess.constant,
            f"{axis}.latency": None if guess.skew is None else -guess.skew,
        }
    return {name: value for name, value in out.items() if value is not None}


def lumped(rich: Values, axis: str) -> Values:
    """The values with the two masses taken as one, on their springs in series."""
    gear, pinion = (rich[f"{axis}.{link}_stiffness"] for link in ("gear", "pinion"))
    damping = 0.5 * (rich[f"{axis}.gear_damping_ratio"] + rich[f"{axis}.pinion_damping_ratio"])
    return {
        **rich,
        f"{axis}.drive_stiffness": gear * pinion / (gear + pinion),
        f"{axis}.drive_damping_ratio": damping,
        f"{axis}.drive_mass": rich[f"{axis}.gear_mass"] + rich[f"{axis}.pinion_mass"],
    }


def as_effects(rich: Values, axes: Sequence[str]) -> Values:
    """The estimator's free skew and constant force under the names that they have as effects."""
    named = {f"{a}.latency": -rich[f"{a}.skew"] for a in axes}
    return {**rich, **named, **{f"{a}.constant_force": rich[f"{a}.constant"] for a in axes}}


def smooth_fit(
    train: Sequence[Moves], declared: Model, rich: Values, library: Sequence[type[DrivenEffect]]
) -> Fitted:
    """The declared model with all smooth effects at once: few numbers of it are right, but none is in a corner.

    The motors' motion is first reconstructed from where the estimator ended: a fit of the plain one takes the error of
    its input for a chain with other masses. A few moves tell nearly as well as all; where it leaves much of these, all
    tell no more.
    """
    added = tuple(kind(declared.axes) for kind in library if kind.name not in NOT_SMOOTH)
    model = replace(declared, effects=(*declared.effects, *added))
    at = point_at(model, rich, train)
    few = [some_of(part, OF_SMOOTH) for part in train]
    own = tuple(local[few_of(part, OF_SMOOTH)] for part, local in zip(train, at.local, strict=True))
    near = resettled(few, model, replace(at, local=own))
    near = fit(near.moves, model, near.at, ROUNDS // 2)
    near = near if near.rms >= MUCH else fit(near.moves, model, near.at, ROUNDS // 2)
    found = resettled(train, model, replace(near.at, local=at.local))
    return found if near.rms >= MUCH else fit(found.moves, model, found.at, ROUNDS // 2)


def declared_fits(scene: Scene) -> Iterator[Fitted]:
    """Fits of the declared model to all moves of all train recordings, from each of the places: the nearest after a few
    rounds comes first, and each is only continued when it is asked for."""
    begun = [
        begun_anew(
            fit(scene.train, scene.declared, point_at(scene.declared, place, scene.train), FIRST_ROUNDS)
        )
        for place in scene.places
    ]
    for first in sorted(begun, key=lambda f: f.rms):
        yield fit(scene.train, scene.declared, first.at, ROUNDS - FIRST_ROUNDS)


def scene_of(
    train: Sequence[Recording],
    validate: Recording,
    axes: tuple[str, ...],
    gantry: bool,
    library: Sequence[type[DrivenEffect]],
) -> Scene:
    """Grids of all recordings, the places to start from, and the errors that are expected."""
    lumps = 2 if len(axes) == 1 or gantry else 1
    rich, coupled = estimated(train[0], axes, gantry)
    places = as_effects(rich, axes)
    own = (ChannelTolerance(axes), MotorWander(axes)) if gantry else (ChannelTolerance(axes),)
    declared = Model(axes, lumps, own, "whole_move", HELD, bridge=gantry)
    before, last = [moves_of(r, axes, TAIL) for r in train], moves_of(validate, axes, averaged=True)
    if gantry:
        *before, last = to_one_zero((*before, last), declared, places)
    smooth = smooth_fit(before, declared, places, library)
    if gantry:
        zero = bridge_zero(last, smooth.model, smooth.at.shared, np.zeros(1))
        last = moved_to(last, zero, smooth.value("bridge_offset"))
    before = [with_expected_errors(part, smooth, fitted=True) for part in smooth.moves]
    last = with_expected_errors(last, smooth, fitted=False)
    heard = heard_at_rest(train[0], axes)
    *before, last = (as_heard_before(part, heard) for part in (*before, last))
    plain = in_closed_form(train[0], axes, lumps)
    wanders = any(zero_wanders(recording, axes) for recording in train)
    cut_off = tuple(a for a in axes if any(clipped(r.traces[a, "acceleration"]) for r in (*train, validate)))
    return Scene(
        tuple(before),
        last,
        declared,
        places,
        values_at(smooth),
        coupled,
        heard,
        plain,
        wanders,
        cut_off,
        smooth.rms,
    )


def as_heard_before(moves: Moves, frequency: float | None) -> Moves:
    """The moves with what is heard so fast [Hz] in the rests before them: a body under the axes carries them along,
    while what hangs on a carriage that friction holds is not heard there."""
    if frequency is None:
        return moves
    swinging = swings_before(moves.recording, moves.axes, frequency, moves.start)
    return replace(moves, heard={p.name: s for p, s in zip(at_rest("body"), swinging.T, strict=True)})


def to_one_zero(recordings: Sequence[Moves], model: Model, place: Values) -> list[Moves]:
    """The recordings of a gantry with the bridge's zero of the first, by the machine at a place."""
    shared = point_at(model, place, recordings[:1]).shared
    zeros = [bridge_zero(part, model, shared) for part in recordings]
    return [moved_to(part, zero, zeros[0]) for part, zero in zip(recordings, zeros, strict=True)]
