"""The accuracy benchmark in small: it makes its captures, measures, goes on where it was, and draws."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.benchmarks import accuracy, draw_accuracy
from tests.benchmarks.campaign import Campaign, records, run
from tests.benchmarks.measuring import Record, crossed_both_ways
from tests.benchmarks.tabulate import limits, line, print_tables, service


def record(method: str, true: float, found: float | None, half: float = 1e-6, row: str = "single") -> Record:
    """A record of one axis [m]."""
    return {
        "row": row, "path": f"{true}.parquet", "capture": f"{true}.parquet",
        "axis": "X1", "method": method, "axes": 1, "true_m": true,
        "verdict": "refused" if found is None else "ok", "answered_by": method, "reason": None, "detail": None,
        "backlash_m": found, "interval_95_m": None if found is None else [found - half, found + half],
        "cpu_s": 0.1, "peak_mb": 100.0, "source": "s", "both_ways": True,
    }  # fmt: skip


def test_a_line_counts_what_it_says() -> None:
    found = [record("paper", 50e-6, 50.1e-6), record("paper", 60e-6, 62e-6), record("paper", 70e-6, None)]
    cells = line("single", "paper", found).split()
    assert cells[:4] == ["single", "paper", "3", "1"]
    assert [float(c) for c in cells[4:7]] == pytest.approx([1.05, 1.9, 2.0], abs=0.011)
    assert cells[8:12] == ["50.0", "50.0", "50.0", "1.00"]


def test_the_limits_are_the_issues() -> None:
    assert limits(record("paper", 100e-6, None)) == pytest.approx((0.5e-6, 0.3e-6))
    assert limits(record("paper", 30e-6, None, row="impure"))[0] == 1e-6
    assert limits(record("paper", 30e-6, None) | {"axes": 2}) == (1e-6, 0.5e-6)


def test_a_gap_that_the_truth_crosses_one_way_is_no_sound_run(capsys: pytest.CaptureFixture[str]) -> None:
    truth = {"backlash_m": {"X1": 3e-5, "X2": 4e-5}, "moves_that_cross": {"X1": 10, "X2": 5}}
    assert crossed_both_ways(truth, 10) == {"X1": True, "X2": False}
    assert crossed_both_ways({"backlash_m": {"X1": 3e-5}}, 10) == {"X1": True}
    one_way = record("model_fit", 40e-6, None) | {"both_ways": False}
    print_tables([record("model_fit", 50e-6, 50e-6), record("model_fit", 60e-6, None), one_way])
    printed = capsys.readouterr().out
    assert "what crosses its gap both ways: 1 of 2 axes (50.0%), 1 of 2 runs" in printed
    assert printed.count("(crosses one way only, by the truth)") == 1


def test_the_service_reports_the_fit_or_the_plain_value_beside_a_refusal_of_the_fit_alone() -> None:
    both = [record("paper", 5e-5, 4.8e-5), record("model_fit", 5e-5, 5.01e-5)]
    left = [record("paper", 6e-5, 5.8e-5), record("model_fit", 6e-5, None) | {"reason": "interval_too_wide"}]
    gone = [record("paper", 7e-5, 1.6e-5), record("model_fit", 7e-5, None) | {"reason": "gap_not_crossed"}]
    assert [r["backlash_m"] for r in service([*both, *left, *gone])] == [5.01e-5, 5.8e-5, None]


def test_the_whole_way_in_small(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [
        "--rows",
        "single",
        "--count",
        "1",
        "--methods",
        "paper,speed_curves",
        "--work",
        str(tmp_path),
    ]
    accuracy.main(arguments)
    printed = capsys.readouterr().out
    assert [text.split()[:3] for text in printed.splitlines()[2:]] == [
        ["single", "paper", "1"],
        ["single", "speed_curves", "1"],
    ]
    before = (tmp_path / "results.jsonl").read_text()
    run(Campaign(tmp_path, ("single",), ("paper", "speed_curves"), 1))
    assert (tmp_path / "results.jsonl").read_text() == before


def test_the_picture_shows_both_methods(tmp_path: Path) -> None:
    file, out = tmp_path / "results.jsonl", tmp_path / "accuracy.svg"
    rows = [record("paper", 5e-5, 4.8e-5), record("model_fit", 5e-5, 5.01e-5)]
    file.write_text("\n".join(json.dumps(row) for row in rows) + "\n")
    draw_accuracy.main([str(file), "-o", str(out)])
    drawn = out.read_text()
    assert records(file) == rows
    assert "1 single axes" in drawn
    assert drawn.count(f'fill="{draw_accuracy.PAPER}" fill-opacity') == 3
    assert drawn.count(f'fill="{draw_accuracy.OURS}" fill-opacity') == 3
