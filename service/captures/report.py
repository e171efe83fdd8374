"""What leaves the analysis as files: the JSON of ``analyze``, and the predictions of ``explain`` as Parquet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from service.backlash.results import AxisResult, DirectionValue, PlaceValue, StepResult
from service.recording import Trace


def axis_result_to_json(result: AxisResult) -> dict[str, Any]:
    """One axis of one run; a refused axis has null values, its reason and what to do."""
    return {
        "axis": result.axis,
        "verdict": result.verdict,
        "reason": None if result.reason is None else result.reason.value,
        "backlash_m": result.backlash,
        "interval_95_m": None if result.interval_95 is None else list(result.interval_95),
        "method": result.method,
        "steps": [step_result_to_json(step) for step in result.steps],
        "detail": result.detail,
        "by_direction": [direction_to_json(part) for part in result.by_direction],
        "by_place": [place_to_json(part) for part in result.by_place],
        "by_products": [
            {"name": p.name, "value": p.value, "std": p.std, "unit": p.unit} for p in result.by_products
        ],
    }


def direction_to_json(part: DirectionValue) -> dict[str, Any]:
    """What the steps of one direction say by themselves."""
    return {
        "direction": part.direction,
        "backlash_m": part.backlash,
        "interval_95_m": list(part.interval_95),
        "steps": part.steps,
    }


def place_to_json(part: PlaceValue) -> dict[str, Any]:
    """One point of the map along the rack."""
    return {
        "position_m": part.position,
        "verdict": part.verdict,
        "reason": None if part.reason is None else part.reason.value,
        "backlash_m": part.backlash,
        "interval_95_m": None if part.interval_95 is None else list(part.interval_95),
    }


def step_result_to_json(step: StepResult) -> dict[str, Any]:
    """One step; times are on the recording's clock."""
    return {
        "index": step.index,
        "direction": step.direction,
        "verdict": step.verdict,
        "reason": None if step.reason is None else step.reason.value,
        "backlash_m": step.backlash,
        "t1_s": step.t1,
        "t2_s": step.t2,
        "position_m": step.position,
    }


def write_predictions(columns: Mapping[str, Sequence[Any]], path: Path) -> None:
    """Write predictions as Parquet: time_s, axis, channel, model ("before" or "after"), value [channel's unit]."""
    pyarrow.parquet.write_table(pa.table(dict(columns)), path)


def read_predictions(path: Path) -> dict[tuple[str, str], Trace]:
    """Read predictions back: by (axis, model), at the channel's own time stamps [s]. Raises OSError."""
    try:
        columns = pyarrow.parquet.read_table(path).to_pydict()
    except pa.ArrowException as error:
        raise OSError(f"{path}: is no file of predictions: {error}") from error
    return predicted_traces(columns)


def predicted_traces(columns: Mapping[str, Sequence[Any]]) -> dict[tuple[str, str], Trace]:
    """Sort the rows of predictions by (axis, model)."""
    axis, model = np.array(columns["axis"], dtype=object), np.array(columns["model"], dtype=object)
    time, value = (np.asarray(columns[name], dtype=np.float64) for name in ("time_s", "value"))
    found = {}
    for key in dict.fromkeys(zip(axis, model, strict=True)):
        rows = (axis == key[0]) & (model == key[1])
        found[key] = Trace(time[rows], value[rows])
    return found
