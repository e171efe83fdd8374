"""The machine in motion: ``simulate`` a plan of moves, or advance a ``Plant`` block by block."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.dynamics.assembly import Coupled, Effects, Setpoint, assemble
from service.dynamics.effects.effect import Measured
from service.dynamics.parameters import AxisParameters, Machine
from service.dynamics.propagation import ContactChange
from service.dynamics.trajectory import jerk_limited_step
from service.recording import Move

FloatArray = NDArray[np.float64]

DT = 1.25e-4
"""Sub-step [s]: 8 kHz, the rate at which drives close their speed loop (chosen)."""

_NO_A_LIMIT, _NO_V_LIMIT = 1e3, 1e2  # beyond any machine: the step is then limited by its jerk alone


@dataclass(frozen=True)
class _Nominal:
    """Set-points of ``simulate``."""

    position: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    enabled: bool = True
    braked: bool = False


class GapCrossing(NamedTuple):
    """The pinion left flank ``before`` (±1) for good at t1 and met the opposite one at t2 [s].

    The flanks part when the contact force between them is zero.
    """

    t1: float
    t2: float
    before: int


class Plant:
    """A machine at rest, all motors at 0, to be advanced block by block; fits ``drivers.sim``'s physics.

    Parameters
    ----------
    machine : its axes; a single ``AxisParameters`` is a machine with the axis X1
    effects : by axis, what the paper's model lacks
    dt : sub-step [s]
    """

    def __init__(
        self, machine: Machine | AxisParameters, effects: Effects | None = None, dt: float = DT
    ) -> None:
        if isinstance(machine, AxisParameters):
            machine = Machine({"X1": machine})
        self.axes: tuple[str, ...] = tuple(machine.axes)
        self.dt = dt
        self._check(effects or {})
        self._parts: list[Coupled] = assemble(machine, effects or {}, dt)

    def advance(self, duration: float, setpoints: Sequence[Setpoint]) -> list[Measured]:
        """Move on by ``duration`` [s], a whole number n of sub-steps, under one set-point per axis.

        Parameters
        ----------
        setpoints : in the order of ``axes``; one with ``enabled`` False gives no torque, the axis coasts;
            one with ``braked`` True has its motor held

        Returns
        -------
        what each axis' sensors say, at the ends of the n sub-steps
        """
        n = round(duration / self.dt)
        if len(setpoints) != len(self.axes):
            raise ValueError(f"{len(self.axes)} axes need as many set-points, got {len(setpoints)}")
        if n < 1 or abs(n * self.dt - duration) > 1e-6 * self.dt * n:
            raise ValueError(f"duration must be a whole number of sub-steps {self.dt:g} s, got {duration!r}")
        by_axis = dict(zip(self.axes, setpoints, strict=True))
        measured: dict[str, Measured] = {}
        for part in self._parts:
            measured |= part.advance(n, by_axis)
        return [measured[axis] for axis in self.axes]

    def switch_effects(self, effects: Effects) -> None:
        """Go on with these effects, by axis, instead of those before: a machine that changes overnight.

        To be called at standstill, since speeds are set to zero.
        """
        self._check(effects)
        for part in self._parts:
            part.switch_effects(effects)

    def _check(self, effects: Effects) -> None:
        unknown = set(effects) - set(self.axes)
        if unknown:
            raise ValueError(f"effects for {sorted(unknown)}, the machine has {', '.join(self.axes)}")

    def crossings(self, axis: str) -> tuple[GapCrossing, ...]:
        """Every crossing of the axis' gap so far: the truth that an estimate is compared with."""
        part = next(part for part in self._parts if axis in part.axes)
        return gap_crossings([c for c in part.changes if c.contact == axis])


def gap_crossings(changes: Sequence[ContactChange]) -> tuple[GapCrossing, ...]:
    """Pair each first touch of the other flank with the last release before it."""
    found: list[GapCrossing] = []
    t1, before = 0.0, 0
    for change in changes:
        if change.after == 0:
            t1, before = change.time, change.before
            continue
        if change.after == -before:
            found.append(GapCrossing(t1, change.time, before))
        before = 0
    return tuple(found)


@dataclass(frozen=True)
class SimulatedAxis:
    """What one axis did: ``measured`` by its sensors, and when its gap was crossed."""

    measured: Measured
    crossings: tuple[GapCrossing, ...]

    def diagnostic_crossing(self, move: Move) -> GapCrossing | None:
        """The crossing in the move's second half, from accelerating to braking flank, if there is one."""
        later = move.start + move.duration / 2
        passes = [c for c in self.crossings if c.before == move.direction and later < c.t2 <= move.end]
        return passes[0] if passes else None


@dataclass(frozen=True)
class Simulation:
    """A simulated run: the common ``time`` (n,) [s] of all channels, and each axis by name."""

    time: FloatArray
    moves: tuple[Move, ...]
    axes: Mapping[str, SimulatedAxis]


def ten_steps(
    length: float = 4e-3, jerk: float = 200.0, rest: float = 0.35, count: int = 10
) -> tuple[Move, ...]:
    """Return the paper's experiment: ``count`` steps to and fro, each after ``rest`` [s] of standstill.

    ``length`` is SL [m], ``jerk`` j_lim [m/s³]; acceleration and speed are not limited.
    """
    duration = jerk_limited_step(length, jerk, _NO_A_LIMIT, _NO_V_LIMIT).duration
    period = rest + duration
    return tuple(
        Move(rest + k * period, 1 if k % 2 == 0 else -1, length, jerk, duration) for k in range(count)
    )


def simulate(
    machine: Machine | AxisParameters,
    moves: Sequence[Move],
    effects: Effects | None = None,
    *,
    rest: float = 0.35,
    dt: float = DT,
    a_lim: float = _NO_A_LIMIT,
    v_lim: float = _NO_V_LIMIT,
) -> Simulation:
    """Let every axis of the machine make the moves, from standstill, and ``rest`` [s] after the last one.

    Parameters
    ----------
    moves : in order of time, not overlapping
    effects : by axis, what the paper's model lacks
    a_lim, v_lim : limits of the trajectory [m/s²], [m/s]
    """
    if not moves:
        raise ValueError("a simulation needs at least one move")
    plant = Plant(machine, effects, dt)
    parameters = machine.axes if isinstance(machine, Machine) else {"X1": machine}
    n = int(np.ceil((moves[-1].end + rest) / dt))
    time = dt * np.arange(1, n + 1, dtype=np.float64)
    x, v, a = nominal_motion(time, moves, a_lim, v_lim)
    radians = [1 / p.transmission for p in parameters.values()]
    setpoints = [_Nominal(x * r, v * r, a * r) for r in radians]
    measured = plant.advance(n * dt, setpoints)
    axes = {
        name: SimulatedAxis(data, plant.crossings(name))
        for name, data in zip(plant.axes, measured, strict=True)
    }
    return Simulation(time, tuple(moves), axes)


def nominal_motion(
    time: FloatArray, moves: Sequence[Move], a_lim: float = _NO_A_LIMIT, v_lim: float = _NO_V_LIMIT
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Commanded position [m], speed [m/s] and acceleration [m/s²] at ``time`` (n,) [s], from position 0."""
    x, v, a = np.zeros((3, len(time)))
    for move in moves:
        step = jerk_limited_step(move.length, move.jerk, a_lim, v_lim)
        x += move.direction * step.position(time - move.start)
        v += move.direction * step.speed(time - move.start)
        a += move.direction * step.acceleration(time - move.start)
    return x, v, a
