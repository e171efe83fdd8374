"""Puts a machine together: which axes are coupled, and each coupled part with its controllers and effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from service.dynamics.axis import axis_mechanism, body
from service.dynamics.controller import PPIController
from service.dynamics.effects.effect import At, Effect, Measured
from service.dynamics.gantry import gantry_mechanism
from service.dynamics.mechanism import Mechanism
from service.dynamics.parameters import AxisParameters, Machine
from service.dynamics.propagation import ContactChange, Propagator

FloatArray = NDArray[np.float64]
Effects = Mapping[str, Sequence[Effect]]


class Setpoint(Protocol):
    """What one drive asks of its motor at the ends of a block's n sub-steps; [rad], [rad/s], [rad/s²]."""

    @property
    def enabled(self) -> bool: ...
    @property
    def position(self) -> FloatArray: ...
    @property
    def speed(self) -> FloatArray: ...
    @property
    def acceleration(self) -> FloatArray: ...
    @property
    def braked(self) -> bool: ...


_NO_TORQUE = 1e-12
"""Torque [N m] that a current which dies away exponentially is set to zero at, before it is a slow tiny number."""


class Coupled:
    """Axes that act on each other, as one mechanism: a single axis, or the two of a gantry."""

    def __init__(
        self, axes: Mapping[str, AxisParameters], mechanism: Mechanism, effects: Effects, dt: float
    ) -> None:
        self.axes = tuple(axes)
        self._parameters = axes
        self._controllers = {name: PPIController(p.ppi, dt) for name, p in axes.items()}
        self._plain = mechanism
        self._propagator = Propagator(with_structure(mechanism, self.axes, effects), dt)
        self._connect(effects)

    def _connect(self, effects: Effects) -> None:
        propagator = self._propagator
        self._servos = [
            _Servo(name, p, self._controllers[name], propagator) for name, p in self._parameters.items()
        ]
        self._sensors = {name: _Sensors(tuple(effects.get(name, ())), propagator.dt) for name in self.axes}
        self._disturbances = [
            _Disturbance(name, tuple(effects[name]), propagator) for name in self.axes if effects.get(name)
        ]

    def switch_effects(self, effects: Effects) -> None:
        """Go on from here, at standstill, with these effects instead of those before."""
        before = self._propagator
        self._propagator = Propagator(with_structure(self._plain, self.axes, effects), before.dt)
        self._propagator.take_over(before)
        self._connect(effects)

    @property
    def changes(self) -> list[ContactChange]:
        """Flank contacts made and lost so far."""
        return self._propagator.changes

    def advance(self, n: int, setpoints: Mapping[str, Setpoint]) -> dict[str, Measured]:
        """Move on by n sub-steps; what the sensors of each axis say."""
        propagator = self._propagator
        states = np.empty((n, propagator.layout.size))
        accelerations = np.empty((n, len(propagator.mechanism.bodies)))
        for servo, axis in zip(self._servos, self.axes, strict=True):
            servo.follow(setpoints[axis])
        for k in range(n):
            for servo in self._servos:
                servo.command(k)
            for disturbance in self._disturbances:
                disturbance.act()
            propagator.step()
            states[k] = propagator.w
            accelerations[k] = propagator.acceleration
        return {
            servo.axis: self._sensors[servo.axis].read(servo.channels(states, accelerations))
            for servo in self._servos
        }


class _Servo:
    """Connects one axis' controller with its motor."""

    def __init__(
        self, axis: str, parameters: AxisParameters, controller: PPIController, propagator: Propagator
    ) -> None:
        self.axis = axis
        self._propagator = propagator
        self._controller = controller
        self._radians = 1 / parameters.transmission
        layout, mechanism = propagator.layout, propagator.mechanism
        drive = [d.axis for d in mechanism.drives].index(axis)
        motor, carriage = mechanism.index(body(axis, "motor")), mechanism.index(body(axis, "carriage"))
        self._q, self._v = layout.q.start + motor, layout.v.start + motor
        self._T, self._command = layout.T.start + drive, layout.command.start + drive
        self._x, self._x_dot, self._carriage = layout.q.start + carriage, layout.v.start + carriage, carriage
        shaft = [sliding.name for sliding in mechanism.slidings].index(body(axis, "motor"))
        self._up, self._down = layout.up.start + shaft, layout.down.start + shaft
        self._friction = mechanism.slidings[shaft].level
        self._brake = parameters.brake_torque / parameters.transmission
        self._enabled = False
        self._setpoints: list[tuple[float, float, float]] = []

    def follow(self, setpoint: Setpoint) -> None:
        """Take over the set-points of a block."""
        self._enabled = setpoint.enabled
        w = self._propagator.w
        w[self._up] = w[self._down] = self._friction + (self._brake if setpoint.braked else 0.0)
        if self._enabled:
            columns = (setpoint.position, setpoint.speed, setpoint.acceleration)
            self._setpoints = list(zip(*(column.tolist() for column in columns), strict=True))
        else:
            self._controller.disable()
            if abs(w.item(self._T)) < _NO_TORQUE:
                w[self._T] = 0.0

    def command(self, k: int) -> None:
        """Set the torque command for the block's sub-step ``k``."""
        w = self._propagator.w
        if not self._enabled:
            w[self._command] = 0.0
            return
        position, speed = w.item(self._q) * self._radians, w.item(self._v) * self._radians
        w[self._command] = self._controller.torque(self._setpoints[k], position, speed)

    def channels(self, states: FloatArray, accelerations: FloatArray) -> Measured:
        """Pick the axis' channels out of a block's states."""
        return Measured(
            motor_position=states[:, self._q] * self._radians,
            motor_speed=states[:, self._v] * self._radians,
            motor_torque=states[:, self._T].copy(),
            load_position=states[:, self._x].copy(),
            load_speed=states[:, self._x_dot].copy(),
            load_acceleration=accelerations[:, self._carriage].copy(),
        )


