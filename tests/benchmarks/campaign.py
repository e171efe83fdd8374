"""The captures of the accuracy benchmark, made where they are not there yet, and the records of what was measured.

Each row of the table is a folder of captures with their truth, by the generator of `tests/undeclared`, which
shares no code with the product; the row `declared` is the shared captures. Records are appended to a file of
JSON lines as they come, so that a campaign that was stopped goes on where it was.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.benchmarks.measuring import Record, Task, fingerprint, measured, warm_up
from tests.undeclared import generate

ROOT = Path(__file__).parents[2]

SOUND_ROWS = ("single", "gantry", "impure", "impure_gantry")
FAULTS = ("blocked", "swapped", "wrong_sign", "rpm", "g", "lost", "too_slow", "too_short")
ROWS = (*SOUND_ROWS, "declared", "faults")

NUMERICS = ("service/backlash", "service/dynamics", "tests/benchmarks")
GENERATOR = ("tests/undeclared",)


@dataclass(frozen=True)
class Campaign:
    """What is asked for: rows, captures per row, the generator's seed, methods, and where all of it lies.

    `every` takes only each n-th capture of a row; `jobs` processes work at once.
    """

    folder: Path
    rows: tuple[str, ...] = ROWS
    methods: tuple[str, ...] = ()
    count: int = 60
    seed: int = 1
    every: int = 1
    jobs: int = 1

    @property
    def results(self) -> Path:
        """The file of records."""
        return self.folder / "results.jsonl"


def kinds(row: str, count: int) -> dict[str, int]:
    """The generator's kinds of captures that make up a row, and how many of each."""
    if row == "faults":
        each = max(1, round(count / len(FAULTS)))
        return {f"fault-{fault}": each for fault in FAULTS}
    return {row: count}


def captures(campaign: Campaign, row: str) -> list[Path]:
    """Every capture of a row that has a truth; generated where it is not there yet."""
    if row == "declared":
        return sorted((ROOT / ".." / "shared" / "captures").resolve().glob("declared-*.parquet"))[
            :: campaign.every
        ]
    if Path(row).is_dir():
        found = sorted(Path(row).glob("*.parquet"))
        return [p for p in found if p.with_name(p.stem + "-truth.json").exists()][:: campaign.every]
    made = [
        _generated(campaign, kind, count)[:: campaign.every]
        for kind, count in kinds(row, campaign.count).items()
    ]
    return [path for paths in made for path in paths]


def _generated(campaign: Campaign, kind: str, count: int) -> list[Path]:
    """The captures of one kind; a folder that was not finished is made again."""
    folder = campaign.folder / f"{kind}-{count}-{campaign.seed}-{fingerprint(*GENERATOR)}"
    done = folder / "done"
    if not done.exists():
        sys.stderr.write(f"generate {count} captures of {kind} in {folder}\n")
        generate.generate(generate.Campaign(kind, count, campaign.seed), folder)
        done.touch()
    return sorted(folder.glob("*.parquet"))


def tasks(campaign: Campaign) -> list[Task]:
    """Every method on every capture, the dear ones last."""
    source = fingerprint(*NUMERICS)
    paths = {row: captures(campaign, row) for row in campaign.rows}
    return [
        Task(Path(row).name, str(path), method, source)
        for method in campaign.methods
        for row in campaign.rows
        for path in paths[row]
    ]


def records(path: Path, source: str | None = None) -> list[Record]:
    """The records of a file, of one version of the numerics only where one is asked for."""
    if not path.exists():
        return []
    found = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return [record for record in found if source is None or record["source"] == source]


def run(campaign: Campaign) -> list[Record]:
    """Do what of the campaign is not in its records yet; return the records of all of it."""
    campaign.folder.mkdir(parents=True, exist_ok=True)
    wanted = tasks(campaign)
    keys = {task.key for task in wanted}
    source = wanted[0].source if wanted else ""
    known = [r for r in records(campaign.results, source) if _key(r) in keys]
    measured_already = {_key(record) for record in known}
    left = [task for task in wanted if task.key not in measured_already]
    with campaign.results.open("a", encoding="utf-8") as file:
        for number, found in enumerate(_measured(left, campaign.jobs), 1):
            file.writelines(json.dumps(record) + "\n" for record in found)
            file.flush()
            known += found
            _tell(number, len(left))
    return known


def _key(record: Record) -> tuple[str, str, str]:
    return record["row"], record["path"], record["method"]


def _measured(left: Sequence[Task], jobs: int) -> Iterator[list[Record]]:
    """Records of each task as they come; one process per job, each warmed up with the fit's compiled code."""
    if not left:
        return
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(variable, "1")  # "one core" is what the goals of time say
    spawn, warming = multiprocessing.get_context("spawn"), _warming(left)
    with spawn.Pool(1) as compiler:  # compiling takes memory that is no part of an analysis
        compiler.apply(warm_up, (warming,))
    with spawn.Pool(jobs, warm_up, (warming,)) as pool:
        yield from pool.imap_unordered(measured, left)
        pool.close()
        pool.join()


def _warming(left: Iterable[Task]) -> list[Task]:
    """One task of the fit per row of sound machines that is about to be measured: single axes and gantries."""
    fits = [task for task in left if task.method == "model_fit"]
    return [
        next(t for t in fits if t.row == row)
        for row in ("single", "gantry")
        if any(t.row == row for t in fits)
    ]


def _tell(number: int, of: int) -> None:
    if sys.stderr.isatty():
        sys.stderr.write(f"\r{number} of {of} measured" + ("\n" if number == of else ""))
