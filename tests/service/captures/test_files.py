"""Captures on disk: what is written is read again, and what cannot be used is refused in a sentence."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.captures import (
    CaptureChangedError,
    CaptureContentError,
    CaptureError,
    CaptureMetadataError,
    CaptureUnreadableError,
    read_capture,
    sha256,
    write_capture,
)
from service.recording import AxisDescription, Move, Recording, Trace

METADATA: dict[str, Any] = {
    "format": 1,
    "machine": "test bench",
    "recorded_at": "2026-11-20T22:00:00Z",
    "axes": [
        {
            "name": "X1",
            "motion": "linear",
            "transmission": 0.003,
            "pinion_diameter_m": 0.06,
            "gear_ratio": 10.0,
            "rates_hz": {"motor_speed": 1000.0},
        }
    ],
    "moves": [
        {"start_s": 0.001, "direction": 1, "length_m": 0.004, "jerk_m_s3": 200.0, "duration_s": 0.0862}
    ],
}
ROWS: dict[str, list[Any]] = {
    "time_s": [0.0, 0.001, 0.002, 0.0005, 0.0015],
    "axis": ["X1"] * 5,
    "channel": ["motor_speed"] * 3 + ["acceleration"] * 2,
    "value": [1.0, 2.0, 3.0, -0.5, 0.25],
}


def put(path: Path, rows: dict[str, Any] | pa.Table = ROWS, metadata: Any = METADATA) -> Path:
    """Write a capture by hand, without the service's code."""
    table = rows if isinstance(rows, pa.Table) else pa.table(rows)
    text = metadata if isinstance(metadata, str) else json.dumps(metadata)
    pyarrow.parquet.write_table(table.replace_schema_metadata({"capture": text}), path)
    return path


def described(**changes: Any) -> dict[str, Any]:
    return {**METADATA, **changes}


def full_recording() -> Recording:
    random = np.random.default_rng(0)
    time = np.cumsum(random.uniform(1e-4, 1e-3, 50))
    return Recording(
        machine="bench",
        axes=(
            AxisDescription("X1", 0.003, "linear", 0.06, 10.0, {"motor_speed": 1000.0}),
            AxisDescription("X2", 0.004),
        ),
        traces={
            ("X1", "motor_speed"): Trace(time, random.normal(0, 1e3, 50)),
            ("X1", "acceleration"): Trace(time[:40] + 1e-5, random.normal(0, 1e-9, 40)),
            ("X2", "load_position"): Trace(time[3:], random.normal(0, 1.0, 47)),
        },
        moves=(Move(0.001, 1, 0.004, 200.0, 0.0862), Move(0.01, -1, 0.004, 200.0, 0.0862)),
        gantry=(("X1", "X2"),),
        recorded_at=datetime(2026, 11, 20, 22, 0, 0, 123456, tzinfo=UTC),
        note="a note with µ",
        extra={"operator": {"shift": 2}, "axes": {"X2": {"serial": "A7"}}, "moves": {"1": {"slot": 4}}},
    )


def assert_same(one: Recording, other: Recording) -> None:
    assert replace(one, traces={}) == replace(other, traces={})
    assert set(one.traces) == set(other.traces)
    for key, trace in one.traces.items():
        assert np.array_equal(trace.time, other.traces[key].time)
        assert np.array_equal(trace.value, other.traces[key].value)


@pytest.mark.parametrize("name", ["run.parquet", "run.csv"])
def test_everything_written_is_read_again(tmp_path: Path, name: str) -> None:
    checksum = write_capture(full_recording(), tmp_path / name)
    assert_same(read_capture(tmp_path / name, checksum), full_recording())


def test_the_format_is_the_published_one(tmp_path: Path) -> None:
    """Read what was written with nothing but pyarrow and json."""
    write_capture(full_recording(), tmp_path / "run.parquet")
    table = pyarrow.parquet.read_table(tmp_path / "run.parquet")
    assert table.column_names == ["time_s", "axis", "channel", "value"]
    assert [str(t) for t in table.schema.types[::3]] == ["double", "double"]
    assert pa.types.is_dictionary(table.schema.field("axis").type)
    written = json.loads(table.schema.metadata[b"capture"])
    assert written["format"] == 1
    assert written["recorded_at"] == "2026-11-20T22:00:00.123456Z"
    assert written["gantry"] == [["X1", "X2"]]
    assert written["axes"][0]["pinion_diameter_m"] == 0.06
    assert written["axes"][1] == {
        "name": "X2", "motion": "linear", "transmission": 0.004, "rates_hz": {}, "serial": "A7"
    }  # fmt: skip
    assert written["moves"][1]["slot"] == 4
    assert written["operator"] == {"shift": 2}