class _Sensors:
    """Applies the effects on the measurement, with as much of the past as they look back."""

    def __init__(self, effects: Sequence[Effect], dt: float) -> None:
        self._effects = effects
        self._dt = dt
        keep = sum(int(np.ceil(effect.memory / dt)) + 1 for effect in effects if effect.memory > 0)
        self._past = Measured(*np.zeros((len(fields(Measured)), keep)))

    def read(self, new: Measured) -> Measured:
        """What the sensors say of a block's motion."""
        if not self._effects:
            return new
        whole = Measured(*map(np.concatenate, zip(_channels(self._past), _channels(new), strict=True)))
        keep = len(self._past.motor_position)
        self._past = Measured(*(channel[len(channel) - keep :] for channel in _channels(whole)))
        for effect in self._effects:
            whole = effect.measure(whole, self._dt)
        return Measured(*(channel[keep:] for channel in _channels(whole)))


def _channels(measured: Measured) -> list[FloatArray]:
    return [getattr(measured, field.name) for field in fields(Measured)]


class _Disturbance:
    """Applies an axis' effects on forces, friction and flanks, once per sub-step."""

    def __init__(self, axis: str, effects: Sequence[Effect], propagator: Propagator) -> None:
        self._effects = effects
        self._propagator = propagator
        layout, m = propagator.layout, propagator.mechanism
        carriage, pinion = m.index(body(axis, "carriage")), m.index(body(axis, "pinion"))
        gap = [contact.name for contact in m.contacts].index(axis)
        guide = [sliding.name for sliding in m.slidings].index(body(axis, "carriage"))
        self._x, self._v = layout.q.start + carriage, layout.v.start + carriage
        self._x_p, self._v_p = layout.q.start + pinion, layout.v.start + pinion
        self._F, self._F0 = layout.F.start + carriage, float(m.F0[carriage])
        self._up, self._down, self._level = (
            layout.up.start + guide,
            layout.down.start + guide,
            m.slidings[guide].level,
        )
        self._UL, self._LL, self._gap = layout.UL.start + gap, layout.LL.start + gap, m.contacts[gap]
        self._speeds = (0.0, 0.0)

    def act(self) -> None:
        """Write what the effects do into the state, for the middle of the coming sub-step."""
        w, at = self._propagator.w, self._ahead()
        F, up, down, UL, LL = self._F0, self._level, self._level, self._gap.UL, self._gap.LL
        for effect in self._effects:
            F += effect.force(at)
            up, down = effect.friction(up, 1, at), effect.friction(down, -1, at)
            UL, LL = effect.flanks(UL, LL, at)
        w[self._F], w[self._up], w[self._down], w[self._UL], w[self._LL] = F, up, down, UL, LL

    def _ahead(self) -> At:
        """Places and speeds half a sub-step ahead, speeds by their last change."""
        w, half = self._propagator.w, self._propagator.dt / 2
        v, v_p = w.item(self._v), w.item(self._v_p)
        v_before, v_p_before = self._speeds
        self._speeds = (v, v_p)
        x, x_p = w.item(self._x) + half * v, w.item(self._x_p) + half * v_p
        return At(x, v + (v - v_before) / 2, x_p, v_p + (v_p - v_p_before) / 2)


def assemble(machine: Machine, effects: Effects, dt: float) -> list[Coupled]:
    """Return the machine's coupled parts: each gantry, then each axis that belongs to none."""
    parts = []
    for pair in machine.gantries:
        axes = {name: machine.axes[name] for name in (pair.first, pair.second)}
        parts.append(Coupled(axes, gantry_mechanism(pair, *axes.values()), effects, dt))
    paired = {name for pair in machine.gantries for name in (pair.first, pair.second)}
    for name, p in machine.axes.items():
        if name not in paired:
            parts.append(Coupled({name: p}, axis_mechanism(name, p), effects, dt))
    return parts


def with_structure(mechanism: Mechanism, axes: Sequence[str], effects: Effects) -> Mechanism:
    """Add the bodies and springs of all effects; equal effects on several axes are one, with all of them."""
    touched: dict[int, tuple[Effect, list[str]]] = {}
    for axis in axes:
        for effect in effects.get(axis, ()):
            same = next((k for k, (other, _) in touched.items() if other == effect), len(touched))
            touched.setdefault(same, (effect, []))[1].append(axis)
    for effect, affected in touched.values():
        mechanism = effect.structure(mechanism, tuple(affected))
    return mechanism
