"""Write campaigns of captures.

`python -m tests.undeclared.generate --kind KIND --count N --seed S --out DIR [--pairs] [--any-sensors]`, where KIND is
`single`, `gantry`, `impure`, `impure_gantry`, `none`, `messy`, an effect (or several, joined by +), `gantry-EFFECT` (a
declared gantry, one of whose axes has the effect) or `fault-NAME`.
"""

from __future__ import annotations

import argparse
import json
import sys
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from tests.undeclared import capture, draw, sensors
from tests.undeclared.draw import Machine
from tests.undeclared.effects import CLEAN, GANTRY_COUPLING, elsewhere, impure, named
from tests.undeclared.faults import FAULTS, Channels, weak_moves
from tests.undeclared.machine import TICK, Array, Steps, Traces, simulate

LANES = 120
"""Lanes simulated at once: more gain little speed and cost 12 MB each."""
ON_ONE_SIDE = "gantry-"
"""What a kind begins with that plants an effect on one axis of a declared gantry."""
SMALLEST, LARGEST = 12e-6, 175e-6
"""Range of the gaps [m]."""


@dataclass(frozen=True)
class Case:
    """One recording to be made: its lanes (planted and pure), its sensors (and what is planted there), its moves, and
    the lane that has what is planted (None: all)."""

    name: str
    part: str
    machines: list[Machine]
    pure: list[Machine]
    sensor: Machine
    planted: Machine
    steps: Steps
    declared: bool
    seed: int
    struck: int | None = None

    def sensor_of(self, lane: int) -> Machine:
        """The sensors of one lane with what is planted there."""
        return self.sensor | (self.planted if self.struck in (None, lane) else {})


@dataclass(frozen=True)
class Campaign:
    """What is asked for on the command line; pairs have good sensors unless `any_sensors` may be drawn."""

    kind: str
    count: int
    seed: int
    pairs: bool = False
    any_sensors: bool = False

    @property
    def effect(self) -> str:
        """Effect to plant, `none` for the campaigns of the estimator."""
        plain = self.kind in ("single", "gantry") or self.kind.startswith("fault-")
        return "none" if plain else self.kind.removeprefix(ON_ONE_SIDE)

    @property
    def fault(self) -> str:
        """Name of the fault, or the empty string."""
        return self.kind.removeprefix("fault-") if self.kind.startswith("fault-") else ""

    @property
    def two_axes(self) -> bool:
        """Whether the machine is a gantry."""
        return self.one_side or self.kind in ("gantry", "impure_gantry", GANTRY_COUPLING, "fault-swapped")

    @property
    def one_side(self) -> bool:
        """Whether one axis of a declared gantry has the effect."""
        return self.kind.startswith(ON_ONE_SIDE)


def gaps(index: int, count: int, rng: Generator) -> float:
    """Draw a gap from its share of the logarithmic range, so that a campaign covers all of it."""
    return float(SMALLEST * (LARGEST / SMALLEST) ** ((index + rng.uniform()) / count))


def cases(c: Campaign, index: int) -> list[Case]:
    """Return the recordings of one machine: one, or train and validate."""
    rng = np.random.default_rng([c.seed, index, zlib.crc32(c.kind.encode())])
    machines = _machines(c, index, rng)
    struck = int(rng.integers(2)) if c.one_side else None
    planted, of_sensor = _plant(c, rng, machines[struck or 0])
    good = c.pairs and c.kind != "gantry" and not c.any_sensors
    sensor = sensors.draw(rng, good)
    names = ("train", "validate") if c.pairs else ("",)
    steps = draw.move_pair(rng) if c.pairs else (draw.moves(rng),)
    made = []
    for k, (part, moves) in enumerate(zip(names, steps, strict=True)):
        pure = machines if k == 0 else [elsewhere(rng, m) for m in machines]
        change = planted if k == 0 else elsewhere(rng, planted)
        change = {n: v for n, v in change.items() if n != "flank"}
        moved = weak_moves(c.fault, machines[0], moves)
        seed = int(rng.integers(2**31))
        declared = len(machines) == 2 and c.kind != GANTRY_COUPLING
        name = f"{c.kind}-{index:03d}"
        full = [m | change if struck in (None, k) else m for k, m in enumerate(pure)]
        made.append(Case(name, part, full, list(pure), sensor, of_sensor, moved, declared, seed, struck))
    return made


