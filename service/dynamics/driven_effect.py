"""What an effect on the driven model is: a small class that declares its parameters and adds what the model lacks.

Simulating calls an effect's hooks in this order: `restate`, `drive`, `follow`, `carry`, `assemble`, `begin`,
`measure`; `swinging`, `carried` and `swung` say how the step after it begins. What an effect does not override leaves
the model as it is. With all its amounts at 0 an effect is absent.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from service.dynamics.driven_parameters import Parameter, Structure, Values
from service.dynamics.driven_propagation import LinearSystem
from service.recording import FloatArray

HELD_WIDER = 2.0
"""How much wider than other numbers those are varied, in logarithms, that hold what lies loose (chosen: the friction of
a pinion's bearings differs more from machine to machine than a mass, and no fit finds it; of three searches on one with
two gaps none found its valley with 1, and all with 2 and with 3)."""


@dataclass(frozen=True)
class Case:
    """What is simulated, as one effect sees it; S parameter sets, T steps.

    Attributes
    ----------
    model : where the states lie
    values : (S,) each
    nuisance : (S, T, len(effect.nuisance)) the effect's own coordinates of every step, in their units
    s : (T,) directions
    start : (T,) time of the first grid point [s] since the recording began
    h : grid interval [s]
    c : (S, T, K, X, J) motion of the motors as it drives the chain; known once every effect's `drive` was called
    """

    model: Structure
    values: Values
    nuisance: FloatArray
    s: FloatArray
    start: FloatArray
    h: float
    c: FloatArray | None = None


@dataclass(frozen=True)
class Room:
    """Where an effect's own states, gaps and input motions begin."""

    state: int
    gap: int
    motion: int