def test_a_hand_written_capture_is_read(tmp_path: Path) -> None:
    recording = read_capture(put(tmp_path / "c.parquet"))
    assert recording.axis("X1").transmission == 0.003
    assert recording.moves[0].end == pytest.approx(0.0872)
    assert recording.traces["X1", "motor_speed"].value.tolist() == [1.0, 2.0, 3.0]
    assert recording.traces["X1", "acceleration"].time.tolist() == [0.0005, 0.0015]
    assert recording.recorded_at == datetime(2026, 11, 20, 22, tzinfo=UTC)


def test_a_hand_written_csv_is_read(tmp_path: Path) -> None:
    text = (
        "time_s,axis,channel,value\n0.001,X1,motor_speed,2\n0,X1,motor_speed,1\n0.002,X1,motor_speed,3.5e0\n"
    )
    (tmp_path / "c.csv").write_text(text)
    (tmp_path / "c.json").write_text(json.dumps(METADATA))
    trace = read_capture(tmp_path / "c.csv").traces["X1", "motor_speed"]
    assert trace.time.tolist() == [0.0, 0.001, 0.002]
    assert trace.value.tolist() == [1.0, 2.0, 3.5]


@settings(max_examples=30, deadline=None)
@given(st.permutations(range(10)), st.sets(st.integers(0, 9), max_size=4))
def test_neither_order_nor_doubled_rows_matter(
    tmp_path_factory: pytest.TempPathFactory, order: list[int], doubled: set[int]
) -> None:
    sound = {key: value * 2 for key, value in ROWS.items()}
    sound["axis"] = ["X1"] * 5 + ["X2"] * 5
    metadata = described(axes=[*METADATA["axes"], {"name": "X2", "transmission": 0.003}])
    folder = tmp_path_factory.mktemp("order")
    shuffled = [*order, *doubled]
    one = read_capture(put(folder / "a.parquet", sound, metadata))
    other = put(folder / "b.parquet", {k: [v[i] for i in shuffled] for k, v in sound.items()}, metadata)
    assert_same(one, read_capture(other))


def test_unknown_channels_and_keys_are_kept(tmp_path: Path) -> None:
    rows = {**ROWS, "channel": [*ROWS["channel"][:4], "temperature"]}
    path = put(tmp_path / "c.parquet", rows, described(weather="fair"))
    recording = read_capture(path)
    assert recording.traces["X1", "temperature"].value.tolist() == [0.25]
    write_capture(recording, tmp_path / "again.parquet")
    assert read_capture(tmp_path / "again.parquet").extra == {"weather": "fair"}


def test_a_sample_without_a_value_becomes_a_missing_row(tmp_path: Path) -> None:
    recording = full_recording()
    trace = recording.traces["X1", "motor_speed"]
    holed = np.where(np.arange(50) == 7, np.nan, trace.value)
    traces = {**recording.traces, ("X1", "motor_speed"): Trace(trace.time, holed)}
    write_capture(replace(recording, traces=traces), tmp_path / "c.parquet")
    assert len(read_capture(tmp_path / "c.parquet").traces["X1", "motor_speed"]) == 49