def _machines(c: Campaign, index: int, rng: Generator) -> list[Machine]:
    if c.two_axes:
        other = float(np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))))
        pair = (gaps(index, c.count, rng), other)
        low = 3e-5 if c.one_side or c.kind == GANTRY_COUPLING else 0.0
        made = draw.gantry(rng, (max(pair[0], low), max(pair[1], low)))
        swap = rng.uniform() < 0.5
        return (
            [made[0] | {"backlash": made[1]["backlash"]}, made[1] | {"backlash": made[0]["backlash"]}]
            if swap
            else made
        )
    gap = gaps(index, c.count, rng)
    made_one = draw.axis(rng, max(gap, 3e-5) if c.pairs else gap)
    if c.fault in ("too_slow", "too_short"):
        made_one |= {"fc": max(made_one["fc"], 0.5 * made_one["m_load"]), "backlash": max(gap, 4e-5)}
    return [made_one]


def _plant(c: Campaign, rng: Generator, machine: Machine) -> tuple[Machine, Machine]:
    if c.kind == "impure_gantry":
        return impure(rng, machine)
    if c.effect == GANTRY_COUPLING:
        return {}, {}
    return named(c.effect)(rng, machine)


def batches(all_cases: Sequence[Case]) -> list[list[Case]]:
    """Cut the cases into batches of at most LANES lanes."""
    cut: list[list[Case]] = [[]]
    for case in all_cases:
        if sum(len(k.machines) for k in cut[-1]) + len(case.machines) > LANES:
            cut.append([])
        cut[-1].append(case)
    return cut


def channels(case: Case, traces: Traces, first: int) -> Channels:
    """Record the lanes of a case; the same seed gives the same noise whatever was planted."""
    made: Channels = {}
    for k, m in enumerate(case.machines):
        rng = np.random.default_rng([case.seed, k])
        made[f"X{k + 1}"] = sensors.record(rng, traces, first + k, case.steps.end, m, case.sensor_of(k))
    return made


def in_moves(times: Array, steps: Steps) -> NDArray[np.bool_]:
    """Return which times (n,) lie in a move or the 50 ms after it."""
    since = (times - steps.rest) % (steps.period + steps.rest)
    return (times > steps.rest) & (since < steps.period + 0.05)


def deviation(case: Case, planted: Channels, pure: Channels) -> float:
    """Return what the effect changes in the acceleration [m/s²] (RMS over axes, during the moves), before any refit."""
    squares = []
    for axis in planted:
        (t, with_it), (t2, without) = planted[axis]["acceleration"], pure[axis]["acceleration"]
        if t.size == t2.size:
            squares.append(np.mean((with_it - without)[in_moves(t, case.steps)] ** 2))
    return float(np.sqrt(np.mean(squares))) if squares else 0.0


def simulate_batch(batch: Sequence[Case], twins: bool = False) -> tuple[Traces, list[int], int]:
    """Simulate a batch, and its machines without what was planted in lanes of their own where `twins` are wanted.

    Returns
    -------
    traces, first lane of every case, distance in lanes to the twins
    """
    lanes = [m for case in batch for m in case.machines]
    moves = [case.steps for case in batch for _ in case.machines]
    if twins:
        lanes, moves = lanes + [m for case in batch for m in case.pure], moves * 2
    firsts = np.cumsum([0, *(len(case.machines) for case in batch)]).tolist()
    return simulate(lanes, moves), firsts[:-1], firsts[-1]


def crossed(traces: Traces, lane: int, m: Machine, steps: Steps) -> list[float]:
    """Return the width of the gap [m] where each pass took place: it differs from `backlash` on a worn rack."""
    if not m.get("gap_wave"):
        return [m["backlash"]] * steps.count
    widths = []
    for start in steps.starts:
        ticks = slice(int((start + 0.45 * steps.period) / TICK), int((start + 0.75 * steps.period) / TICK))
        x = traces.load_position[ticks, lane]
        wave = m["backlash"] + m["gap_wave"] * np.sin(2 * np.pi * x / m["wave_gap"] + m["phase_gap"])
        offset = np.abs(traces.flank[ticks, lane] - m["backlash"] * (0.5 - m["flank"]))
        inside = offset < wave / 2
        widths.append(float(np.mean(wave[inside])) if np.any(inside) else float(m["backlash"]))
    return widths


