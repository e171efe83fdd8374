"""By-products as a maintenance planner reads them: a plain name, a unit of the workshop, and where they go.

The fit knows stiffness and friction per kilogram of moved mass, a bridge's per kilogram of its first axis. Where the
configuration says the mass they are shown in N/µm and N, else per kilogram.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from service.api.base import Interval
from service.api.ports import Masses
from service.api.value_schemas import (
    ByProductHistory,
    ByProductPoint,
    ByProductSeries,
    ByProductView,
    ShownTrend,
    ShownValue,
)
from service.backlash.results import ByProduct
from service.monitoring.trend import Trend, trend
from service.store.records import ByProductRecord

_DAY = 86_400.0
_MONTH = 30 * _DAY


@dataclass(frozen=True)
class Shown:
    """How a by-product is shown.

    Attributes
    ----------
    says : what a change of it means
    unit, factor : unit of the workshop, and how many of it are one SI unit
    per_mass : of whose mass it is per kilogram, the axis' own or that of its gantry's first axis; None: of nobody's
    relative : whether its change is told in percent; not where zero is a sound value
    """

    label: str
    says: str
    unit: str
    factor: float = 1.0
    per_mass: Literal["own", "first"] | None = "own"
    relative: bool = True

    def scale(self, masses: Masses) -> tuple[float, str]:
        """Factor and unit with the moved masses, or without."""
        if self.per_mass is None:
            return self.factor, self.unit
        mass = masses.own if self.per_mass == "own" else masses.first
        return (self.factor, f"{self.unit} per kg") if mass is None else (self.factor * mass, self.unit)


SHOWN: Mapping[str, Shown] = {
    "contact_stiffness": Shown(
        "Contact stiffness", "softer: worn or dirty flanks, a loose rack or pinion", "N/µm", 1e-6
    ),
    "drive_stiffness": Shown(
        "Drive stiffness", "softer: a loose coupling or clamping set, a worn gearbox", "N/µm", 1e-6
    ),
    "coulomb_friction": Shown(
        "Friction", "more: dirt, dry guides, a tight preload or a dragging cable chain; less: play", "N"
    ),
    "viscous_friction": Shown(
        "Friction that grows with speed", "more: stiff or too much grease, a cold machine", "N per m/s"
    ),
    "bridge_stiffness": Shown(
        "Bridge stiffness", "softer: loose joints of the bridge", "N/µm", 1e-6, "first"
    ),
    "bridge_offset": Shown(
        "Bridge offset", "a change: the two sides are no longer square to each other", "µm", 1e6, None, False
    ),
    "skew": Shown(
        "Time skew of sensor and drive",
        "a change: another filter or firmware, or another timing of the bus",
        "µs",
        1e6,
        None,
        False,
    ),
}
"""By the by-product's name; one that is not here is shown as it is."""


def by_product_view(product: ByProduct, masses: Masses) -> ByProductView:
    """Show what one run found."""
    shown = _shown_as(product)
    factor, unit = shown.scale(masses)
    return ByProductView(
        **vars(product),
        label=shown.label,
        shown=ShownValue(unit=unit, value=product.value * factor, std=product.std * factor),
    )


def by_product_history(found: Sequence[ByProductRecord], masses: Masses) -> ByProductHistory:
    """Show the histories of all by-products; records come the newest first."""
    names = list(dict.fromkeys(record.product.name for record in found))
    return ByProductHistory(
        items=[_series([record for record in found if record.product.name == name], masses) for name in names]
    )


def _series(found: Sequence[ByProductRecord], masses: Masses) -> ByProductSeries:
    t = np.array([record.measured_at.timestamp() for record in reversed(found)])
    stands = trend(t, np.array([record.product.value for record in reversed(found)]))
    assert stands is not None
    product = found[0].product
    shown = _shown_as(product)
    return ByProductSeries(
        name=product.name,
        unit=product.unit,
        label=shown.label,
        says=shown.says,
        level=stands.level,
        level_interval_95=stands.interval,
        slope_per_day=_times(stands.slope, _DAY),
        slope_interval_95_per_day=_both(stands.slope_interval, _DAY),
        shown=_shown(stands, shown, masses),
        items=[
            ByProductPoint(
                run_id=r.run_id, measured_at=r.measured_at, value=r.product.value, std=r.product.std
            )
            for r in found
        ],
    )


def _shown_as(product: ByProduct) -> Shown:
    readable = product.name.replace("_", " ").capitalize()
    return SHOWN.get(product.name, Shown(readable, "", product.unit, per_mass=None, relative=False))


def _shown(stands: Trend, shown: Shown, masses: Masses) -> ShownTrend:
    factor, unit = shown.scale(masses)
    return ShownTrend(
        unit=unit,
        level=stands.level * factor,
        level_interval_95=_both(stands.interval, factor),
        trend_in_words=trend_in_words(stands, shown, factor, unit),
    )


def trend_in_words(stands: Trend, shown: Shown, factor: float, unit: str) -> str:
    """Where it goes; a slope whose interval holds zero is not stated as one."""
    if stands.slope is None or stands.slope_interval is None:
        return "too few runs for a trend (nine, over a week)"
    low, high = stands.slope_interval
    if low <= 0.0 <= high:
        return "steady"
    way = "growing" if stands.slope > 0 else "falling"
    change = abs(stands.slope) * _MONTH
    if shown.relative and stands.level > 0:
        return f"{way} {100 * change / stands.level:.2g} % a month"
    return f"{way} {change * factor:.2g} {unit} a month"


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


def _both(ends: Interval | None, factor: float) -> Interval | None:
    return None if ends is None else (ends[0] * factor, ends[1] * factor)
