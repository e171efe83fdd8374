"""What a value means beside its number, as the API shows it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from service.api.value_schemas import (
    ByProductHistory,
    ByProductPoint,
    ByProductSeries,
    DirectionView,
    PlaceView,
)
from service.api.words import in_words
from service.backlash.results import DirectionValue, PlaceValue
from service.monitoring.trend import trend
from service.store.records import ByProductRecord

_DAY = 86_400.0


def direction_view(part: DirectionValue) -> DirectionView:
    """Show what one direction says."""
    return DirectionView(
        direction=1 if part.direction > 0 else -1,
        backlash_m=part.backlash,
        interval_95_m=part.interval_95,
        steps=part.steps,
    )


def place_view(part: PlaceValue) -> PlaceView:
    """Show one point of the map along the rack."""
    return PlaceView(
        position_m=part.position,
        verdict=part.verdict,
        reason=part.reason,
        reason_in_words=in_words(part.reason),
        detail=part.detail,
        backlash_m=part.backlash,
        interval_95_m=part.interval_95,
    )


def by_product_history(found: Sequence[ByProductRecord]) -> ByProductHistory:
    """Show the histories of all by-products; records come the newest first."""
    names = list(dict.fromkeys(record.product.name for record in found))
    return ByProductHistory(items=[_series([r for r in found if r.product.name == name]) for name in names])


def _series(found: Sequence[ByProductRecord]) -> ByProductSeries:
    t = np.array([record.measured_at.timestamp() for record in reversed(found)])
    stands = trend(t, np.array([record.product.value for record in reversed(found)]))
    assert stands is not None
    return ByProductSeries(
        name=found[0].product.name,
        unit=found[0].product.unit,
        level=stands.level,
        level_interval_95=stands.interval,
        slope_per_day=None if stands.slope is None else stands.slope * _DAY,
        items=[
            ByProductPoint(
                run_id=r.run_id, measured_at=r.measured_at, value=r.product.value, std=r.product.std
            )
            for r in found
        ],
    )
