"""What `flankwatch plan` promises beside what the fit attains with the proposed step on machines of another simulator.

    python tests/benchmarks/plan_promise.py [--machines N] [--seed S]

Machines are drawn as for the accuracy benchmark, whose simulator shares no code with the product. Per expected
backlash: the proposed step, the half width it promises, and of the machines the median error, the median half
width that the fit gives, and how often the error was within the promise.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from service.backlash.estimate import refined
from service.backlash.excitation import Limits, Proposal
from service.backlash.step_information import Sensing
from service.captures import read_capture
from service.planning import planned
from tests.undeclared import generate
from tests.undeclared.machine import Steps

LIMITS = Limits(v=1.5, a=10.0, jerk=300.0, travel=0.01)
NOISE = 0.05


def attained(found: Proposal, b: float, machines: int, seed: int) -> list[tuple[float, float]]:
    """Error and half width [m] of each machine that was not refused, with the proposed step and a gap of b."""
    campaign = generate.Campaign("single", machines, seed)
    steps = Steps(length=found.length, jerk=found.jerk, count=found.steps)
    cases = [case for index in range(machines) for case in generate.cases(campaign, index)]
    cases = [
        replace(
            case,
            machines=[m | {"backlash": b} for m in case.machines],
            pure=[m | {"backlash": b} for m in case.pure],
            sensor=case.sensor | {"noise": NOISE, "speed_hz": 1000.0, "acceleration_hz": 4000.0, "lost": 0.0},
            steps=steps,
        )
        for case in cases
    ]
    traces, firsts, _ = generate.simulate_batch(cases)
    out = []
    with tempfile.TemporaryDirectory() as folder:
        for case, first in zip(cases, firsts, strict=True):
            made = generate.channels(case, traces, first)
            generate.write_case(campaign, Path(folder), case, traces, first, made)
            (result,) = refined(read_capture(Path(folder) / f"{case.name}.parquet"))
            if result.backlash is not None and result.interval_95 is not None:
                out.append((result.backlash - b, 0.5 * (result.interval_95[1] - result.interval_95[0])))
    return out


def main(arguments: Sequence[str] | None = None) -> None:
    """Print one line per expected backlash."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--machines", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    heads = ("gap µm", "SL mm", "j m/s³", "steps", "promised", "error", "half", "within", "answered")
    print(" ".join(f"{head:>8}" for head in heads))
    for b in (15e-6, 50e-6, 150e-6):
        found = planned(LIMITS, Sensing(noise=NOISE), b, 1)
        if not isinstance(found, Proposal):
            print(f"{b * 1e6:7.0f} no step: {found.limit}")
            continue
        got = np.array(attained(found, b, options.machines, options.seed))
        if not len(got):
            print(f"{b * 1e6:7.0f} every run was refused")
            continue
        error, half = np.abs(got[:, 0]), got[:, 1]
        print(
            f"{b * 1e6:8.0f} {found.length * 1e3:8.1f} {found.jerk:8.0f} {found.steps:8d} "
            f"{found.half_width * 1e6:8.3f} {np.median(error) * 1e6:8.3f} {np.median(half) * 1e6:8.3f} "
            f"{np.mean(error <= found.half_width):8.0%} {len(got)} of {options.machines}",
            flush=True,
        )


if __name__ == "__main__":
    main()