@dataclass(frozen=True)
class DrivenEffect:
    """One effect that the declared model lacks, on the `axes` that it is tried on.

    Attributes
    ----------
    name : identifier in the library
    means : what it is, in a technician's words
    own, shared : parameters of each axis, and of all axes together. Amounts (with a `dose`) are linear, 0 means that
        the effect is absent; the others shape it
    own_nuisance, shared_nuisance : the same for what is found anew in every step; 0 is its likeliest value
    shapes : where a score is taken and a fit started: values of `own` and `shared` by name, others at typical
    states : how many states it adds, positions each followed by its speed; they start at zero
    gaps : how many gaps it adds; motions : how many input motions; curves : how many forces given as curves
    bends_friction : it adds to a guide's tabulated friction
    many_valleys : its fits end in many places: no score ranks its shapes, and fits begin where its numbers are `varied`
    held : numbers of `own` that hold a body which lies loose: by steps they decide where it is met, and no slope leads
        from one such valley to another
    exact : its law has no form that may be another in the machine: it leaves nothing where it is what acts
    contains : effects that it becomes when some of its amounts are zero
    own_errors : the noise of the drives' speeds does something else with it, so that what its fits are expected to miss
        is found by it: it undoes a low pass, or ties two motors together
    nearly : effects whose law is the same but for what little of a recording tells, such as quick motion
    inside : numbers of which no such effect has one at a limit, however well it describes the moves there
    free_swing : of an effect that swings on while the axis rests the parameter that is its frequency, how strong it is
        where it is heard then (values of `own` or `shared` by name), and its frequency over the one that is heard
    """

    axes: tuple[str, ...]

    name: ClassVar[str]
    means: ClassVar[str]
    own: ClassVar[tuple[Parameter, ...]] = ()
    shared: ClassVar[tuple[Parameter, ...]] = ()
    own_nuisance: ClassVar[tuple[Parameter, ...]] = ()
    shared_nuisance: ClassVar[tuple[Parameter, ...]] = ()
    shapes: ClassVar[tuple[Mapping[str, float], ...]] = ({},)
    bends_friction: ClassVar[bool] = False
    many_valleys: ClassVar[bool] = False
    held: ClassVar[tuple[str, ...]] = ()
    exact: ClassVar[bool] = False
    own_errors: ClassVar[bool] = False
    contains: ClassVar[tuple[str, ...]] = ()
    nearly: ClassVar[tuple[str, ...]] = ()
    inside: ClassVar[tuple[str, ...]] = ()
    free_swing: ClassVar[tuple[str, Mapping[str, float], float] | None] = None

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All its parameters; an axis' carry its name in front, `X1.gain_error`."""
        return (*(p.of(axis) for axis in self.axes for p in self.own), *self.shared)

    @cached_property
    def nuisance(self) -> tuple[Parameter, ...]:
        """Its coordinates of every step: an axis' own first."""
        return (*(p.of(axis) for axis in self.axes for p in self.own_nuisance), *self.shared_nuisance)

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """Values by full name at which a score is taken and a fit started; amounts are 0 there."""
        return tuple(
            {
                p.name: shape.get(p.name.rpartition(".")[2], 0.0 if p.dose else p.typical)
                for p in self.parameters
            }
            for shape in self.shapes
        )

    def traded(self, values: Mapping[str, float]) -> Mapping[str, float]:
        """Values of a whole model at a start, with what the effect takes over from the declared model taken off."""
        return values

    def divided(self, values: Mapping[str, float], share: float) -> Mapping[str, float]:
        """Values of a whole model with such a share of what the effect has in common with the declared model its
        own."""
        return values

    def varied(
        self, values: Mapping[str, float], wide: float, rng: np.random.Generator
    ) -> Mapping[str, float]:
        """Values of a whole model at random about these, `wide` in their logarithms, in what decides in which of many
        valleys a fit ends."""
        return values

    def instead(self, values: Mapping[str, float]) -> Mapping[str, float]:
        """Its own parameters such that it does what effects with these values do; none where it is like none of
        them."""
        return {}

    def imitating(self, values: Mapping[str, float]) -> Iterator[Mapping[str, float]]:
        """Its own parameters, and those of the declared model that go with them, such that it does nearly what another
        effect with these values does, in each of its shapes; nothing where it is like none of them."""
        yield from ()

    def rests(self, values: Mapping[str, float]) -> tuple[Mapping[str, float], ...]:
        """Its coordinates of a step with which an axis may rest, by full name in their units, beside 0."""
        return ()

    def lag(self, values: Mapping[str, float], axis: str) -> float:
        """Time constant [s] by which the speed that an axis' drive reports lags behind its motor's, with values by full
        name."""
        return 0.0

    @property
    def standards(self) -> tuple[DrivenEffect, ...]:
        """The same effect as machine elements make it whose sizes are standardised: each with such a number given."""
        return ()

    @property
    def refined(self) -> DrivenEffect:
        """The same effect as it is simulated for a value, where a search makes do with less."""
        return self

    @property
    def states(self) -> int:
        return 0

    @property
    def gaps(self) -> int:
        return 0

    @property
    def motions(self) -> int:
        return 0

    @property
    def turns(self) -> int:
        """How often its input motions are made anew from the states that they led to."""
        return 0

    @property
    def curves(self) -> int:
        return 0

    def restate(self, values: Values) -> Values:
        """The declared model's parameters as the effect makes them; also called before the skew is looked up."""
        return values

    def drive(self, c: FloatArray, case: Case) -> FloatArray:
        """What moves the chain, from the motors' measured motion, both (S, T, K, X, J)."""
        return c

    def follow(self, c: FloatArray, case: Case, states: FloatArray | None = None) -> FloatArray:
        """Its own input motions (S, T, K, motions, J) from those of the motors (S, T, K, X, J), and from the states
        (S, T, K + 1, n) that were simulated with those before."""
        return c[:, :, :, :0]

    def wider(self, place: FloatArray, case: Case) -> FloatArray:
        """How much wider than declared the gaps are [m] where the loads are, both (S, T, X)."""
        return np.zeros_like(place)

    def carry(self, system: LinearSystem, case: Case, room: Room) -> None:
        """Add bodies that carry racks and guides: called before any effect's `assemble`."""

    def assemble(self, system: LinearSystem, case: Case, room: Room) -> None:
        """Add to the matrices and to the guides' friction in place."""

    def begin(self, x0: FloatArray, case: Case, room: Room) -> None:
        """Set its own states at the first grid point and move the others with them: x0 (S, T, n), in place."""

    def measure(self, predicted: FloatArray, case: Case) -> FloatArray:
        """What the sensors make of the accelerations (S, T, X, K)."""
        return predicted

    def swinging(self, states: FloatArray, case: Case, room: Room) -> Mapping[str, FloatArray]:
        """Those of its own coordinates of a step that begins in these states (S, T, n) that last from one step to the
        next: (S, T) each, in their units."""
        return {}

    def carried(self, states: FloatArray, case: Case, room: Room) -> FloatArray:
        """The states (S, T, n) with what `begin` adds to the loads taken off again."""
        return states

    def swung(
        self, values: Values, begun: Mapping[str, FloatArray], duration: FloatArray
    ) -> Mapping[str, FloatArray]:
        """What becomes of the coordinates of `swinging` (T,) while the axis rests for a time (T,) [s]: (S, T) each."""
        return {}

    def each(self, model: Structure) -> list[tuple[int, str, int]]:
        """Its axes: place among the effect's axes, name, place among the model's."""
        return [(k, axis, model.axes.index(axis)) for k, axis in enumerate(self.axes)]
