"""Write a recording in the capture format, straight to Parquet."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.random import Generator

from tests.undeclared.machine import Steps
from tests.undeclared.sensors import Channel

Recorded = Mapping[str, Mapping[str, Channel]]


def metadata(
    names: Sequence[str], transmission: float, s: Mapping[str, float], steps: Steps, gantry: bool
) -> dict[str, Any]:
    """Return the `capture` object of the capture format for axes of one build."""
    gear = round(0.03 / transmission, 9)
    drive = {
        "motor_speed": s["speed_hz"],
        "acceleration": s["acceleration_hz"],
        "motor_torque": s["speed_hz"],
    }
    axes = [
        {
            "name": n,
            "motion": "linear",
            "transmission": transmission,
            "pinion_diameter_m": 0.06,
            "gear_ratio": gear,
            "rates_hz": drive,
        }
        for n in names
    ]
    about = {
        "format": 1,
        "machine": "undeclared",
        "recorded_at": "2026-11-21T22:00:00Z",
        "axes": axes,
        "moves": _moves(steps),
    }
    return about | ({"gantry": [list(names)]} if gantry else {})


def _moves(steps: Steps) -> list[dict[str, float]]:
    return [
        {
            "start_s": float(start),
            "direction": 1 if k % 2 == 0 else -1,
            "length_m": steps.length,
            "jerk_m_s3": steps.jerk,
            "duration_s": float(steps.period),
        }
        for k, start in enumerate(steps.starts)
    ]


def write(path: Path, channels: Recorded, about: Mapping[str, Any], rng: Generator | None = None) -> None:
    """Write the capture; `rng` shuffles its rows, whose order means nothing."""
    parts = [(axis, name, t, v) for axis, by_name in channels.items() for name, (t, v) in by_name.items()]
    order = rng.permutation(sum(t.size for *_, t, _ in parts)) if rng else slice(None)
    columns = {
        "time_s": pa.array(np.concatenate([t for *_, t, _ in parts])[order]),
        "axis": pa.array(
            np.concatenate([np.full(t.size, a) for a, _, t, _ in parts])[order]
        ).dictionary_encode(),
        "channel": pa.array(
            np.concatenate([np.full(t.size, c) for _, c, t, _ in parts])[order]
        ).dictionary_encode(),
        "value": pa.array(np.concatenate([v for *_, v in parts])[order]),
    }
    table = pa.table(columns).replace_schema_metadata({"capture": json.dumps(about)})
    pq.write_table(table, path)
