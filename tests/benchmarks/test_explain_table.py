"""The table of planted against answered: what counts as right, its rates, and that a campaign goes on where it was."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.benchmarks import explain_table
from tests.benchmarks.measuring import Record, fingerprint
from tests.undeclared import generate
from tests.undeclared.effects import LIBRARY
from tests.undeclared.machine import Steps


def row(planted: str, first: str, rivals: list[list[str]] | None = None, name: str = "a-000") -> Record:
    """A record of one pair."""
    return {
        "name": name, "source": "s", "planted": planted, "answer": first, "first": first, "rivals": rivals or [],
        "ratio_before": 2.0, "ratio_after": 1.5, "ratio_expected": 1.2, "before_um": 3.0, "after_um": 0.1, "axes": 1,
        "cpu_s": 9.0, "peak_mb": 300.0, "backlash_um": 30.0, "covered": first == planted,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("planted", "first", "rivals", "correct"),
    [
        ("sensor_gain", "sensor_gain", [], True),
        ("sensor_gain", "sensor_bias", [], False),
        ("sensor_gain", "none", [], False),
        ("sensor_gain", "compliance", [["compliance", "sensor_gain"]], True),
        ("clipping", "unknown", [], True),
        ("clipping", "sensor_gain", [], False),
        ("none", "none", [], True),
        ("none", "unknown", [], False),
    ],
)
def test_right_is_the_planted_name_and_unknown_for_what_the_library_lacks(
    planted: str, first: str, rivals: list[list[str]], correct: bool
) -> None:
    assert explain_table.right(row(planted, first, rivals)) is correct


def test_a_pair_that_is_refused_is_not_right() -> None:
    refused = {"name": "a-000", "planted": "none", "answer": "refused", "why": "two rates"}
    assert not explain_table.right(refused)


@pytest.mark.parametrize(
    ("backlash", "before", "after", "good"),
    [
        (30.0, 3.0, 0.9, True),
        (30.0, 3.0, 1.1, False),
        (100.0, 3.0, 1.9, True),
        (100.0, 15.0, 1.9, False),
        (100.0, 20.0, 1.9, True),
    ],
)
def test_a_backlash_is_corrected_to_a_micrometre_or_two_percent_and_to_a_tenth_of_a_large_error(
    backlash: float, before: float, after: float, good: bool
) -> None:
    one = row("sensor_gain", "sensor_gain") | {
        "backlash_um": backlash,
        "before_um": before,
        "after_um": after,
    }
    assert explain_table.corrected(one) is good


def test_the_rates_are_of_the_three_kinds_of_machines(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [row("sensor_gain", "sensor_gain"), row("sensor_gain", "none"), row("clipping", "unknown")]
    explain_table.tabulate([*rows, row("none", "none"), row("none", "none"), row("none", "sensor_bias")])
    printed = capsys.readouterr().out
    assert "in the library: right name     1 of 2, 50.0%" in printed
    assert "outside of it: unknown         1 of 1, 100.0%" in printed
    assert "clean: nothing found           2 of 3, 66.7%" in printed
    assert "held-out RMS         0 of 1 at most 1.3 of the noise" in printed
    assert "1 of 1 at most 1.3 of what is expected of the right model" in printed
    assert "backlash after               1 of 1 corrected" in printed
    assert "backlash in its interval, named  1 of 2" in printed
    assert "where nothing was found        2 of 3" in printed
    assert "where it is unknown what       0 of 1" in printed
    assert "1 axes: CPU time median 9 s" in printed


@pytest.mark.parametrize(
    ("interval", "covered"),
    [((29e-6, 31e-6), True), ((30.1e-6, 31e-6), False), ((28e-6, 29.9e-6), False), (None, True)],
)
def test_a_backlash_is_covered_by_its_interval(interval: tuple[float, float] | None, covered: bool) -> None:
    assert explain_table.covers(interval, 30e-6) is covered


def test_a_campaign_goes_on_with_the_same_numerics_and_captures_only(tmp_path: Path) -> None:
    results, now = tmp_path / "results.jsonl", fingerprint(*explain_table.NUMERICS)
    asked = tmp_path / "seed-2" / "none-000-truth.json"
    known = row("none", "none", name="none-000") | {"truth": str(asked), "source": now}
    older = known | {"source": "older", "first": "x"}
    elsewhere = known | {"truth": str(tmp_path / "seed-1" / asked.name), "first": "x"}
    results.write_text("".join(json.dumps(one) + "\n" for one in (known, older, elsewhere)))
    assert list(explain_table.run([asked], results, 1)) == [known]


def test_a_campaign_that_is_stopped_prints_its_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stopped(*_: object) -> Iterator[Record]:
        yield row("sensor_gain", "sensor_gain")
        raise KeyboardInterrupt

    monkeypatch.setattr(explain_table, "run", stopped)
    monkeypatch.setattr(explain_table, "complete", lambda _path: True)
    for name in ("a", "b", "c"):
        (tmp_path / f"{name}-truth.json").touch()
    explain_table.main(["--folder", str(tmp_path), "--work", str(tmp_path / "work")])
    printed = capsys.readouterr().out
    assert "stopped after 1 of 3 pairs" in printed
    assert "in the library: right name     1 of 1, 100.0%" in printed


def test_one_machine_of_every_kind_comes_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tests.undeclared.draw.Steps", lambda length, jerk: Steps(length, jerk, 1, 0.02))
    arguments = [
        "--effects",
        "sensor_bias",
        "--count",
        "2",
        "--clean",
        "2",
        "--seed",
        "5",
        "--work",
        str(tmp_path),
    ]
    files = explain_table.made(explain_table.parsed(arguments))
    assert [f.name.removesuffix("-truth.json") for f in files] == [
        "messy-000", "none-000", "sensor_bias-000", "sensor_bias-001",
    ]  # fmt: skip
    assert all(explain_table.complete(f) for f in files)
    again = {f: f.stat().st_mtime_ns for f in files}
    assert {f: f.stat().st_mtime_ns for f in explain_table.made(explain_table.parsed(arguments))} == again
    (files[0].parent / "messy-000-train.parquet").unlink()
    assert not explain_table.complete(files[0])


def test_every_effect_of_the_generator_is_planted() -> None:
    for kind in explain_table.EFFECTS:
        assert generate.cases(generate.Campaign(kind, 10, 1, pairs=True), 0)


def test_two_effects_at_once_are_two_of_the_library_and_the_same_for_a_seed() -> None:
    kinds = explain_table.two_each(20, 7)
    assert kinds == explain_table.two_each(20, 7)
    assert kinds != explain_table.two_each(20, 8)
    for one, other in (kind.split("+") for kind in kinds):
        assert one != other
        assert {one, other} <= set(LIBRARY)
