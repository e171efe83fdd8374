"""Machines and moves drawn at random from wide ranges; a machine whose controller would ring is retuned, never kept."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from tests.undeclared.machine import Steps

Machine = dict[str, float]


def log_uniform(rng: Generator, low: float, high: float) -> float:
    """Draw between `low` and `high`, evenly in the logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def axis(rng: Generator, backlash: float | None = None, transmission: float | None = None) -> Machine:
    """Draw one axis: masses, springs, friction and a stable controller, referred to the output (SI)."""
    m: Machine = {
        "transmission": transmission or float(rng.choice([0.003, 0.003, 0.003, 0.002, 0.004, 0.006])),
        "m_load": log_uniform(rng, 150, 800),
        "m_motor": log_uniform(rng, 120, 450),
        "m_gear": log_uniform(rng, 10, 50),
        "m_pinion": log_uniform(rng, 8, 30),
        "k_gear": log_uniform(rng, 2e8, 1.2e9),
        "k_shaft": log_uniform(rng, 2e8, 1.2e9),
        "kp": log_uniform(rng, 5e7, 5e8),
        "backlash": backlash if backlash is not None else float(rng.uniform(12e-6, 175e-6)),
        "flank": float(rng.uniform()),
    }
    m |= _damping(rng, m) | _friction(rng) | _controller(rng, m)
    return settle(m)


def _damping(rng: Generator, m: Machine) -> Machine:
    """Dampers as ratios of the critical value of the neighbouring masses."""
    drive = m["m_motor"] + m["m_gear"] + m["m_pinion"]
    contact = drive * m["m_load"] / (drive + m["m_load"])
    return {
        "d_gear": 2 * rng.uniform(0.03, 0.12) * np.sqrt(m["k_gear"] * m["m_gear"]),
        "d_shaft": 2 * rng.uniform(0.03, 0.12) * np.sqrt(m["k_shaft"] * m["m_pinion"]),
        "dp": 2 * rng.uniform(0.06, 0.25) * np.sqrt(m["kp"] * contact),
    }


def _friction(rng: Generator) -> Machine:
    """Coulomb [N] and viscous [N·s/m] friction of every body; most of it in the guides of the carriage."""
    small = {f"fc_{b}": log_uniform(rng, 3, 20) for b in ("motor", "gear", "pinion")}
    small |= {f"fv_{b}": log_uniform(rng, 5, 60) for b in ("motor", "gear", "pinion")}
    return small | {
        "fc": log_uniform(rng, 30, 400),
        "fv": log_uniform(rng, 60, 800),
        "v_smooth": log_uniform(rng, 2e-4, 1e-3),
    }


def _controller(rng: Generator, m: Machine) -> Machine:
    """PPI cascade tuned as a commissioner would: speed loop 22-60 Hz, position loop a third of that at most."""
    total = m["m_motor"] + m["m_gear"] + m["m_pinion"] + m["m_load"]
    omega = 2 * np.pi * log_uniform(rng, 22, 60)
    return {
        "k_speed": omega * total,
        "ti_speed": rng.uniform(5, 12) / omega,
        "kv": omega * rng.uniform(0.15, 0.33),
        "tau_current": log_uniform(rng, 3e-4, 8e-4),
        "ff_speed": float(rng.choice([1.0, 1.0, rng.uniform(0.9, 1.0)])),
        "ff_mass": total * float(rng.choice([0.0, rng.uniform(0.5, 1.0), rng.uniform(0.9, 1.0), 1.0])),
    }


