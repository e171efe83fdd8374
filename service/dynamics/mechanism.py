"""Bodies on a line, and what acts between them: the form into which axis, gantry and effects are put.

All coordinates are referred to the output side [m]. Relations between bodies are rows r, so that r·q is an
elongation or a sliding distance: (…, 1, …, −1, …). A linear element with stiffness k and damping d along
r adds k·rᵀr and d·rᵀr; flank contacts and Coulomb friction switch, and ``modes`` makes one linear
system out of each of their states.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from service.dynamics.forces import Contact, Sliding

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Drive:
    """A motor: torque [N m] to force [N] on its body by the transmission [m/rad]; current loop [s]."""

    axis: str
    body: str
    transmission: float
    current_loop_time: float


@dataclass(frozen=True)
class Mechanism:
    """n bodies: masses M (n,) [kg], linear damping D, stiffness K (n, n), constant forces F0 (n,) [N]."""

    bodies: tuple[str, ...]
    M: FloatArray
    D: FloatArray
    K: FloatArray
    F0: FloatArray
    contacts: tuple[Contact, ...] = ()
    slidings: tuple[Sliding, ...] = ()
    drives: tuple[Drive, ...] = ()

    def index(self, body: str) -> int:
        """Where the body stands in q."""
        return self.bodies.index(body)

    def row(self, plus: str, minus: str | None = None) -> FloatArray:
        """The row of ``plus`` minus ``minus`` (None: the ground)."""
        r = np.zeros(len(self.bodies))
        r[self.index(plus)] = 1.0
        if minus is not None:
            r[self.index(minus)] = -1.0
        return r

    def with_body(self, body: str, mass: float) -> Mechanism:
        """Append a free body of ``mass`` [kg]."""
        if body in self.bodies:
            raise ValueError(f"the mechanism has a body {body!r} already")
        return join(self, free_bodies((body,), np.array([mass])))

    def with_element(self, row: FloatArray, k: float = 0.0, d: float = 0.0, rest: float = 0.0) -> Mechanism:
        """Add a spring k [N/m] with its length at rest [m] and a damper d [N s/m] along ``row``."""
        rr = np.outer(row, row)
        return replace(self, K=self.K + k * rr, D=self.D + d * rr, F0=self.F0 + k * rest * row)

    def with_contact(self, contact: Contact) -> Mechanism:
        """Add a dead zone."""
        return replace(self, contacts=(*self.contacts, contact))

    def with_sliding(self, name: str, row: FloatArray, level: float, viscous: float = 0.0) -> Mechanism:
        """Add Coulomb friction ``level`` [N] and viscous friction [N s/m] along ``row``."""
        return replace(self, slidings=(*self.slidings, Sliding(name, row, level, viscous)))


def free_bodies(names: tuple[str, ...], M: FloatArray) -> Mechanism:
    """Return bodies of masses M (n,) [kg] that nothing acts on."""
    n = len(names)
    return Mechanism(names, M, np.zeros((n, n)), np.zeros((n, n)), np.zeros(n))


def join(first: Mechanism, second: Mechanism) -> Mechanism:
    """Put two mechanisms side by side, uncoupled."""
    n, m = len(first.bodies), len(second.bodies)
    return Mechanism(
        bodies=first.bodies + second.bodies,
        M=np.concatenate([first.M, second.M]),
        D=_block(first.D, second.D),
        K=_block(first.K, second.K),
        F0=np.concatenate([first.F0, second.F0]),
        contacts=tuple(replace(c, row=np.pad(c.row, (0, m))) for c in first.contacts)
        + tuple(replace(c, row=np.pad(c.row, (n, 0))) for c in second.contacts),
        slidings=tuple(replace(s, row=np.pad(s.row, (0, m))) for s in first.slidings)
        + tuple(replace(s, row=np.pad(s.row, (n, 0))) for s in second.slidings),
        drives=first.drives + second.drives,
    )


def _block(a: FloatArray, b: FloatArray) -> FloatArray:
    n, m = len(a), len(b)
    return np.block([[a, np.zeros((n, m))], [np.zeros((m, n)), b]])
