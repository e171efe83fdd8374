"""The library of effects that an axis with diagnostic moves may show, in the load acceleration channel.

Each effect is one small declaration: its parameters with unit, the dose at which its score is taken and the
starts from which it is refitted, and the law by which it enters one stage of the simulation
(``axis_simulation``). All forces are per moved mass [m/s²]; P maps parameter names to (L, A) arrays, one row
per lane and one column per axis.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from service.recording import FloatArray

Values = Mapping[str, FloatArray]
Stage = Literal["motor", "stretch", "gap", "contact", "friction", "force", "body", "hung", "bridge", "sensor"]
Law = Callable[[Values, FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of an effect.

    Attributes
    ----------
    dose : the amount at which its score is taken and by which the fit's steps are scaled, in ``unit``
    starts : values from which the refit may start; the first is the one that leaves the model as it was
        where the effect has several parameters
    logarithmic : fitted by its logarithm (it is positive and known only by its order of magnitude)
    shared : one value for all axes of the machine
    """

    name: str
    unit: str
    dose: float
    starts: tuple[float, ...]
    bounds: tuple[float, float]
    logarithmic: bool = False
    shared: bool = False


@dataclass(frozen=True)
class AxisEffect:
    """An effect: its identifier, where in the simulation it acts, its parameters and its law.

    ``means`` says in a technician's words what it is.
    """

    name: str
    stage: Stage
    parameters: tuple[EffectParameter, ...]
    law: Law | None
    means: str


def _stribeck(P: Values, v: FloatArray, s: FloatArray) -> FloatArray:
    return P["breakaway"] * np.exp(-((v / P["stribeck_speed"]) ** 2)) * s


def _asymmetric(P: Values, v: FloatArray, s: FloatArray) -> FloatArray:
    return P["coulomb_asymmetry"] * np.abs(s) + P["viscous_asymmetry"] * np.abs(v)


def _curved(P: Values, v: FloatArray, s: FloatArray) -> FloatArray:
    return P["quadratic_friction"] * v * np.abs(v)


def _constant(P: Values, x: FloatArray, v: FloatArray) -> FloatArray:
    return P["constant_force"]


def _spring(P: Values, x: FloatArray, v: FloatArray) -> FloatArray:
    return -P["spring_rate"] * x


def _local_gap(P: Values, x: FloatArray, v: FloatArray) -> FloatArray:
    return P["gap_slope"] * x


def _hardening(P: Values, pen: FloatArray, v: FloatArray) -> FloatArray:
    return 1.0 + P["hardening"] * np.abs(pen)


def _filter(P: Values, x: FloatArray, v: FloatArray) -> FloatArray:
    return P["filter_time"] * v


def _ripple(P: Values, x: FloatArray, v: FloatArray) -> FloatArray:
    angle = 2.0 * np.pi * x / P["ripple_period"]
    return P["ripple_sine"] * np.sin(angle) + P["ripple_cosine"] * (np.cos(angle) - 1.0)


def _one(
    name: str, unit: str, dose: float, bounds: tuple[float, float], starts: tuple[float, ...] = (0.0,)
) -> EffectParameter:
    return EffectParameter(name, unit, dose, starts, bounds)


def _mode(prefix: str, lowest: float, highest: float, shared: bool) -> tuple[EffectParameter, ...]:
    frequencies = tuple(np.geomspace(lowest, highest, 9))
    return (
        EffectParameter(f"{prefix}_ratio", "1", 0.02, (0.01,), (0.0, 3.0), shared=shared),
        EffectParameter(f"{prefix}_frequency", "Hz", 0.05, frequencies, (2.0, 250.0), True, shared),
        EffectParameter(f"{prefix}_damping", "1", 0.3, (0.02,), (1e-4, 0.5), True, shared),
    )


