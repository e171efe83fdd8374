"""What the drive and the accelerometer report of a lane: rates, noise, digits, lost frames, planted faults.

Everything linear between the load and the accelerometer's converter is done on the load's *speed*, whose difference
over a sample interval is the mean acceleration that the sensor delivers.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import cont2discrete, lfilter

from tests.undeclared.machine import TICK, Traces

Array = NDArray[np.floating[Any]]
Channel = tuple[Array, Array]

SPEED_LSB = 0.05 * 2 * np.pi / 60
"""0.05 rpm in rad/s."""
TORQUE_LSB = 0.01
ACCELERATION_LSB = 0.002394
STANDARD_GRAVITY = 9.80665


def draw(rng: Generator, good: bool = False) -> dict[str, float]:
    """Draw the sensors of a recording; `good` draws the better half (1 kHz speed, little noise, nothing lost)."""
    fast = good or rng.uniform() < 0.5
    return {
        "speed_hz": 1000.0 if fast else 500.0,
        "acceleration_hz": 4000.0 if good or rng.uniform() < 0.5 else 2000.0,
        "noise": float(
            np.exp(rng.uniform(np.log(0.02), np.log(0.05)) if good else rng.uniform(*np.log([0.01, 0.1])))
        ),
        "bias": float(rng.uniform(-0.004, 0.004) if good else rng.uniform(-0.03, 0.03)),
        "lost": 0.0 if good or rng.uniform() < 0.5 else 0.01,
        "lost_by": float(rng.choice([1, 3])),
        "speed_noise": 0.003,
        "torque_noise": 0.0095,
    }


def record(
    rng: Generator,
    traces: Traces,
    lane: int,
    end: float,
    machine: Mapping[str, float],
    s: Mapping[str, float],
) -> dict[str, Channel]:
    """Return the channels of one lane as (times [s], values), in the capture format's units."""
    ticks = round(end / TICK) + 1
    ratio = machine["transmission"]
    step = round(1 / (s["speed_hz"] * TICK))
    speed = _drive_filter(traces.motor_speed[:ticks, lane] / ratio, s)[::step]
    torque = traces.motor_force[:ticks, lane][::step] * ratio
    at = np.arange(speed.size) * step * TICK
    times, acceleration = _accelerometer(rng, traces.load_speed[:ticks, lane], s)
    return {
        "motor_speed": (at, _digits(speed + s["speed_noise"] * rng.standard_normal(at.size), SPEED_LSB)),
        "motor_torque": (at, _digits(torque + s["torque_noise"] * rng.standard_normal(at.size), TORQUE_LSB)),
        "acceleration": _lose(rng, times, acceleration, s),
    }


def _digits(values: Array, lsb: float) -> Array:
    return np.round(values / lsb) * lsb


def _lose(rng: Generator, times: Array, values: Array, s: Mapping[str, float]) -> Channel:
    """Drop single samples or whole frames until the share `lost` is gone."""
    by = int(s.get("lost_by", 1))
    gone = np.repeat(rng.uniform(size=-(-times.size // by)) < s.get("lost", 0.0), by)[: times.size]
    return times[~gone], values[~gone]


def _accelerometer(rng: Generator, speed: Array, s: Mapping[str, float]) -> Channel:
    """Return sample times [s] and digitised acceleration [m/s²] from the load's speed on the controller's grid."""
    rate = s["acceleration_hz"]
    count = round((speed.size - 1) * TICK * rate) + 1
    stamps = np.arange(count) / rate
    felt = _mount(speed, s)
    when = (
        stamps * (1 + s.get("clock_error", 0.0))
        - s.get("latency", 0.0)
        + _jitter(rng, count, s)
        - _jumps(stamps, s)
    )
    grid = np.arange(speed.size) * TICK
    course = CubicSpline(grid, felt)
    edge = [np.clip(w, 0.0, grid[-1]) for w in (when - 0.5 / rate, when + 0.5 / rate)]
    mean = (course(edge[1]) - course(edge[0])) * rate
    mean = mean + s.get("bent_even", 0.0) * mean**2 + s.get("bent_odd", 0.0) * mean**3
    clean = (1 + s.get("gain", 0.0)) * mean + _offset(stamps, s) + _hum(stamps, s)
    noisy = clean + s["noise"] * rng.standard_normal(count)
    return stamps, _digits(np.clip(noisy, -s.get("clip", 1e9), s.get("clip", 1e9)), ACCELERATION_LSB)


def _jumps(stamps: Array, s: Mapping[str, float]) -> Array:
    """Return a delay [s] that is another one after every 0.9 s."""
    if not s.get("jump"):
        return np.zeros_like(stamps)
    levels = np.random.default_rng(int(s["jump_seed"])).uniform(0, s["jump"], 100)
    return np.asarray(levels[(stamps / 0.9).astype(int)])


def _jitter(rng: Generator, count: int, s: Mapping[str, float]) -> Array:
    """Return a sampling error [s] that wanders with a memory of about 5 ms."""
    if not s.get("jitter"):
        return np.zeros(count)
    memory = np.exp(-1 / (0.005 * s["acceleration_hz"]))
    return np.asarray(
        s["jitter"] * lfilter([np.sqrt(1 - memory**2)], [1, -memory], rng.standard_normal(count))
    )


def _offset(t: Array, s: Mapping[str, float]) -> Array:
    """Bias, its drift per second, and a warm-up towards `bias_warm`."""
    warm = s.get("bias_warm", 0.0) * (1 - np.exp(-t / s.get("tau_warm", 1.0)))
    return np.asarray(s.get("bias", 0.0) + s.get("bias_drift", 0.0) * t + warm)


def _hum(t: Array, s: Mapping[str, float]) -> Array:
    """50 Hz and its third harmonic from the mains."""
    turn = 2 * np.pi * s.get("hum_hz", 50.0) * t + s.get("hum_phase", 0.0)
    return np.asarray(s.get("hum", 0.0) * (np.sin(turn) + 0.3 * np.sin(3 * turn + 1.0)))


def _second_order(x: Array, top: list[float], hz: float, zeta: float) -> Array:
    """Filter by top(s) / (s² + 2ζωs + ω²), first-order hold."""
    omega = 2 * np.pi * hz
    b, a, _ = cont2discrete((top, [1.0, 2 * zeta * omega, omega**2]), TICK, method="foh")
    return np.asarray(lfilter(b.ravel(), a, x))


def _mount(speed: Array, s: Mapping[str, float]) -> Array:
    """Return the speed that the sensing element feels: soft mount, and tilt that turns gravity into the axis."""
    felt = speed
    if s.get("mount_hz"):
        omega, zeta = 2 * np.pi * s["mount_hz"], s["mount_zeta"]
        felt = _second_order(felt, [2 * zeta * omega, omega**2], s["mount_hz"], zeta)
    if s.get("slow_hz"):
        omega = 2 * np.pi * s["slow_hz"]
        felt = _second_order(felt, [omega**2], s["slow_hz"], s["slow_zeta"])
    if s.get("tilt"):
        omega = 2 * np.pi * s["tilt_hz"]
        felt = felt + s["tilt"] * _second_order(speed, [omega**2], s["tilt_hz"], s["tilt_zeta"])
    return felt


def _drive_filter(speed: Array, s: Mapping[str, float]) -> Array:
    """The drive's first-order filter on the speed that it reports (`speed_tau` [s])."""
    if not s.get("speed_tau"):
        return speed
    keep = np.exp(-TICK / s["speed_tau"])
    gain = s["speed_tau"] / TICK * (1 - keep)
    return np.asarray(lfilter([1 - gain, gain - keep], [1, -keep], speed))