def passes(traces: Traces, lane: int, m: Machine, steps: Steps) -> int:
    """Return in how many moves the flank crosses the whole gap, before the move ends."""
    side = np.clip(
        (traces.flank[:, lane] - m["backlash"] * (0.5 - m["flank"])) / (0.49 * m["backlash"]), -1, 1
    )
    count = 0
    for k, start in enumerate(steps.starts):
        during = side[int((start + 0.2 * steps.period) / TICK) : int((start + steps.period) / TICK)]
        forwards = during if k % 2 == 0 else -during
        driving = np.flatnonzero(forwards >= 1)
        count += bool(driving.size and np.any(forwards[driving[0] :] <= -1))
    return count


def truth(
    c: Campaign, case: Case, widths: dict[str, list[float]], crossings: dict[str, int]
) -> dict[str, Any]:
    """Return the truth of a recording; `axis`, `machine` and `sensors` hold every parameter of the first axis, or of
    the one that has the effect."""
    at = case.struck or 0
    first = case.machines[at]
    changed = {k: v for k, v in first.items() if case.pure[at].get(k) != v}
    clean = c.effect in CLEAN or c.kind == "impure_gantry"
    return {
        "effect": "none" if clean else c.effect,
        "effects": [] if clean else c.effect.split("+"),
        "effect_axis": None if case.struck is None or clean else f"X{at + 1}",
        "fault": c.fault or None,
        "seed": c.seed,
        "messy": c.kind in ("messy", "impure", "impure_gantry"),
        "backlash_m": {axis: float(np.mean(w)) for axis, w in widths.items()},
        "steps_backlash_m": widths,
        "moves_that_cross": crossings,
        "axis": first,
        "planted": changed | case.planted,
        "machine": {k: v for k, v in first.items() if k.endswith(("_base", "_hung", "_c"))},
        "sensors": case.sensor | case.planted,
    }


def write_case(
    c: Campaign, out: Path, case: Case, traces: Traces, first: int, made: Channels
) -> dict[str, Any]:
    """Write one recording and return its truth."""
    rng = np.random.default_rng([case.seed, 99])
    if c.fault:
        made = FAULTS[c.fault](rng, made)
    sensor = case.sensor | case.planted
    about = capture.metadata(list(made), case.machines[0]["transmission"], sensor, case.steps, case.declared)
    shuffled = rng if rng.uniform() < 0.25 else None
    stem = f"{case.name}-{case.part}" if case.part else case.name
    capture.write(out / f"{stem}.parquet", made, about, shuffled)
    widths = {f"X{k + 1}": crossed(traces, first + k, m, case.steps) for k, m in enumerate(case.machines)}
    crossings = {f"X{k + 1}": passes(traces, first + k, m, case.steps) for k, m in enumerate(case.machines)}
    return truth(c, case, widths, crossings)


def merge(first: dict[str, Any], second: dict[str, Any]) -> dict[str, Any]:
    """Return the truth of a pair: the gap is the mean of both recordings, each keeps its own beside it."""
    mean = {a: (first["backlash_m"][a] + second["backlash_m"][a]) / 2 for a in first["backlash_m"]}
    parts = {part: t["backlash_m"] for part, t in (("train", first), ("validate", second))}
    return first | {"backlash_m": mean, "backlash_by_recording_m": parts}


def generate(c: Campaign, out: Path) -> int:
    """Write the campaign into `out`; return how many recordings there are."""
    out.mkdir(parents=True, exist_ok=True)
    every = [case for index in range(c.count) for case in cases(c, index)]
    truths: dict[str, dict[str, Any]] = {}
    twins = c.pairs and c.effect not in ("none", GANTRY_COUPLING)
    for batch in batches(every):
        traces, firsts, distance = simulate_batch(batch, twins)
        for case, first in zip(batch, firsts, strict=True):
            made = channels(case, traces, first)
            told = write_case(c, out, case, traces, first, made)
            if twins:
                without = channels(replace(case, machines=case.pure, planted={}), traces, first + distance)
                told["deviation_m_s2"] = deviation(case, made, without)
            truths[case.name] = merge(truths[case.name], told) if case.name in truths else told
    for name, told in truths.items():
        (out / f"{name}-truth.json").write_text(json.dumps(told, indent=1))
    return len(every)


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse the command line and write the campaign."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--kind", required=True)
    parser.add_argument("--count", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--pairs", action="store_true")
    parser.add_argument(
        "--any-sensors", action="store_true", help="pairs with slow, noisy and lossy sensors, too"
    )
    a = parser.parse_args(arguments)
    written = generate(Campaign(a.kind, a.count, a.seed, a.pairs, a.any_sensors), a.out)
    sys.stdout.write(f"{written} recordings of {a.kind} in {a.out}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
