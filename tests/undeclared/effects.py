"""Effects to plant: each draws its strength for one machine over the range that matters and returns what it changes.

`LIBRARY` holds the causes that an effect finder is told to know, `OUTSIDE` those that it cannot name: there the honest
answer is "unknown". Every effect is a function (rng, machine) -> (changes to the machine, changes to its sensors).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.random import Generator

from tests.undeclared.draw import Machine, log_uniform

Change = tuple[Machine, Machine]
Effect = Callable[[Generator, Machine], Change]

TOP_SPEED = 0.09
"""Typical top speed of a step [m/s]: 4.5 mm at 200 m/s³."""
PUSH = 4.5
"""Typical top acceleration of a step [m/s²]."""


def _sign(rng: Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _phase(rng: Generator) -> float:
    return float(rng.uniform(0, 2 * np.pi))


def none(rng: Generator, m: Machine) -> Change:
    """Nothing at all."""
    return {}, {}


def impure(rng: Generator, m: Machine) -> Change:
    """Impurities too small to matter: tooth-mesh error up to 3 µm, slightly bent contact, torque ripple."""
    ripple = {"ripple": 3e-6 * rng.uniform(0.5, 1.0), "wave_ripple": np.pi * float(rng.choice([2e-3, 3e-3]))}
    bent = {"n_contact": rng.uniform(1.02, 1.1), "depth_contact": PUSH * m["m_load"] / m["kp"]}
    cogging = rng.uniform(0.02, 0.12) / m["transmission"]
    poles = {"cogging": cogging, "wave_cogging": 2 * np.pi * m["transmission"] / 24}
    return ripple | bent | poles | {"phase_ripple": _phase(rng), "phase_cogging": _phase(rng)}, {}


def machine_body_mode(rng: Generator, m: Machine) -> Change:
    """The body of the machine rocks on its feet."""
    mass = m["m_load"] * log_uniform(rng, 3.0, 9.0)
    omega = 2 * np.pi * log_uniform(rng, 8, 30)
    zeta = rng.uniform(0.01, 0.05)
    return {"m_base": mass, "k_base": mass * omega**2, "d_base": 2 * zeta * omega * mass}, {}


def hung_mass_mode(rng: Generator, m: Machine) -> Change:
    """A hanging mass of 8 to 30 % of the load."""
    mass = m["m_load"] * log_uniform(rng, 0.08, 0.3)
    omega = 2 * np.pi * log_uniform(rng, 12, 60)
    zeta = rng.uniform(0.01, 0.05)
    return {"m_hung": mass, "k_hung": mass * omega**2, "d_hung": 2 * zeta * omega * mass}, {}


def stribeck_friction(rng: Generator, m: Machine) -> Change:
    """Breakaway friction above the sliding friction."""
    extra = max(m["fc"] * rng.uniform(0.8, 2.5), 0.25 * m["m_load"])
    return {"f_stribeck": extra, "v_stribeck": log_uniform(rng, 4e-3, 25e-3)}, {}


def asymmetric_friction(rng: Generator, m: Machine) -> Change:
    """Friction that differs between the directions."""
    return {"fc": max(m["fc"], 0.3 * m["m_load"]), "a_friction": _sign(rng) * rng.uniform(0.25, 0.6)}, {}


def curved_friction(rng: Generator, m: Machine) -> Change:
    """Friction that is curved in the speed."""
    power = float(rng.choice([0.4, 2.0]))
    return {"f_curved": max(m["fc"], 0.3 * m["m_load"]) * rng.uniform(0.7, 2.0), "p_curved": power}, {}


def constant_force(rng: Generator, m: Machine) -> Change:
    """A tilted axis; the slope stays below what friction holds."""
    friction = max(m["fc"], 0.25 * m["m_load"])
    return {"fc": friction, "grav": _sign(rng) * rng.uniform(0.35, 0.85) * friction}, {}


def position_dependent_force(rng: Generator, m: Machine) -> Change:
    """A cable chain: over 5 mm its force changes by 0.2 to 1 m/s² of the load."""
    slope = m["m_load"] * log_uniform(rng, 0.2, 1.0) / 5e-3
    return {"k_chain": slope, "x_chain": rng.uniform(-2e-3, 6e-3)}, {}


def gearbox_clearance(rng: Generator, m: Machine) -> Change:
    """A worn gearbox."""
    return {"clearance": log_uniform(rng, 8e-6, 60e-6)}, {}


def position_dependent_backlash(rng: Generator, m: Machine) -> Change:
    """A worn stretch of the rack, or a pinion out of round; the phase puts a slope into the moves."""
    gap = max(m["backlash"], 50e-6)
    phase = rng.uniform(-0.7, 0.7) + float(rng.choice([0.0, np.pi]))
    wave = log_uniform(rng, 8e-3, 24e-3)
    middle = phase - 2 * np.pi * 2.4e-3 / wave
    return {
        "backlash": gap,
        "gap_wave": gap * rng.uniform(0.2, 0.45),
        "wave_gap": wave,
        "phase_gap": middle,
    }, {}


def contact_nonlinearity(rng: Generator, m: Machine) -> Change:
    """Flanks that harden with depth, by the power law of Hertz and beyond."""
    return {
        "n_contact": rng.uniform(1.3, 2.0),
        "depth_contact": PUSH * m["m_load"] / m["kp"],
        "kp": m["kp"] / 1.5,
    }, {}


def transmission_ripple(rng: Generator, m: Machine) -> Change:
    """Tooth-mesh error that shakes the load by 0.15 to 1.2 m/s² at top speed; its zero is new in every recording."""
    wave = log_uniform(rng, 1.2e-3, 5e-3)
    size = log_uniform(rng, 0.15, 1.2) / (2 * np.pi * TOP_SPEED / wave) ** 2
    return {"ripple": size, "wave_ripple": wave, "phase_ripple": _phase(rng)}, {}


def sensor_latency(rng: Generator, m: Machine) -> Change:
    """The accelerometer's stream is late (seldom: early)."""
    return {}, {"latency": log_uniform(rng, 3e-4, 3e-3) * float(rng.choice([1, 1, 1, -1]))}