def poles(m: Machine, contact: bool) -> NDArray[np.complex128]:
    """Return the closed loop's poles [1/s] with flanks in contact, or in the gap; friction left out."""
    mass = np.array([m["m_motor"], m["m_gear"], m["m_pinion"], m["m_load"]])
    k = np.array([m["k_gear"], m["k_shaft"], m["kp"] if contact else 0.0])
    d = np.array([m["d_gear"], m["d_shaft"], m["dp"] if contact else 0.0])
    link = np.array([[1, -1, 0, 0], [0, 1, -1, 0], [0, 0, 1, -1]], dtype=float)
    a = np.zeros((10, 10))
    a[:4, 4:8] = np.eye(4)
    a[4:8, :4] = -(link.T @ np.diag(k) @ link) / mass[:, None]
    a[4:8, 4:8] = -(link.T @ np.diag(d) @ link) / mass[:, None]
    a[4, 8] = 1 / mass[0]
    lag = m["tau_current"] + 1.9e-4
    error = np.zeros(10)
    error[0], error[4] = -m["kv"], -1.0
    a[9] = m["k_speed"] / m["ti_speed"] * error
    a[8] = m["k_speed"] * error / lag
    a[8, 9] += 1 / lag
    a[8, 8] -= 1 / lag
    return np.asarray(np.linalg.eigvals(a), dtype=complex)


def damped_enough(m: Machine) -> bool:
    """Return whether the closed loop dies out, in contact and in the gap: 13 % damping below 400 Hz, 1.5 % above."""
    every = np.concatenate([poles(m, True), poles(m, False)])
    ringing = every[np.abs(every.imag) > 1.0]
    size = np.abs(ringing)
    least = np.where(size < 2 * np.pi * 400, 0.13, 0.015)
    return bool(np.all(-ringing.real >= least * size) and np.all(every.real < 1e-6))


def settle(m: Machine) -> Machine:
    """Lower the gains and raise the damping, a little at a time, until the closed loop is damped enough."""
    for _ in range(40):
        if damped_enough(m):
            return m
        m = m | {"k_speed": 0.94 * m["k_speed"], "ti_speed": m["ti_speed"] / 0.94, "kv": 0.94 * m["kv"]}
        m = m | {name: 1.08 * m[name] for name in ("d_gear", "d_shaft", "dp")}
    raise ValueError(f"no stable controller found for {m}")


def gantry(rng: Generator, backlash: tuple[float, float] | None = None) -> list[Machine]:
    """Draw two axes of one build, joined by a bridge: other gap, friction, flank position and zero on each side."""
    left = axis(rng)
    right = dict(left)
    for name in ("m_load", "kp", "k_gear", "k_shaft", "dp", "m_motor"):
        right[name] = left[name] * log_uniform(rng, 0.87, 1.15)
    for name in ("fc", "fv"):
        right[name] = left[name] * log_uniform(rng, 0.5, 2.0)
    right["fc"] = min(max(right["fc"], 30.0), 400.0)
    right["flank"] = float(rng.uniform())
    left["backlash"], right["backlash"] = backlash or rng.uniform(12e-6, 175e-6, 2).tolist()
    stiffness = log_uniform(rng, 0.5e7, 6e7)
    damper = 2 * rng.uniform(0.02, 0.12) * np.sqrt(stiffness * left["m_load"] / 2)
    zero = float(rng.choice([0.0, 1.0, 1.0])) * rng.uniform(-25e-6, 25e-6)
    bridge = {"k_c": stiffness, "d_c": float(damper)}
    return [
        settle(left) | bridge | {"z_c": zero, "partner": 1.0},
        settle(right) | bridge | {"z_c": -zero, "partner": -1.0},
    ]


def moves(rng: Generator) -> Steps:
    """Draw the moves of a single recording."""
    return Steps(length=float(rng.uniform(3.5e-3, 6e-3)), jerk=float(rng.uniform(150, 260)))


def move_pair(rng: Generator) -> tuple[Steps, Steps]:
    """Draw the moves of a train and a validate recording: the second longer, with a jerk of its own."""
    train = Steps(length=float(rng.uniform(3.6e-3, 4.6e-3)), jerk=float(rng.uniform(150, 260)))
    longer = min(max(train.length * rng.uniform(1.12, 1.38), 4.6e-3), 6e-3)
    jerk = float(np.clip(train.jerk * rng.uniform(0.85, 1.2), 150, 260))
    return train, Steps(length=float(longer), jerk=jerk)
