"""A rack that is worn where it is used: the gap is wider beyond a place. For tests of the map along the rack."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from service.dynamics.effects.effect import At, Effect, quantity


@dataclass(frozen=True)
class WornBeyond(Effect):
    """Beyond the ``place`` of the carriage the gap is wider by ``wear``, half of it at either flank."""

    name: ClassVar[str] = "worn_beyond"
    place: float = quantity("m", -10.0, 10.0)
    wear: float = quantity("m", 0.0, 1e-3)

    def flanks(self, UL: float, LL: float, at: At) -> tuple[float, float]:
        half = 0.5 * self.wear if at.x > self.place else 0.0
        return UL + half, LL - half