def sensor_gain(rng: Generator, m: Machine) -> Change:
    """A wrongly scaled accelerometer."""
    return {}, {"gain": _sign(rng) * rng.uniform(0.04, 0.15)}


def sensor_bias(rng: Generator, m: Machine) -> Change:
    """An accelerometer that warms up and drifts."""
    bias = {
        "bias": _sign(rng) * rng.uniform(0.1, 0.5),
        "bias_drift": _sign(rng) * log_uniform(rng, 0.03, 0.2),
    }
    return {}, bias | {"bias_warm": rng.uniform(-0.3, 0.3), "tau_warm": rng.uniform(0.5, 4.0)}


def sensor_filter(rng: Generator, m: Machine) -> Change:
    """The accelerometer's own low-pass is slower than its data sheet says."""
    return {}, {"slow_hz": log_uniform(rng, 40, 160), "slow_zeta": rng.uniform(0.6, 0.8)}


def speed_filter(rng: Generator, m: Machine) -> Change:
    """The drive reports a filtered speed."""
    return {}, {"speed_tau": log_uniform(rng, 4e-4, 3e-3)}


def mount_resonance(rng: Generator, m: Machine) -> Change:
    """The accelerometer rings on a soft mount."""
    return {}, {"mount_hz": log_uniform(rng, 90, 350), "mount_zeta": rng.uniform(0.02, 0.1)}


def tilt_coupling(rng: Generator, m: Machine) -> Change:
    """The carriage pitches when it is pushed, and the sensor reads gravity through the tilt."""
    tilt = {"tilt": _sign(rng) * rng.uniform(0.06, 0.25), "tilt_hz": log_uniform(rng, 9, 35)}
    return {}, tilt | {"tilt_zeta": rng.uniform(0.03, 0.1)}


def dahl_friction(rng: Generator, m: Machine) -> Change:
    """Presliding: the friction needs a stroke to build up after every reversal."""
    friction = max(m["fc"], 0.5 * m["m_load"])
    return {"fc": 0.05 * friction, "f_dahl": 0.95 * friction, "z_dahl": log_uniform(rng, 1e-4, 8e-4)}, {}


def clock_drift(rng: Generator, m: Machine) -> Change:
    """The accelerometer's clock runs off: its stream slides against the drive's during the recording."""
    return {}, {"clock_error": _sign(rng) * log_uniform(rng, 3e-4, 2e-3)}


def clock_jitter(rng: Generator, m: Machine) -> Change:
    """The accelerometer samples at moments that wander about their stamps."""
    return {}, {"jitter": log_uniform(rng, 2e-4, 8e-4)}


def mains_hum(rng: Generator, m: Machine) -> Change:
    """Mains in the accelerometer's lead."""
    return {}, {
        "hum": log_uniform(rng, 0.1, 0.5),
        "hum_hz": rng.uniform(49.95, 50.05),
        "hum_phase": _phase(rng),
    }


def torque_slip(rng: Generator, m: Machine) -> Change:
    """A friction stage that creeps by 0.5 to 4 mm/s under the force of the step."""
    return {"creep": log_uniform(rng, 5e-4, 4e-3) / (PUSH * m["m_load"])}, {}


def preload_flank(rng: Generator, m: Machine) -> Change:
    """A sprung anti-backlash pinion that holds the load in the gap with a tenth or so of the driving force."""
    force = PUSH * m["m_load"] * log_uniform(rng, 0.06, 0.3)
    stiffness = 2 * force / max(m["backlash"], 60e-6)
    return {"k_preload": stiffness, "d_preload": 0.04 * np.sqrt(stiffness * m["m_load"])}, {}


def load_change(rng: Generator, m: Machine) -> Change:
    """A workpiece comes or goes between two steps."""
    share = float(rng.choice([rng.uniform(-0.45, -0.2), rng.uniform(0.25, 0.8)]))
    return {
        "mass_change": share * m["m_load"],
        "t_change": float(rng.choice([1.05, 1.5, 1.93, 2.38, 2.82])),
    }, {}