CHANGED_ROWS: dict[str, tuple[Callable[[], dict[str, Any] | pa.Table], str]] = {
    "missing column": (lambda: {k: v for k, v in ROWS.items() if k != "value"}, "column value is missing"),
    "one column per signal": (lambda: {"time_s": [0.0], "motor_speed": [1.0]}, "tidy form"),
    "text for numbers": (lambda: {**ROWS, "value": ["1"] * 5}, "column value is string"),
    "whole numbers for times": (lambda: {**ROWS, "time_s": [0, 1, 2, 0, 1]}, "column time_s is int64"),
    "codes for names": (lambda: {**ROWS, "axis": [1] * 5}, "column axis is int64"),
    "NaN": (
        lambda: {**ROWS, "value": [1.0, 2.0, float("nan"), 0.0, 0.0]},
        "1 of 3 samples of X1/motor_speed",
    ),
    "infinite": (lambda: {**ROWS, "time_s": [float("inf"), *ROWS["time_s"][1:]]}, "NaN or infinite"),
    "empty cell": (lambda: {**ROWS, "value": [None, 2.0, 3.0, 0.0, 0.0]}, "empty cells"),
    "no rows": (lambda: pa.table(ROWS).slice(0, 0), "holds no samples"),
    "two values at once": (
        lambda: {**ROWS, "time_s": [0.0, 0.001, 0.001, 0.0, 0.001]},
        "two different values",
    ),
    "unknown axis": (lambda: {**ROWS, "axis": ["X1"] * 4 + ["Y9"]}, "rows of axis Y9"),
}


@pytest.mark.parametrize("case", CHANGED_ROWS)
def test_bad_rows_are_refused(tmp_path: Path, case: str) -> None:
    rows, said = CHANGED_ROWS[case]
    path = put(tmp_path / "bad.parquet", rows())
    with pytest.raises(CaptureContentError) as caught:
        read_capture(path)
    assert said in str(caught.value)
    assert str(path) in str(caught.value)


AXIS, MOVE = METADATA["axes"][0], METADATA["moves"][0]
CHANGED_METADATA: dict[str, tuple[Any, str]] = {
    "not JSON": ("{", "metadata"),
    "another version": (described(format=2), "reads capture format 1"),
    "no version": ({k: v for k, v in METADATA.items() if k != "format"}, "format"),
    "no axes": (described(axes=[]), "axes"),
    "two axes of one name": (described(axes=[AXIS, AXIS]), "one name"),
    "transmission zero": (described(axes=[{**AXIS, "transmission": 0.0}]), "axes.0.transmission"),
    "transmission negative": (described(axes=[{**AXIS, "transmission": -0.003}]), "axes.0.transmission"),
    "transmission in mm": (
        described(axes=[{**AXIS, "transmission": 3.0}]),
        "pinion_diameter_m / (2 gear_ratio)",
    ),
    "negative rate": (
        described(axes=[{**AXIS, "rates_hz": {"motor_speed": -1000.0}}]),
        "rates_hz.motor_speed",
    ),
    "a rate as text": (
        described(axes=[{**AXIS, "rates_hz": {"motor_speed": "fast"}}]),
        "rates_hz.motor_speed",
    ),
    "unknown kind of motion": (described(axes=[{**AXIS, "motion": "spiral"}]), "motion"),
    "direction 2": (described(moves=[{**MOVE, "direction": 2}]), "moves.0.direction"),
    "direction 0": (described(moves=[{**MOVE, "direction": 0}]), "moves.0.direction"),
    "negative length": (described(moves=[{**MOVE, "length_m": -0.004}]), "moves.0.length_m"),
    "no duration": (described(moves=[{**MOVE, "duration_s": 0.0}]), "moves.0.duration_s"),
    "no jerk": (described(moves=[{k: v for k, v in MOVE.items() if k != "jerk_m_s3"}]), "moves.0.jerk_m_s3"),
    "moves on another clock": (described(moves=[{**MOVE, "start_s": 350.0}]), "outside the recording"),
    "moves before the recording": (described(moves=[{**MOVE, "start_s": -5.0}]), "outside the recording"),
    "gantry with a stranger": (described(gantry=[["X8", "X9"]]), "gantry"),
    "gantry of three": (described(gantry=[["X1", "X1", "X1"]]), "gantry"),
    "no such day": (described(recorded_at="2026-02-30T00:00:00Z"), "recorded_at"),
}


