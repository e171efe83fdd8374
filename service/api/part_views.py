"""What a value means beside its number, as the API shows it."""

from __future__ import annotations

from service.api.value_schemas import DirectionView, PlaceView
from service.api.words import in_words
from service.backlash.results import DirectionValue, PlaceValue


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
