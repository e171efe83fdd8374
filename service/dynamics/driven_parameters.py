"""The declared model's parameters with their priors, and where its states lie: eqs. (2)-(7) and (9).

All forces are given per moved mass M, the unit of a stiffness being 1/s²: only the load's acceleration is compared
with the measurement; the torque, where recorded, says how heavy M is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from service.recording import FloatArray

Values = Mapping[str, FloatArray]
"""Parameter name -> (S,) values, one per parameter set."""


@dataclass(frozen=True)
class Parameter:
    """One parameter: its name, unit, prior and bounds.

    Attributes
    ----------
    logarithmic : the prior is normal in the logarithm, with `spread` as its standard deviation there;
        else normal in the value, `spread` in the unit
    typical : centre of the prior; an effect is absent where its amounts have their typical value, 0
    low, high : bounds of the value
    dose : of an effect's amount: how much of it, in the unit, a score test gives; 0 for what only shapes the effect
    found_again : a phase or a zero that every recording has anew
    """

    name: str
    unit: str
    typical: float
    spread: float
    logarithmic: bool = True
    low: float = -np.inf
    high: float = np.inf
    dose: float = 0.0
    found_again: bool = False

    def internal(self, value: FloatArray | float) -> FloatArray:
        """Value -> the fit's coordinate, whose prior is standard normal."""
        if self.logarithmic:
            return np.asarray(np.log(np.asarray(value) / self.typical) / self.spread)
        return np.asarray((np.asarray(value) - self.typical) / self.spread)

    def value(self, internal: FloatArray | float) -> FloatArray:
        """The fit's coordinate -> value."""
        moved = np.asarray(internal) * self.spread
        value = self.typical * np.exp(moved) if self.logarithmic else self.typical + moved
        if self.low == -np.inf and self.high == np.inf:
            return np.asarray(value)
        return np.asarray(np.clip(value, self.low, self.high))

    def at_limit(self, value: float) -> bool:
        """Whether a number that shapes an effect, such as a frequency, would go farther than it can be."""
        return self.logarithmic and not self.dose and not self.low * 1.01 < value < self.high * 0.99

    def of(self, axis: str) -> Parameter:
        """The same parameter as one axis' own, its name in front."""
        return replace(self, name=f"{axis}.{self.name}")


@dataclass(frozen=True)
class Scales:
    """The priors and bounds of all parameters (P,) of a model at once, as in Parameter."""

    typical: FloatArray
    spread: FloatArray
    logarithmic: NDArray[np.bool_]
    low: FloatArray
    high: FloatArray

    @classmethod
    def of(cls, parameters: Sequence[Parameter]) -> Scales:
        rows = [(p.typical, p.spread, p.logarithmic, p.low, p.high) for p in parameters]
        typical, spread, logarithmic, low, high = np.array(rows, dtype=np.float64).reshape(-1, 5).T
        return cls(typical, spread, logarithmic > 0.0, low, high)

    def values(self, coordinates: FloatArray) -> FloatArray:
        """Coordinates (S, P) -> values (S, P)."""
        moved = coordinates * self.spread
        grown = self.typical * np.exp(np.where(self.logarithmic, moved, 0.0))
        return np.asarray(
            np.clip(np.where(self.logarithmic, grown, self.typical + moved), self.low, self.high)
        )

    @cached_property
    def ends(self) -> FloatArray:
        """Coordinates (P, 2) at which the values end; infinite where they do not."""
        bounds = np.stack((self.low, self.high), axis=1)
        typical, spread, logarithmic = self.typical[:, None], self.spread[:, None], self.logarithmic[:, None]
        with np.errstate(all="ignore"):
            grown = np.log(np.maximum(bounds, 0.0) / typical, where=logarithmic, out=np.zeros_like(bounds))
        return np.asarray(np.where(logarithmic, grown, bounds - typical) / spread)


AXIS_PARAMETERS = (
    Parameter("backlash", "m", 5e-5, 1.5),
    Parameter("contact_stiffness", "1/s²", 4e5, 1.2),
    Parameter("contact_damping_ratio", "1", 0.06, 0.8),
    Parameter("coulomb", "m/s²", 0.3, 1.0),
    Parameter("viscous", "1/s", 1.0, 1.0),
    Parameter("constant", "m/s²", 0.0, 0.3, logarithmic=False),
    Parameter("skew", "s", 0.0, 1e-3, logarithmic=False),
)
"""Of each axis. Contact: k_p/M and d_p/(2·√(k_p·M)), in series with the drive where there are no lumps. Coulomb and
viscous friction of the guide and a constant force per M. Skew: by how much the speed's clock is ahead of the
sensor's. The priors are those of machine axes of 50 to 5,000 kg with contacts of 30 to 300 Hz and the few
percent of damping that steel joints have: they keep a fit sane, data decide."""

LINKS: Mapping[int, tuple[str, ...]] = {0: (), 1: ("drive",), 2: ("gear", "pinion")}
"""Between motor and dead zone, by number of lumps: each link is a spring and damper and the mass behind it."""

LINK_PARAMETERS: Mapping[str, tuple[Parameter, ...]] = {
    "drive": (
        Parameter("drive_stiffness", "1/s²", 8e5, 1.0),
        Parameter("drive_damping_ratio", "1", 0.03, 1.0),
        Parameter("drive_mass", "1", 0.08, 1.0),
    ),
    "gear": (
        Parameter("gear_stiffness", "1/s²", 1e6, 1.0),
        Parameter("gear_damping_ratio", "1", 0.03, 1.0),
        Parameter("gear_mass", "1", 0.06, 1.0),
    ),
    "pinion": (
        Parameter("pinion_stiffness", "1/s²", 1e6, 1.0),
        Parameter("pinion_damping_ratio", "1", 0.03, 1.0),
        Parameter("pinion_mass", "1", 0.03, 1.0),
    ),
}
"""Stiffness and mass per M; damping as a share of 2·√(stiffness·mass of the load), comparable with the contact's."""

BRIDGE_PARAMETERS = (
    Parameter("bridge_stiffness", "1/s²", 4e4, 1.2),
    Parameter("bridge_damping", "1/s", 20.0, 1.5),
    Parameter("bridge_offset", "m", 0.0, 1e-4, logarithmic=False),
    Parameter("mass_ratio", "1", 1.0, 0.3),
)
"""Of a gantry: per mass of the first axis; M2/M1; the distance of the two motors' positions at which the bridge
pulls on neither carriage, with both pinions in the middle of their gaps."""


TURNOVER_PARAMETERS = (
    Parameter("turnover_speed", "m/s", 5e-4, 0.7),
    Parameter("turnover_spread", "1", 2.1, 0.06, low=1.0, high=8.0),
)
"""Of each axis where the whole move is simulated: the speed around which the guide's friction builds up, and how
gradually, see driven_friction. Chosen: where rolling guides and wipers creep before they slide, 0.1 to 3 mm/s, and
between the laws that stand for it."""


@dataclass(frozen=True)
class Structure:
    """The declared model's bodies: `axes` names (1 or 2), `lumps` per axis."""

    axes: tuple[str, ...]
    lumps: int = 0

    @property
    def states_per_axis(self) -> int:
        """Position and speed of each lump and of the load."""
        return 2 * (self.lumps + 1)

    def load(self, axis: int) -> int:
        """Index of the load's position; its speed follows."""
        return axis * self.states_per_axis + 2 * self.lumps

    def pinion(self, axis: int) -> int | None:
        """Index of the position of what touches the rack; None: it is the motor itself."""
        return axis * self.states_per_axis + 2 * (self.lumps - 1) if self.lumps else None
