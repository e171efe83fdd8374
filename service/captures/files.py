"""Captures on disk: Parquet, or CSV with a JSON object beside it; read whole, written atomically.

A file appears under its name only when all of it is on the disk, so a crash in mid-write leaves the
capture before it, or none, but never half of one.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from service.captures import metadata, table
from service.captures.errors import (
    CaptureChangedError,
    CaptureContentError,
    CaptureMetadataError,
    CaptureUnreadableError,
)
from service.recording import Move, Recording, Trace

METADATA_KEY = b"capture"


def read_capture(path: Path | str, expected_sha256: str | None = None) -> Recording:
    """Read a capture (``.csv`` by its name, Parquet otherwise), SI; CaptureError when it cannot be used.

    With ``expected_sha256`` the bytes must be those that were written; CaptureChangedError otherwise.
    """
    path = Path(path)
    if expected_sha256 is not None:
        _check_sha256(path, expected_sha256)
    rows, text = _read_csv(path) if _is_csv(path) else _read_parquet(path)
    described = metadata.parse(text, path)
    traces = table.to_traces(table.checked(rows, path), path)
    recording = Recording(traces=traces, **metadata.to_header(described))
    _check_axes(recording, path)
    _check_moves(recording.moves, traces, path)
    return recording


def write_capture(recording: Recording, path: Path | str) -> str:
    """Write a recording atomically (``.csv`` by its name, Parquet otherwise); its sha256 as hex digits."""
    path = Path(path)
    described = metadata.from_recording(recording)
    rows = table.from_traces(recording.traces)
    if _is_csv(path):
        _atomically(
            _sidecar(path), lambda to: to.write_text(json.dumps(described, indent=1), encoding="utf-8")
        )
        _atomically(path, lambda to: pyarrow.csv.write_csv(_as_text(rows), to))
    else:
        rows = rows.replace_schema_metadata({METADATA_KEY: json.dumps(described)})
        _atomically(path, lambda to: pyarrow.parquet.write_table(rows, to, compression="zstd"))
    return sha256(path)


def sha256(path: Path | str) -> str:
    """Checksum of a capture as hex digits; of a CSV with its JSON object, both files one after the other."""
    path = Path(path)
    digest = hashlib.sha256(_bytes(path))
    if _is_csv(path):
        digest.update(_bytes(_sidecar(path)))
    return digest.hexdigest()


def _is_csv(path: Path) -> bool:
    return path.suffix.lower() == ".csv"


def _sidecar(path: Path) -> Path:
    return path.with_suffix(".json")


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        advice = "Check the name, and that this user may read it"
        raise CaptureUnreadableError(path, f"cannot be read ({error.strerror})", advice) from error


def _check_sha256(path: Path, expected: str) -> None:
    found = sha256(path)
    if found != expected:
        raise CaptureChangedError(
            path,
            f"its sha256 is {found[:12]}…, stored was {expected[:12]}…",
            "The file was edited or the disk is failing; restore it from a backup",
        )


def _read_parquet(path: Path) -> tuple[pa.Table, bytes]:
    buffer = pa.BufferReader(_bytes(path))
    try:
        rows = pyarrow.parquet.ParquetFile(buffer).read()
    except (pa.ArrowException, OSError) as error:
        raise CaptureUnreadableError(
            path,
            f"is not a whole Parquet file ({str(error).splitlines()[0]:.120})",
            "It was cut short in writing or copying, or is of another kind (CSV ends in .csv); copy it again",
        ) from error
    text = (rows.schema.metadata or {}).get(METADATA_KEY)
    if text is None:
        raise CaptureMetadataError(
            path,
            "its schema metadata has no key 'capture'",
            "It was saved again by a tool that drops schema metadata, or is not a capture; use the original",
        )
    return rows, text


def _read_csv(path: Path) -> tuple[pa.Table, bytes]:
    types = {name: pa.float64() if name in table.NUMBERS else pa.string() for name in table.COLUMNS}
    options = pyarrow.csv.ConvertOptions(column_types=types)
    try:
        rows = pyarrow.csv.read_csv(pa.BufferReader(_bytes(path)), convert_options=options)
    except pa.ArrowException as error:
        raise CaptureContentError(
            path,
            f"is not a table of numbers ({str(error).splitlines()[0]:.120})",
            "Write a header line, decimal points and commas between cells: time_s,axis,channel,value",
        ) from error
    beside = _sidecar(path)
    if not beside.is_file():
        advice = "A CSV needs its metadata object in a file of the same stem ending in .json; put it there"
        raise CaptureMetadataError(path, f"{beside.name} is absent", advice)
    return rows, _bytes(beside)


def _as_text(rows: pa.Table) -> pa.Table:
    types = [pa.float64() if name in table.NUMBERS else pa.string() for name in table.COLUMNS]
    return rows.cast(pa.schema(list(zip(table.COLUMNS, types, strict=True))))


def _check_axes(recording: Recording, path: Path) -> None:
    described = {axis.name for axis in recording.axes}
    strangers = sorted({axis for axis, _ in recording.traces} - described)
    if strangers:
        raise CaptureContentError(
            path,
            f"rows of axis {', '.join(strangers)}, but the metadata describes {', '.join(sorted(described))}",
            "Without its transmission the axis cannot be read; add it to 'axes', or correct the name",
        )


def _check_moves(moves: tuple[Move, ...], traces: dict[tuple[str, str], Trace], path: Path) -> None:
    """At least one move must lie in the recording: it may be cut short, but not be on another clock."""
    if not moves:
        return
    first = min(trace.time[0] for trace in traces.values())
    last = max(trace.time[-1] for trace in traces.values())
    if not any(move.start < last and move.end > first for move in moves):
        span = f"{first:.3f} to {last:.3f} s"
        raise CaptureMetadataError(
            path,
            f"every move lies outside the recording ({span}; the first starts at {moves[0].start:.3f} s)",
            "start_s counts from another zero or in another unit than time_s; both are seconds of one clock",
        )


def _atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Write beside the target, force it to the disk, then take its name."""
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        write(temporary)
        temporary.chmod(0o644)
        _force_to_disk(temporary)
        temporary.replace(path)
        _force_to_disk(path.parent)
    finally:
        temporary.unlink(missing_ok=True)


def _force_to_disk(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
