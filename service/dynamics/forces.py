"""What acts between bodies: the dead zone of eqs. (5)-(7), Coulomb and viscous friction.

Two of the paper's formulas are not taken as printed.

- Eq. (5) with eq. (7) lets the damping pull: while the flanks part, d_p·Δẋ_b is negative and soon larger than
  k_p·Δx_b, and steel would stick to steel. Here the flanks part as soon as the force between them is zero
  (as in the contact model of Kelvin and Voigt without adhesion) and they touch again only when both Δx_b and
  the force are positive.
- Eq. (5) also jumps by d_p·Δẋ_b at the moment of impact. That is kept: it is some 260 N at 13 mm/s with
  d_p = 2e4 N s/m, and the spring overtakes it after d_p/k_p = 0.1 ms, less than a sample. A damping that
  grows with the depth would cure it, at the price of a law that is no longer linear and of a parameter that
  no data sheet gives.

The paper does not say what F_fric is. Here it is Coulomb's law with real sticking (a set-valued force at
standstill, neither smoothed nor creeping) plus a viscous part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Contact:
    """A dead zone, eqs. (5)-(7): between LL and UL [m] of the elongation row·q nothing is transmitted.

    k [N/m] and d [N s/m] are k_p and d_p; ``name`` is the axis for the gap between pinion and rack.
    """

    name: str
    row: FloatArray
    k: float
    d: float
    UL: float
    LL: float


@dataclass(frozen=True)
class Sliding:
    """Friction against the sliding speed row·q̇: Coulomb ``level`` [N] and ``viscous`` [N s/m] coefficient.

    ``name`` is the body, the carriage's for the guide.
    """

    name: str
    row: FloatArray
    level: float
    viscous: float = 0.0


def elongation(x_rp: ArrayLike, UL: float, LL: float) -> FloatArray:
    """Δx_b of eq. (6) [m]: how deep the flanks are pressed into each other, 0 inside the gap."""
    x = np.asarray(x_rp, dtype=np.float64)
    return np.maximum(x - UL, 0.0) + np.minimum(x - LL, 0.0)


def flank_force(contact: Contact, x_rp: ArrayLike, v_rp: ArrayLike) -> FloatArray:
    """F_p,compl of eqs. (5)-(7) [N] at Δx_rp [m] and Δẋ_rp [m/s], without the pull that eq. (5) contains."""
    depth = elongation(x_rp, contact.UL, contact.LL)
    flank = np.sign(depth)
    push = flank * (contact.k * depth + contact.d * np.asarray(v_rp, dtype=np.float64))
    force: FloatArray = flank * np.maximum(push, 0.0)
    return force


def sliding_friction(sliding: Sliding, v: ArrayLike) -> FloatArray:
    """F_fric [N] while sliding at v [m/s], against the motion; at v = 0 its viscous part, 0."""
    v = np.asarray(v, dtype=np.float64)
    friction: FloatArray = sliding.level * np.sign(v) + sliding.viscous * v
    return friction
