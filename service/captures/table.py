"""Tidy rows (``time_s, axis, channel, value``) to traces and back; the order of rows means nothing."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from service.captures.errors import CaptureContentError
from service.recording import FloatArray, Trace

COLUMNS = ("time_s", "axis", "channel", "value")
NUMBERS = ("time_s", "value")

_WRITER = "Correct the tool that wrote the file"


def checked(table: pa.Table, path: Path) -> pa.Table:
    """The four columns of the format, complete and of the right types, or CaptureContentError."""
    missing = [name for name in COLUMNS if name not in table.column_names]
    if missing:
        raise CaptureContentError(
            path,
            f"column {', '.join(missing)} is missing (found: {', '.join(table.column_names) or 'none'})",
            "A capture is one row per sample, not one column per signal; export it in the tidy form",
        )
    table = table.select(COLUMNS)
    if table.num_rows == 0:
        raise CaptureContentError(
            path,
            "it holds no samples",
            "The recorder was stopped before the first frame arrived, or wrote nothing; record again",
        )
    for name in COLUMNS:
        _check_column(name, table.column(name), path)
    return table


def _check_column(name: str, column: pa.ChunkedArray, path: Path) -> None:
    wanted = "float64" if name in NUMBERS else "string"
    if not (pa.types.is_float64(column.type) if name in NUMBERS else _is_text(column.type)):
        raise CaptureContentError(path, f"column {name} is {column.type}, not {wanted}", _WRITER)
    if column.null_count:
        raise CaptureContentError(
            path,
            f"column {name} has {column.null_count} empty cells",
            "A lost sample is a missing row, not an empty one; leave those rows out",
        )


def _is_text(type_: pa.DataType) -> bool:
    inner = type_.value_type if pa.types.is_dictionary(type_) else type_
    return bool(
        pa.types.is_string(inner) or pa.types.is_large_string(inner) or pa.types.is_string_view(inner)
    )


def to_traces(table: pa.Table, path: Path) -> dict[tuple[str, str], Trace]:
    """Traces by (axis, channel), each in order of time and without doubled rows."""
    time, value = (_numbers(table.column(name).combine_chunks()) for name in NUMBERS)
    axis_code, axes = _codes(table.column("axis"))
    channel_code, channels = _codes(table.column("channel"))
    key = axis_code * len(channels) + channel_code
    order = np.lexsort((value, time, key))
    time, value, key = time[order], value[order], key[order]
    starts = np.flatnonzero(np.diff(key, prepend=-1))
    ends = np.append(starts[1:], len(key))
    traces = {}
    for first, last in zip(starts, ends, strict=True):
        name = (axes[key[first] // len(channels)], channels[key[first] % len(channels)])
        traces[name] = _trace(time[first:last], value[first:last], name, path)
    return traces


def _numbers(values: pa.Array) -> FloatArray:
    """By the exchange protocol, since Arrow's own conversion imports pandas, 40 MB, wherever that is installed."""
    return np.asarray(np.from_dlpack(values), np.float64)


def _codes(column: pa.ChunkedArray) -> tuple[np.ndarray[tuple[int], np.dtype[np.int64]], list[str]]:
    is_coded = pa.types.is_dictionary(column.type)
    coded = (column.unify_dictionaries() if is_coded else pc.dictionary_encode(column)).combine_chunks()
    names = coded.dictionary.to_pylist()
    # A name may stand twice in a dictionary.
    first = np.array([names.index(name) for name in names], np.int64)
    return first[np.from_dlpack(coded.indices)], names


def _trace(time: FloatArray, value: FloatArray, name: tuple[str, str], path: Path) -> Trace:
    """One channel from its rows sorted by time, then value; the same row twice counts once."""
    label = "/".join(name)
    bad = int(np.count_nonzero(~(np.isfinite(time) & np.isfinite(value))))
    if bad:
        raise CaptureContentError(
            path,
            f"{bad} of {len(time)} samples of {label} are NaN or infinite",
            "A sensor reported 'invalid', or an export divided by zero; leave such rows out as lost samples",
        )
    again = np.diff(time, prepend=-np.inf) == 0
    doubled = again & (np.diff(value, prepend=np.nan) == 0)
    if np.any(again & ~doubled):
        at = time[again & ~doubled][0]
        raise CaptureContentError(
            path,
            f"{label} has two different values at {at:.6f} s",
            "Two recordings were joined, or time_s was rounded; write one row per sample with its full time",
        )
    return Trace(np.ascontiguousarray(time[~doubled]), np.ascontiguousarray(value[~doubled]))


def from_traces(traces: Mapping[tuple[str, str], Trace]) -> pa.Table:
    """All samples as rows. A sample without a finite value is a lost one and has no row."""
    columns: dict[str, list[pa.Array]] = {name: [] for name in COLUMNS}
    axes, channels = (sorted({key[i] for key in traces}) for i in (0, 1))
    for (axis, channel), trace in sorted(traces.items()):
        sound = np.isfinite(trace.time) & np.isfinite(trace.value)
        n = int(np.count_nonzero(sound))
        columns["time_s"].append(pa.array(trace.time[sound], pa.float64()))
        columns["axis"].append(_repeated(axes, axis, n))
        columns["channel"].append(_repeated(channels, channel, n))
        columns["value"].append(pa.array(trace.value[sound], pa.float64()))
    text = pa.dictionary(pa.int32(), pa.string())
    types = {"time_s": pa.float64(), "axis": text, "channel": text, "value": pa.float64()}
    return pa.table({name: pa.chunked_array(parts, type=types[name]) for name, parts in columns.items()})


def _repeated(names: list[str], name: str, n: int) -> pa.DictionaryArray:
    return pa.DictionaryArray.from_arrays(
        np.full(n, names.index(name), np.int32), pa.array(names, pa.string())
    )
