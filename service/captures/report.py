"""What leaves the analysis as files: the JSON of ``analyze``, and the predictions of ``explain`` as Parquet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from service.backlash.results import AxisResult, StepResult


def axis_result_to_json(result: AxisResult) -> dict[str, Any]:
    """One axis of one run; a refused axis has null values and its reason."""
    return {
        "axis": result.axis,
        "verdict": result.verdict,
        "reason": None if result.reason is None else result.reason.value,
        "backlash_m": result.backlash,
        "interval_95_m": None if result.interval_95 is None else list(result.interval_95),
        "method": result.method,
        "steps": [step_result_to_json(step) for step in result.steps],
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
    }


def write_predictions(columns: Mapping[str, Sequence[Any]], path: Path) -> None:
    """Write predictions as Parquet: time_s, axis, channel, model ("before" or "after"), value [channel's unit]."""
    pyarrow.parquet.write_table(pa.table(dict(columns)), path)