def axis_effects() -> tuple[AxisEffect, ...]:
    """All effects that are tried on one axis; ``gantry_coupling`` is tried where two axes move one bridge."""
    return (
        AxisEffect("sensor_latency", "sensor", (_one("latency", "s", 1e-4, (-8e-3, 8e-3)),), None,
                   "the accelerometer's samples are late against the drive's"),
        AxisEffect("sensor_gain", "sensor", (_one("gain_error", "1", 0.02, (-0.6, 0.6)),), None,
                   "the accelerometer's scale is wrong, or it is mounted askew"),
        AxisEffect("sensor_bias", "sensor", (_one("bias", "m/s^2", 0.02, (-5.0, 5.0)),), None,
                   "the accelerometer reads an offset"),
        AxisEffect("constant_force", "force", (_one("constant_force", "m/s^2", 0.05, (-5.0, 5.0)),), _constant,
                   "a force pulls one way: gravity on a tilted axis, a counterweight"),
        AxisEffect("asymmetric_friction", "friction",
                   (_one("coulomb_asymmetry", "m/s^2", 0.05, (-3.0, 3.0)),
                    _one("viscous_asymmetry", "1/s", 0.5, (-20.0, 20.0))), _asymmetric,
                   "friction differs between the two directions: guide or seal damaged on one side"),
        AxisEffect("stribeck_friction", "friction",
                   (EffectParameter("breakaway", "m/s^2", 0.05, (0.05,), (-1.0, 10.0)),
                    EffectParameter("stribeck_speed", "m/s", 0.3, (0.006, 0.015, 0.04), (1e-3, 0.2), True)),
                   _stribeck, "friction is higher at low speed: lubrication is poor"),
        AxisEffect("curved_friction", "friction", (_one("quadratic_friction", "1/m", 5.0, (-200.0, 200.0)),),
                   _curved, "friction does not grow in proportion to the speed"),
        AxisEffect("position_dependent_force", "force", (_one("spring_rate", "1/s^2", 20.0, (-5e3, 5e3)),),
                   _spring, "a force grows along the travel: cable chain, cover, spring"),
        AxisEffect("position_dependent_backlash", "gap", (_one("gap_slope", "1", 1e-3, (-0.2, 0.2)),), _local_gap,
                   "the backlash changes along the travel: local wear, pinion runout"),
        AxisEffect("gearbox_clearance", "stretch",
                   (EffectParameter("clearance", "m", 2e-6, (5e-6, 3e-5), (0.0, 3e-4)),), None,
                   "there is a second gap in series, in the gearbox or a coupling"),
        AxisEffect("contact_nonlinearity", "contact", (_one("hardening", "1/m", 3e3, (-1e5, 1e6)),), _hardening,
                   "the tooth contact stiffens with load"),
        AxisEffect("speed_filter", "motor", (_one("filter_time", "s", 1e-4, (-2e-3, 1e-2)),), _filter,
                   "the drive filters its speed value before it sends it"),
        AxisEffect("transmission_ripple", "motor",
                   (EffectParameter("ripple_sine", "m", 1e-6, (0.0,), (-1e-3, 1e-3)),
                    EffectParameter("ripple_cosine", "m", 1e-6, (0.0,), (-1e-3, 1e-3)),
                    EffectParameter("ripple_period", "m", 0.02, tuple(np.geomspace(4e-4, 8e-3, 14)), (2e-4, 2e-2),
                                    True)),
                   _ripple, "the transmission's error repeats along the travel: teeth, bearing, gearbox"),
        AxisEffect("machine_body_mode", "body", _mode("body", 6.0, 60.0, True), None,
                   "the machine's body swings on its feet and the axis excites it"),
        AxisEffect("hung_mass_mode", "hung", _mode("hung", 6.0, 120.0, False), None,
                   "an elastically hung mass on the carriage swings"),
    )  # fmt: skip


def gantry_coupling() -> AxisEffect:
    """f of eq. (9) for a bridge: spring and damper between the carriages, relaxed at an offset."""
    return AxisEffect(
        "gantry_coupling",
        "bridge",
        (
            EffectParameter("bridge_stiffness", "1/s^2", 0.3, (2e3, 1e4, 5e4, 2e5), (1e2, 1e7), True, True),
            EffectParameter("bridge_damping", "1/s", 5.0, (20.0,), (0.0, 1e4), False, True),
            EffectParameter("bridge_offset", "m", 1e-5, (0.0,), (-5e-4, 5e-4), False, True),
        ),
        None,
        "the two sides of the gantry pull on each other through the bridge",
    )
