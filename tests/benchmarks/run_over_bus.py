"""How fast the ten-step run goes over the virtual bus and without one, and how much memory the service takes.

    python tests/benchmarks/run_over_bus.py [--repeat N]

Machine time is what the simulated machine's clock says between connecting and the last rest; wall time is this
PC's. Both contain the simulated machine, its physics, the drivers and the decoding.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from service.app import house
from service.demo import demo_settings, open_demo
from service.dynamics.parameters import AxisParameters
from service.dynamics.simulation import simulate, ten_steps
from service.motion.messages import Progress
from service.store.records import Queued


def measure_runs(group: str, repeat: int) -> None:
    """Print wall time, machine time and their ratio for runs of one group."""
    settings = demo_settings(Path(tempfile.mkdtemp()))
    walls, steps_only, machine_times = [], [], []
    for _ in range(repeat):
        began: list[float] = []
        with open_demo(settings) as machine:
            start = time.perf_counter()
            recorded = machine.execute(group, lambda: None, partial(note_time, began))
            end = time.perf_counter()
        last = recorded.recording.moves[-1]
        walls.append(end - start)
        steps_only.append(end - began[0])
        machine_times.append(last.end + settings.excitation.rest_s)
    wall, stepping, machine_time = (statistics.median(v) for v in (walls, steps_only, machine_times))
    print(
        f"{group:>5} {machine_time:>10.2f} {stepping:>12.2f} {machine_time / stepping:>8.1f} "
        f"{wall:>14.2f} {machine_time / wall:>8.1f}"
    )


def note_time(times: list[float], _: Progress) -> None:
    """Remember when the run reported progress."""
    times.append(time.perf_counter())


def measure_physics(repeat: int) -> None:
    """Print the processor time in which the declared model simulates ten steps of one axis, and their machine time."""
    spent = []
    for _ in range(repeat):
        start = time.process_time()
        run = simulate(AxisParameters(), ten_steps())
        spent.append(time.process_time() - start)
    last = run.moves[-1]
    print(
        f"\nten steps of one axis, without a bus: {statistics.median(spent):.2f} s of processor time for "
        f"{last.start + last.duration:.1f} s of machine time"
    )


def measure_memory() -> None:
    """Print the peak resident memory of the service's processes over one run of each group."""
    settings = demo_settings(Path(tempfile.mkdtemp()))
    with house(settings, open_demo) as flankwatch:
        for group in settings.groups:
            answer = flankwatch.box.request(group)
            assert isinstance(answer, Queued)
            flankwatch.box.wait(answer.run_id, 120)
        flankwatch.web()
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    child = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    print(
        f"\npeak resident memory: service {own:.0f} MiB, largest of its two child processes {child:.0f} MiB"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=5, help="runs per group; medians are printed")
    repeat = parser.parse_args().repeat
    print(f"median of {repeat} runs; 'steps' from enabling to the end, 'all' with connecting the drives")
    print(f"{'group':>5} {'machine s':>10} {'steps wall s':>12} {'ratio':>8} {'all wall s':>14} {'ratio':>8}")
    for group in ("Y", "X"):
        measure_runs(group, repeat)
    measure_physics(repeat)
    measure_memory()


if __name__ == "__main__":
    main()
