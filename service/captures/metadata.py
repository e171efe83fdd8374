"""The JSON object of a capture (schema metadata key ``capture``), checked field by field.

Units are in the names, as everywhere at a border. Keys that this version does not know are kept and
written again, at the top as well as inside axes and moves.
"""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from service.captures.errors import CaptureMetadataError
from service.recording import AxisDescription, Motion, Move, Recording

FORMAT = 1
TRANSMISSION_TOLERANCE = 0.01
"""Chosen: a diameter or ratio rounded in a data sheet differs less, a wrong unit differs far more."""

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _Object(BaseModel):
    model_config = ConfigDict(extra="allow", strict=True, frozen=True)


class AxisMetadata(_Object):
    name: str = Field(min_length=1)
    motion: Motion = "linear"
    transmission: Positive = Field(description="m/rad (linear) or rad/rad (rotary)")
    pinion_diameter_m: Positive | None = None
    gear_ratio: Positive | None = None
    rates_hz: dict[str, Positive] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _one_transmission(self) -> AxisMetadata:
        if self.pinion_diameter_m is None or self.gear_ratio is None:
            return self
        built = self.pinion_diameter_m / (2 * self.gear_ratio)
        if abs(self.transmission - built) > TRANSMISSION_TOLERANCE * built:
            raise ValueError(
                f"transmission is {self.transmission:g}, but pinion_diameter_m / (2 gear_ratio) is {built:g}"
            )
        return self


class MoveMetadata(_Object):
    start_s: Finite
    direction: Literal[1, -1]
    length_m: Positive
    jerk_m_s3: Positive
    duration_s: Positive
    position_m: Finite | None = Field(default=None, description="where the axis stood before it")


class CaptureMetadata(_Object):
    format: Literal[1]
    machine: str = ""
    recorded_at: datetime | None = Field(default=None, strict=False)
    axes: list[AxisMetadata] = Field(min_length=1)
    gantry: list[Annotated[list[str], Field(min_length=2, max_length=2)]] = Field(default_factory=list)
    moves: list[MoveMetadata] = Field(default_factory=list)
    note: str | None = None

    @model_validator(mode="after")
    def _names_agree(self) -> CaptureMetadata:
        names = [axis.name for axis in self.axes]
        if len(set(names)) < len(names):
            raise ValueError(f"two axes have one name: {names}")
        for pair in self.gantry:
            if pair[0] == pair[1] or not set(pair) & set(names):
                raise ValueError(f"gantry {pair} is not a pair of the axes {names}")
        return self


def parse(text: str | bytes, path: Path) -> CaptureMetadata:
    """The metadata object; CaptureMetadataError when it is not what format version 1 says."""
    try:
        return CaptureMetadata.model_validate_json(text)
    except ValidationError as error:
        raise CaptureMetadataError(path, f"metadata: {_first_problems(error)}", _advice(error)) from error


def _first_problems(error: ValidationError, most: int = 3) -> str:
    problems = [f"{_where(e['loc'])}{e['msg']} (found {e['input']!r:.60})" for e in error.errors()]
    more = f" and {len(problems) - most} more" if len(problems) > most else ""
    return "; ".join(problems[:most]) + more


def _where(location: tuple[int | str, ...]) -> str:
    return ".".join(str(part) for part in location) + ": " if location else ""


def _advice(error: ValidationError) -> str:
    if any(e["loc"] == ("format",) for e in error.errors()):
        return (
            f"This program reads capture format {FORMAT}; update it, or export the recording in that version"
        )
    return (
        "The tool that wrote the file disagrees with the capture format, version 1; correct the JSON object"
    )


def to_header(metadata: CaptureMetadata) -> dict[str, Any]:
    """The fields of a ``Recording`` that the metadata fills."""
    recorded_at = metadata.recorded_at
    if recorded_at is not None and recorded_at.tzinfo is None:
        recorded_at = recorded_at.replace(tzinfo=UTC)
    return {
        "machine": metadata.machine,
        "axes": tuple(_axis(axis) for axis in metadata.axes),
        "moves": tuple(_move(move) for move in metadata.moves),
        "gantry": tuple((pair[0], pair[1]) for pair in metadata.gantry),
        "recorded_at": recorded_at,
        "note": metadata.note,
        "extra": _unknown_keys(metadata),
    }


def _axis(axis: AxisMetadata) -> AxisDescription:
    return AxisDescription(
        name=axis.name,
        transmission=axis.transmission,
        motion=axis.motion,
        pinion_diameter=axis.pinion_diameter_m,
        gear_ratio=axis.gear_ratio,
        rates=dict(axis.rates_hz),
    )


def _move(move: MoveMetadata) -> Move:
    return Move(move.start_s, move.direction, move.length_m, move.jerk_m_s3, move.duration_s, move.position_m)


def _unknown_keys(metadata: CaptureMetadata) -> dict[str, Any]:
    """Unknown keys of the object itself, and those of its axes and moves under ``axes`` and ``moves``."""
    extra = dict(metadata.model_extra or {})
    axes = {axis.name: axis.model_extra for axis in metadata.axes if axis.model_extra}
    moves = {str(i): move.model_extra for i, move in enumerate(metadata.moves) if move.model_extra}
    return extra | ({"axes": axes} if axes else {}) | ({"moves": moves} if moves else {})


def from_recording(recording: Recording) -> dict[str, Any]:
    """The JSON object of a recording; keys without a value are left out."""
    extra = dict(recording.extra)
    of_axes, of_moves = extra.pop("axes", {}), extra.pop("moves", {})
    found = {
        "format": FORMAT,
        "machine": recording.machine,
        "recorded_at": _utc_text(recording.recorded_at),
        "axes": [_axis_object(axis) | of_axes.get(axis.name, {}) for axis in recording.axes],
        "gantry": [list(pair) for pair in recording.gantry] or None,
        "moves": [_move_object(m) | of_moves.get(str(i), {}) for i, m in enumerate(recording.moves)] or None,
        "note": recording.note,
    }
    return _without_none(found) | extra


def _axis_object(axis: AxisDescription) -> dict[str, Any]:
    return _without_none(
        {
            "name": axis.name,
            "motion": axis.motion,
            "transmission": axis.transmission,
            "pinion_diameter_m": axis.pinion_diameter,
            "gear_ratio": axis.gear_ratio,
            "rates_hz": dict(axis.rates),
        }
    )


def _move_object(move: Move) -> dict[str, Any]:
    return _without_none(
        {
            "start_s": move.start,
            "direction": move.direction,
            "length_m": move.length,
            "jerk_m_s3": move.jerk,
            "duration_s": move.duration,
            "position_m": move.position,
        }
    )


def _utc_text(moment: datetime | None) -> str | None:
    return None if moment is None else moment.astimezone(UTC).isoformat().replace("+00:00", "Z")


def _without_none(found: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in found.items() if value is not None}