def neighbour_vibration(rng: Generator, m: Machine) -> Change:
    """Another machine shakes this one."""
    shake = m["m_load"] * log_uniform(rng, 0.2, 1.0)
    return {"f_shake": shake, "hz_shake": log_uniform(rng, 7, 40), "phase_shake": _phase(rng)}, {}


def clipping(rng: Generator, m: Machine) -> Change:
    """The accelerometer's amplifier saturates before the steps' peaks."""
    return {}, {"clip": rng.uniform(1.8, 3.0)}


def bent_sensor(rng: Generator, m: Machine) -> Change:
    """The accelerometer's scale bends: the same sign for both directions, or a flattening towards its range."""
    even = bool(rng.uniform() < 0.5)
    size = _sign(rng) * rng.uniform(0.06, 0.2)
    return {}, {"bent_even": size / PUSH} if even else {"bent_odd": size / PUSH**2}


def warming_guide(rng: Generator, m: Machine) -> Change:
    """The guide's friction falls from move to move as the grease warms."""
    friction = max(m["fc"], 0.4 * m["m_load"])
    return {
        "fc": friction,
        "fc_cold": friction * rng.uniform(0.8, 2.0),
        "tau_cold": rng.uniform(0.5, 1.5),
    }, {}


def squeeze_film(rng: Generator, m: Machine) -> Change:
    """Grease between the flanks brakes the pinion while it crosses the gap."""
    return {"d_film": PUSH * m["m_load"] * rng.uniform(0.15, 0.5) / 0.02}, {}


def shaft_hysteresis(rng: Generator, m: Machine) -> Change:
    """A clamping hub that slips a little under load and springs back: a friction element beside the shaft."""
    return {
        "k_slip": m["k_shaft"] * rng.uniform(0.5, 2.0),
        "f_slip": PUSH * m["m_load"] * rng.uniform(0.15, 0.4),
    }, {}


def bumps(rng: Generator, m: Machine) -> Change:
    """Something hits the carriage now and then: sheets that are dropped beside the machine."""
    return {
        "f_bump": m["m_load"] * log_uniform(rng, 1.0, 4.0),
        "hz_bump": rng.uniform(8.0, 15.0),
        "phase_bump": _phase(rng),
    }, {}


def uneven_guide(rng: Generator, m: Machine) -> Change:
    """Friction that waves along the guide."""
    friction = max(m["fc"], 0.5 * m["m_load"])
    return {
        "fc": friction,
        "f_uneven": friction * rng.uniform(0.4, 0.9),
        "wave_uneven": log_uniform(rng, 2e-3, 6e-3),
        "phase_uneven": _phase(rng),
    }, {}


def latency_jumps(rng: Generator, m: Machine) -> Change:
    """A buffer between sensor and PC: the stream's delay is another one after every few moves."""
    return {}, {"jump": log_uniform(rng, 6e-4, 2e-3), "jump_seed": float(rng.integers(2**31))}


IN_LIBRARY = (
    *(
        machine_body_mode,
        hung_mass_mode,
        stribeck_friction,
        asymmetric_friction,
        curved_friction,
        constant_force,
    ),
    *(position_dependent_force, gearbox_clearance, position_dependent_backlash, contact_nonlinearity),
    *(
        transmission_ripple,
        sensor_latency,
        sensor_gain,
        sensor_bias,
        sensor_filter,
        speed_filter,
        preload_flank,
    ),
)
NOT_IN_LIBRARY = (
    *(mount_resonance, tilt_coupling, dahl_friction, clock_drift, clock_jitter, mains_hum, torque_slip),
    *(load_change, neighbour_vibration, clipping),
    *(
        bent_sensor,
        warming_guide,
        squeeze_film,
        shaft_hysteresis,
        bumps,
        uneven_guide,
        latency_jumps,
    ),
)
LIBRARY: dict[str, Effect] = {e.__name__: e for e in IN_LIBRARY}
OUTSIDE: dict[str, Effect] = {e.__name__: e for e in NOT_IN_LIBRARY}
CLEAN: dict[str, Effect] = {"none": none, "messy": impure, "impure": impure}
GANTRY_COUPLING = "gantry_coupling"
"""Planted by recording a gantry without declaring it, so it has no function here."""


def named(name: str) -> Effect:
    """Return the effect of this name; `a+b` plants both.

    Raises
    ------
    KeyError : no such effect.
    """
    every = LIBRARY | OUTSIDE | CLEAN
    parts = [every[part] for part in name.split("+")]

    def together(rng: Generator, m: Machine) -> Change:
        machine: Machine = {}
        sensors: Machine = {}
        for part in parts:
            of_machine, of_sensors = part(rng, m | machine)
            machine, sensors = machine | of_machine, sensors | of_sensors
        return machine, sensors

    return together


def elsewhere(rng: Generator, machine: Machine) -> Machine:
    """Return the machine as the next recording finds it: periodic errors at another phase, the pinion at another flank.

    The worn stretch of the rack stays where it is: both recordings start at the same place.
    """
    fresh = {k: _phase(rng) for k in machine if k.startswith("phase_") and k != "phase_gap"}
    return machine | fresh | {"flank": float(rng.uniform())}
