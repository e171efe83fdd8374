"""Accuracy of every method beside its rivals: the table of the estimator's goals, in one command.

    python tests/benchmarks/accuracy.py                      60 captures a row, all methods; makes its captures itself
    python tests/benchmarks/accuracy.py --count 140 --jobs 2  a long campaign; started again, it goes on
    python tests/benchmarks/accuracy.py --every 20            a glimpse
    python tests/benchmarks/accuracy.py --folder DIR          captures of your own with STEM-truth.json beside each

Rows are single axes, gantries, both with small impurities that the model lacks, the shared captures, and faults
that must be refused. `service` is what the product reports: the fit, or the plain value where the fit's refusal
speaks of the fit alone. Errors are of the axes that were answered; `draw_accuracy` makes the README's picture of the
records.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.benchmarks.campaign import ROWS, Campaign, run
from tests.benchmarks.measuring import METHODS
from tests.benchmarks.tabulate import print_tables

CHEAP = ("paper", "contact_regression", "output_at_rest", "constant_output_speed", "speed_curves")


def campaign_of(options: argparse.Namespace) -> Campaign:
    """The campaign that the command line asks for."""
    rows = tuple(options.rows.split(","))
    if options.folder is not None:
        rows = (str(options.folder.resolve()),)
    return Campaign(
        options.work,
        rows,
        tuple(options.methods.split(",")),
        options.count,
        options.seed,
        options.every,
        options.jobs,
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rows", default=",".join(ROWS), help=f"of {', '.join(ROWS)}")
    parser.add_argument("--methods", default=",".join((*CHEAP, "model_fit")), help=f"of {', '.join(METHODS)}")
    parser.add_argument("--count", type=int, default=60, help="captures per row")
    parser.add_argument("--seed", type=int, default=1, help="of the generator; another one, other machines")
    parser.add_argument("--every", type=int, default=1, help="only each n-th capture of a row")
    parser.add_argument("--jobs", type=int, default=1, help="processes at once")
    parser.add_argument("--folder", type=Path, help="a folder of captures with truth instead of the rows")
    parser.add_argument("--work", type=Path, default=Path("build/accuracy"), help="for captures and records")
    print_tables(run(campaign_of(parser.parse_args(arguments))))


if __name__ == "__main__":
    main()