@pytest.mark.parametrize("case", CHANGED_METADATA)
def test_bad_metadata_is_refused(tmp_path: Path, case: str) -> None:
    metadata, said = CHANGED_METADATA[case]
    path = put(tmp_path / "bad.parquet", ROWS, metadata)
    with pytest.raises(CaptureMetadataError) as caught:
        read_capture(path)
    assert said in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_parquet_file_without_the_key_is_refused(tmp_path: Path) -> None:
    pyarrow.parquet.write_table(pa.table(ROWS), tmp_path / "plain.parquet")
    with pytest.raises(CaptureMetadataError, match="no key 'capture'"):
        read_capture(tmp_path / "plain.parquet")


def test_a_recording_cut_short_is_read_with_all_its_moves(tmp_path: Path) -> None:
    later = {**MOVE, "start_s": 0.5}
    assert len(read_capture(put(tmp_path / "c.parquet", ROWS, described(moves=[MOVE, later]))).moves) == 2


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 0.9, 0.999])
def test_a_truncated_file_is_refused(tmp_path: Path, share: float) -> None:
    path = tmp_path / "cut.parquet"
    write_capture(full_recording(), path)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(CaptureUnreadableError, match="cut short"):
        read_capture(path)


def test_a_file_with_a_damaged_page_is_refused_or_known_by_its_checksum(tmp_path: Path) -> None:
    path = tmp_path / "c.parquet"
    checksum = write_capture(full_recording(), path)
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 0xFF
    path.write_bytes(bytes(content))
    with pytest.raises(CaptureChangedError, match="sha256"):
        read_capture(path, checksum)


@pytest.mark.parametrize("name", ["other.parquet", "other.csv"])
def test_a_file_of_another_kind_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(bytes(range(256)) * 8)
    (tmp_path / "other.json").write_text(json.dumps(METADATA))
    with pytest.raises(CaptureError) as caught:
        read_capture(tmp_path / name)
    assert name in str(caught.value)


@pytest.mark.parametrize("name", ["absent.parquet", "absent.csv"])
def test_an_absent_file_is_named(tmp_path: Path, name: str) -> None:
    with pytest.raises(CaptureUnreadableError, match=name):
        read_capture(tmp_path / name)


def test_a_csv_without_its_metadata_is_refused(tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_text("time_s,axis,channel,value\n0,X1,motor_speed,1\n")
    with pytest.raises(CaptureMetadataError, match=r"c\.json is absent"):
        read_capture(tmp_path / "c.csv")


@pytest.mark.parametrize("cell", ["one", "1,5", ""])
def test_a_csv_of_another_locale_is_refused(tmp_path: Path, cell: str) -> None:
    (tmp_path / "c.csv").write_text(f"time_s,axis,channel,value\n0,X1,motor_speed,{cell}\n")
    (tmp_path / "c.json").write_text(json.dumps(METADATA))
    with pytest.raises(CaptureContentError):
        read_capture(tmp_path / "c.csv")


def test_the_checksum_is_that_of_the_bytes(tmp_path: Path) -> None:
    """SHA-256 of 'abc' is in FIPS 180-2, appendix B.1."""
    (tmp_path / "abc").write_bytes(b"abc")
    assert sha256(tmp_path / "abc") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


def test_an_edited_csv_sidecar_is_noticed(tmp_path: Path) -> None:
    checksum = write_capture(full_recording(), tmp_path / "c.csv")
    sidecar = tmp_path / "c.json"
    sidecar.write_text(sidecar.read_text().replace("0.003", "0.006"))
    with pytest.raises(CaptureChangedError):
        read_capture(tmp_path / "c.csv", checksum)


def test_a_failed_write_leaves_the_file_before_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "c.parquet"
    checksum = write_capture(full_recording(), path)

    def half(table: pa.Table, to: Path, **_: Any) -> None:
        Path(to).write_bytes(b"PAR1 half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pyarrow.parquet, "write_table", half)
    with pytest.raises(OSError, match="No space"):
        write_capture(full_recording(), path)
    assert sha256(path) == checksum
    assert [p.name for p in tmp_path.iterdir()] == ["c.parquet"]


def test_every_shared_capture_is_read_and_written_alike(shared_dir: Path, tmp_path: Path) -> None:
    files = sorted(shared_dir.glob("*/*.parquet"))
    assert files
    for file in files:
        recording = read_capture(file)
        write_capture(recording, tmp_path / "again.parquet")
        assert_same(read_capture(tmp_path / "again.parquet"), recording)
