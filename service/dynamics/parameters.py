"""What an axis, its controller and a gantry are made of (paper section II, eqs. (1)-(9)).

Every part is given as a data sheet gives it: inertias, stiffnesses and frictions of rotating parts at
their own shaft. The physics refers them to the output side: a quantity at the motor shaft is divided by
transmission² (transmission D_p/(2i) in m/rad), one at the pinion shaft by (D_p/2)². The gearbox's
inertia J_g counts at its input shaft, as in eq. (2).

The defaults are those of a laser cutting machine's bridge axis, chosen: plausible, not measured on one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

_TOOTH_PITCH_SHARE = 0.1


def _require(condition: bool, owner: Any, name: str, rule: str) -> None:
    if not condition:
        raise ValueError(f"{type(owner).__name__}.{name} must be {rule}, got {getattr(owner, name)!r}")


def _require_positive(owner: Any, *names: str) -> None:
    for name in names:
        value = getattr(owner, name)
        _require(isfinite(value) and value > 0, owner, name, "a positive number")


def _require_not_negative(owner: Any, *names: str) -> None:
    for name in names:
        value = getattr(owner, name)
        _require(isfinite(value) and value >= 0, owner, name, "a number not below zero")


@dataclass(frozen=True)
class Friction:
    """Friction at one body: Coulomb level and viscous coefficient, [N m], [N m s/rad] or [N], [N s/m]."""

    coulomb: float = 0.0
    viscous: float = 0.0

    def __post_init__(self) -> None:
        _require_not_negative(self, "coulomb", "viscous")


@dataclass(frozen=True)
class ControllerParameters:
    """PPI cascade on the motor encoder; all values at the motor shaft.

    Attributes
    ----------
    Kv : gain of the position loop, P [1/s]
    Kp : gain of the speed loop [N m s/rad]
    Tn : reset time of the speed loop [s]
    current_loop_time : time constant of the current loop [s], first order
    torque_limit : [N m]
    speed_feedforward : share of the setpoint's speed fed to the speed loop, 0 to 1
    inertia_feedforward : torque per setpoint's acceleration [N m s²/rad]
    """

    Kv: float
    Kp: float
    Tn: float = 0.02
    current_loop_time: float = 5e-4
    torque_limit: float = 40.0
    speed_feedforward: float = 1.0
    inertia_feedforward: float = 0.0

    def __post_init__(self) -> None:
        _require_positive(self, "Kv", "Kp", "Tn", "current_loop_time", "torque_limit")
        _require(0 <= self.speed_feedforward <= 1, self, "speed_feedforward", "between 0 and 1")
        _require_not_negative(self, "inertia_feedforward")


@dataclass(frozen=True)
class AxisParameters:
    """One rack-and-pinion axis: motor, gearbox, pinion, carriage (eqs. (1)-(7)).

    Attributes
    ----------
    J_mot, J_g : inertias of motor and gearbox at the motor shaft [kg m²]
    J_p : inertia of pinion and gearbox output at the pinion shaft [kg m²]
    i : gear ratio
    D_p : pinion diameter [m]
    k_mg, d_mg : stiffness [N m/rad] and damping [N m s/rad] between motor and gearbox, motor shaft
    k_gp, d_gp : the same between gearbox and pinion, pinion shaft
    k_p, d_p : stiffness [N/m] and damping [N s/m] of the flank contact, eq. (5)
    b : backlash, UL − LL [m]
    UL : distance to the upper flank in the initial position [m], 0 <= UL <= b; None: the pinion tooth
        starts centred, UL = b/2
    M : moved mass [kg]
    friction_mot, friction_g : at the motor shaft
    friction_p : at the pinion shaft
    friction_mas : of the guide, at the carriage
    brake_torque : with which the motor's holding brake holds it, where it is closed [N m]
    controller : None: ``tuned_controller`` of this axis
    """

    J_mot: float = 2.0e-3
    J_g: float = 2.0e-4
    J_p: float = 3.0e-3
    i: float = 10.0
    D_p: float = 0.06
    k_mg: float = 3.0e3
    d_mg: float = 0.3
    k_gp: float = 1.4e5
    d_gp: float = 14.0
    k_p: float = 2.0e8
    d_p: float = 2.0e4
    b: float = 50e-6
    UL: float | None = None
    M: float = 400.0
    friction_mot: Friction = Friction(coulomb=0.10, viscous=5e-4)
    friction_g: Friction = Friction(coulomb=0.10, viscous=1e-3)
    friction_p: Friction = Friction(coulomb=0.3, viscous=0.0)
    friction_mas: Friction = Friction(coulomb=120.0, viscous=300.0)
    brake_torque: float = 20.0
    controller: ControllerParameters | None = None

    def __post_init__(self) -> None:
        _require_positive(self, "J_mot", "J_g", "J_p", "i", "D_p", "k_mg", "k_gp", "k_p", "M")
        _require_not_negative(self, "d_mg", "d_gp", "d_p", "b", "brake_torque")
        # A gap of a tenth of the pinion's diameter is a missing tooth, or micrometres given as metres.
        limit = _TOOTH_PITCH_SHARE * self.D_p
        _require(self.b < limit, self, "b", f"below {limit:g} m (a backlash, in metres)")
        if self.UL is not None:
            _require(0 <= self.UL <= self.b, self, "UL", f"between 0 and b = {self.b:g} m")

    @property
    def transmission(self) -> float:
        """Output per radian of motor, D_p/(2i) [m/rad]."""
        return self.D_p / (2 * self.i)

    @property
    def upper_limit(self) -> float:
        """UL of eq. (6) [m], never negative."""
        return self.b / 2 if self.UL is None else self.UL

    @property
    def lower_limit(self) -> float:
        """LL of eq. (6) [m], never positive."""
        return self.upper_limit - self.b

    @property
    def inertia(self) -> float:
        """Inertia of the whole axis at the motor shaft [kg m²]."""
        return self.J_mot + self.J_g + self.J_p / self.i**2 + self.M * self.transmission**2

    @property
    def ppi(self) -> ControllerParameters:
        """The controller: the given one, or the tuned one."""
        return self.controller or tuned_controller(self)


def tuned_controller(axis: AxisParameters, bandwidth: float = 250.0) -> ControllerParameters:
    """Return a cascade for the axis by the usual ratios between its loops.

    Parameters
    ----------
    axis : the axis whose inertia is controlled
    bandwidth : of the speed loop [rad/s], chosen: well below the first natural frequency of a large machine

    Notes
    -----
    Kp = bandwidth·inertia, Tn = 4/bandwidth, Kv = bandwidth/4: each outer loop is four times slower than the
    inner one. The inertia is fed forward: the loops alone are too slow for a step of 86 ms, and would
    overshoot. The torque limit is twice what 10 m/s² needs.
    """
    return ControllerParameters(
        Kv=bandwidth / 4,
        Kp=bandwidth * axis.inertia,
        Tn=4 / bandwidth,
        inertia_feedforward=axis.inertia,
        torque_limit=2 * 10.0 * axis.inertia / axis.transmission,
    )


@dataclass(frozen=True)
class GantryParameters:
    """A bridge that two axes move together: the coupling f(ẍ_m1 …) of eq. (9).

    The bridge's own mass is shared out to the two carriages' M.

    Attributes
    ----------
    first, second : names of the two axes
    k, d : stiffness [N/m] and damping [N s/m] of the bridge between the carriages
    offset : x_first − x_second at which the bridge is free of stress [m]: the difference of the two axes'
        zero positions. It makes the axes pull at each other at rest.
    """

    first: str
    second: str
    k: float = 2.0e7
    d: float = 2.0e4
    offset: float = 0.0

    def __post_init__(self) -> None:
        _require_positive(self, "k")
        _require_not_negative(self, "d")
        _require(isfinite(self.offset), self, "offset", "finite")
        _require(self.first != self.second, self, "second", "another axis than the first")


@dataclass(frozen=True)
class Machine:
    """Axes by name, and which pairs of them move one bridge. An axis belongs to one gantry at most."""

    axes: Mapping[str, AxisParameters]
    gantries: tuple[GantryParameters, ...] = field(default=())

    def __post_init__(self) -> None:
        if not self.axes:
            raise ValueError("a machine needs at least one axis")
        members = [name for pair in self.gantries for name in (pair.first, pair.second)]
        for name in members:
            if name not in self.axes:
                raise ValueError(f"gantry names axis {name!r}, the machine has {', '.join(self.axes)}")
            if members.count(name) > 1:
                raise ValueError(f"axis {name!r} belongs to more than one gantry")
