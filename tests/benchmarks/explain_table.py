"""Planted against answered: the whole loop over machines with an undeclared effect, and the table of issue and answer.

    python tests/benchmarks/explain_table.py                 10 machines per effect, 50 clean ones; makes its captures
    python tests/benchmarks/explain_table.py --jobs 2        the same; stopped (Ctrl-C) it prints the table so far,
                                                             started again, it goes on
    python tests/benchmarks/explain_table.py --effects stribeck_friction,clipping --count 2 --clean 0    a glimpse
    python tests/benchmarks/explain_table.py --effects= --clean 0 --two 10    ten machines with two effects each
    python tests/benchmarks/explain_table.py --folder DIR    pairs NAME-train / -validate / -truth of your own

The captures are made by the generator of `tests/undeclared`, which shares no code with the product; what is planted is
in its library, outside of it (the right answer is then ``unknown``), or nothing, half of those machines with impurities
too small to matter. One machine of every effect comes after the other, so that a campaign that was stopped is a smaller
one. A pair counts as right where the planted effect is named first, or is one of two that are called indistinguishable,
and of several planted effects where all and no others are named; the backlash as corrected where it is within 1 um or 2
%, and ten times nearer if it was more than 10 um off before. The last held-out RMS is also printed over what is
expected of the right model: the noise of the motor's speed moves the load, too, and the moves that were fitted tell its
numbers only so well.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from service.captures import read_capture
from service.dynamics.effects.driven_library import DRIVEN
from service.identification.explain import explain
from service.identification.explanation import AxisExplanation, CannotExplain
from tests.benchmarks.campaign import GENERATOR
from tests.benchmarks.measuring import Record, fingerprint, forget_peak, peak_mb
from tests.undeclared import generate
from tests.undeclared.effects import GANTRY_COUPLING, LIBRARY, OUTSIDE

NUMERICS = ("service/identification", "service/backlash", "service/dynamics")
EFFECTS = (*LIBRARY, GANTRY_COUPLING, *OUTSIDE)
CLEAN = ("none", "messy")


@dataclass(frozen=True)
class Pair:
    """A pair by its truth file, and the fingerprint of the numerics that answer it."""

    truth: str
    source: str

    @property
    def name(self) -> str:
        return Path(self.truth).name.removesuffix("-truth.json")


def answer(pair: Pair) -> Record:
    """Planted and answered of one pair, with errors, CPU time and peak memory."""
    path = Path(pair.truth)
    truth = json.loads(path.read_text())
    recordings = [
        read_capture(path.with_name(f"{pair.name}-{part}.parquet")) for part in ("train", "validate")
    ]
    row: Record = {
        "truth": pair.truth,
        "name": pair.name,
        "source": pair.source,
        "planted": truth.get("effect") or "none",
    }
    forget_peak()
    start = time.process_time()
    try:
        said = answered(explain(recordings[:1], recordings[1]).axes, truth)
    except CannotExplain as refusal:
        said = {"answer": "refused", "why": str(refusal)}
    spent = {"axes": len(recordings[0].axes), "cpu_s": time.process_time() - start, "peak_mb": peak_mb()}
    return row | said | spent


def answered(axes: Sequence[AxisExplanation], truth: Record) -> Record:
    """What was found on the first axis, and the errors of all."""
    first = axes[0]
    # A gap that changes along the rack is reported where the moves that were fitted crossed it.
    planted = truth.get("backlash_by_recording_m", {}).get("train", truth["backlash_m"])
    errors = [
        (abs((a.before.backlash or 0.0) - planted[a.axis]), abs((a.after.backlash or 0.0) - planted[a.axis]))
        for a in axes
    ]
    return {
        "answer": " + ".join(first.effects) if first.finding == "effect" else first.finding,
        "first": first.effects[0] if first.finding == "effect" else first.finding,
        "rivals": [sorted(group) for group in first.indistinguishable],
        "ratio_before": first.before.validation_rms / first.noise_rms,
        "ratio_after": max(a.after.validation_rms / a.noise_rms for a in axes),
        "ratio_expected": max(a.after.validation_rms / (a.after.expected_rms or a.noise_rms) for a in axes),
        "before_um": 1e6 * max(e[0] for e in errors),
        "after_um": 1e6 * max(e[1] for e in errors),
        "backlash_um": 1e6 * min(planted[a.axis] for a in axes),
        "covered": all(covers(a.after.interval_95, planted[a.axis]) for a in axes),
    }


def covers(interval: tuple[float, float] | None, backlash: float) -> bool:
    """Whether a backlash lies in an interval; in none does any."""
    return interval is None or interval[0] <= backlash <= interval[1]


def right(row: Record) -> bool:
    """Whether the answer names what was planted, alone or as one of a pair that it calls indistinguishable; of several
    planted effects all, in any order, and no other."""
    expected = wanted(row)
    if "+" in expected:
        return set(str(row["answer"]).split(" + ")) == set(expected.split("+"))
    return row.get("first") == expected or any(expected in group for group in row.get("rivals", []))


def corrected(row: Record) -> bool:
    """Whether the backlash is within 1 um or 2 % after the effect was added, and ten times nearer where it was more
    than 10 um off before."""
    near = row["after_um"] <= max(1.0, 0.02 * row["backlash_um"])
    return bool(near and (row["before_um"] <= 10.0 or row["after_um"] <= 0.1 * row["before_um"]))


def wanted(row: Record) -> str:
    """The right answer."""
    planted = str(row["planted"])
    return planted if set(planted.split("+")) <= DRIVEN.keys() or planted == "none" else "unknown"


def show(row: Record) -> None:
    """One pair in a line."""
    mark = " " if right(row) else "!"
    if "first" not in row:
        print(f"{mark} {row['name']:36s} {row['answer']}: {row.get('why', '')}", flush=True)
        return
    print(
        f"{mark} {row['name']:36s} {row['answer']:44s} "
        f"RMS/noise {row['ratio_before']:7.2f} -> {row['ratio_after']:5.2f}  "
        f"over expected {row['ratio_expected']:5.2f}  "
        f"backlash error {row['before_um']:7.2f} -> {row['after_um']:6.2f} um  {row['cpu_s']:4.0f} s",
        flush=True,
    )


def tabulate(rows: Sequence[Record]) -> None:
    """By planted effect, then the rates and the dearest pairs."""
    table: dict[str, list[Record]] = defaultdict(list)
    for row in rows:
        table[row["planted"]].append(row)
    print(f"\n{'planted':30s} {'right':>9s}  answered")
    for planted, group in sorted(table.items()):
        score = f"{sum(map(right, group))}/{len(group)}"
        answers = Counter(str(row["answer"]) for row in group)
        print(f"{planted:30s} {score:>9s}  " + ", ".join(f"{n} {a}" for a, n in answers.most_common()))
    print()
    named = [row for row in rows if wanted(row) not in ("none", "unknown")]
    for group, what in (
        (named, "in the library: right name"),
        ([row for row in rows if wanted(row) == "unknown"], "outside of it: unknown"),
        ([row for row in rows if wanted(row) == "none"], "clean: nothing found"),
    ):
        if group:
            share = sum(map(right, group)) / len(group)
            print(f"{what:30s} {sum(map(right, group))} of {len(group)}, {share:.1%}")
    if found := [row for row in named if right(row)]:
        for what, ratio, of in (
            ("of those, held-out RMS", "ratio_after", "the noise"),
            ("", "ratio_expected", "what is expected of the right model"),
        ):
            described = sum(row[ratio] <= 1.3 for row in found)
            print(f"{what:30s} {described} of {len(found)} at most 1.3 of {of}")
        print(f"{'  backlash after':30s} {sum(map(corrected, found))} of {len(found)} corrected")
    for what, group in (
        ("backlash in its interval, named", [row for row in rows if row.get("first") in DRIVEN]),
        ("  where nothing was found", [row for row in rows if row.get("first") == "none"]),
        ("  where it is unknown what", [row for row in rows if row.get("first") == "unknown"]),
    ):
        if group:
            print(f"{what:32s} {sum(row['covered'] for row in group)} of {len(group)}")
    for axes in sorted({row["axes"] for row in rows}):
        spent = sorted(row["cpu_s"] for row in rows if row["axes"] == axes)
        peak = max(row["peak_mb"] for row in rows if row["axes"] == axes)
        half = spent[len(spent) // 2]
        print(f"{axes} axes: CPU time median {half:.0f} s, longest {spent[-1]:.0f} s; peak {peak:.0f} MB")


def made(options: argparse.Namespace) -> list[Path]:
    """The truth files of the campaign, made where they are not there yet; one machine of every kind after another."""
    kinds = dict.fromkeys(filter(None, options.effects.split(",")), options.count)
    kinds |= dict.fromkeys(two_each(options.two, options.seed), 1)
    kinds |= dict.fromkeys(CLEAN, options.clean // len(CLEAN)) if options.clean else {}
    files = []
    for kind, count in kinds.items():
        sensors = "-any-sensors" if options.any_sensors else ""
        folder = options.work / f"{kind}-{count}-{options.seed}{sensors}-{fingerprint(*GENERATOR)}"
        if not (folder / "done").exists():
            sys.stderr.write(f"generate {count} pairs of {kind} in {folder}\n")
            campaign = generate.Campaign(kind, count, options.seed, True, options.any_sensors)
            generate.generate(campaign, folder)
            (folder / "done").touch()
        files += list(folder.glob("*-truth.json"))
    return sorted(files, key=lambda path: (path.name.rsplit("-", 2)[1], path.name))


def two_each(count: int, seed: int) -> list[str]:
    """Kinds with two effects of the library at once, drawn at random; the same two may come again, and count once."""
    rng = np.random.default_rng(seed)
    return ["+".join(rng.choice(list(LIBRARY), 2, replace=False)) for _ in range(count)]


def complete(truth: Path) -> bool:
    """Whether both captures lie beside a truth."""
    stem = truth.name.removesuffix("-truth.json")
    return all(truth.with_name(f"{stem}-{part}.parquet").exists() for part in ("train", "validate"))


def run(files: Sequence[Path], results: Path, jobs: int) -> Iterator[Record]:
    """The records of all pairs: those that are there already, then the others as they come."""
    source = fingerprint(*NUMERICS)
    pairs = [Pair(str(path), source) for path in files]
    lines = results.read_text(encoding="utf-8").splitlines() if results.exists() else []
    known = {row["truth"]: row for row in map(json.loads, lines) if row["source"] == source}
    yield from (known[pair.truth] for pair in pairs if pair.truth in known)
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(variable, "1")  # "one core" is what the goals of time say
    left = [pair for pair in pairs if pair.truth not in known]
    if not left:
        return
    with multiprocessing.get_context("spawn").Pool(jobs) as pool, results.open("a", encoding="utf-8") as file:
        for row in pool.imap_unordered(answer, left):
            file.write(json.dumps(row) + "\n")
            file.flush()
            yield row


def parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    """What the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--effects", default=",".join(EFFECTS), help="to plant")
    parser.add_argument("--count", type=int, default=10, help="machines of each effect")
    parser.add_argument("--two", type=int, default=0, help="machines with two effects of the library at once")
    parser.add_argument("--clean", type=int, default=50, help="clean machines")
    parser.add_argument("--seed", type=int, default=1, help="of the generator; another one, other machines")
    parser.add_argument("--any-sensors", action="store_true", help="slow, noisy and lossy ones, too")
    parser.add_argument("--jobs", type=int, default=1, help="processes at once")
    parser.add_argument("--folder", type=Path, help="a folder of pairs with truth instead")
    parser.add_argument("--work", type=Path, default=Path("build/explain"), help="for captures and records")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run, print each pair as it is done, then the table."""
    options = parsed(arguments)
    options.work.mkdir(parents=True, exist_ok=True)
    files = made(options) if options.folder is None else sorted(options.folder.rglob("*-truth.json"))
    pairs, rows = [file for file in files if complete(file)], list[Record]()
    try:
        for row in run(pairs, options.work / "results.jsonl", options.jobs):
            show(row)
            rows.append(row)
    except KeyboardInterrupt:
        print(f"stopped after {len(rows)} of {len(pairs)} pairs")
    tabulate(rows)


if __name__ == "__main__":
    main()
