"""One rack-and-pinion axis as a mechanism: motor, gearbox, pinion and carriage, eqs. (1)-(7).

Referred to the output side, eqs. (1)-(4) become a chain of four masses::

    motor ──k_mg,d_mg── gearbox ──k_gp,d_gp── pinion ═╣gap b, k_p, d_p╠═ carriage

with friction at each. The factor 1/i of eq. (2) is contained in the coordinates.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from service.dynamics.forces import Contact
from service.dynamics.mechanism import Drive, Mechanism, free_bodies
from service.dynamics.parameters import AxisParameters

CHAIN = ("motor", "gearbox", "pinion", "carriage")


def body(axis: str, part: str) -> str:
    """Name of a body of an axis, such as ``X1.pinion``."""
    return f"{axis}.{part}"


def axis_mechanism(name: str, p: AxisParameters) -> Mechanism:
    """Return the chain of eqs. (1)-(7) for the axis ``name``; the carriage runs on the ground."""
    at_motor, at_pinion = 1 / p.transmission**2, 1 / (p.D_p / 2) ** 2
    M = np.array([p.J_mot * at_motor, p.J_g * at_motor, p.J_p * at_pinion, p.M])
    drive = Drive(name, body(name, "motor"), p.transmission, p.ppi.current_loop_time)
    names = tuple(body(name, part) for part in CHAIN)
    chain = replace(free_bodies(names, M), drives=(drive,))
    motor, gearbox, pinion, carriage = names
    chain = chain.with_element(chain.row(motor, gearbox), p.k_mg * at_motor, p.d_mg * at_motor)
    chain = chain.with_element(chain.row(gearbox, pinion), p.k_gp * at_pinion, p.d_gp * at_pinion)
    gap = Contact(name, chain.row(pinion, carriage), p.k_p, p.d_p, p.upper_limit, p.lower_limit)
    return _with_friction(chain.with_contact(gap), p)


def _with_friction(chain: Mechanism, p: AxisParameters) -> Mechanism:
    """Add the friction at each body: a torque τ at a shaft is a force τ/radius on the output side."""
    frictions = (p.friction_mot, p.friction_g, p.friction_p, p.friction_mas)
    radii = (p.transmission, p.transmission, p.D_p / 2, 1.0)
    for name, friction, r in zip(chain.bodies, frictions, radii, strict=True):
        chain = chain.with_sliding(name, chain.row(name), friction.coulomb / r, friction.viscous / r**2)
    return chain
