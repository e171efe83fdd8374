"""``flankwatch``: the command line. One function per command; what a command needs is imported when it runs.

Exit status: 0 done, 1 something could not be read or done (said on stderr), 2 wrong usage.
With ``--json`` stdout carries JSON and nothing else; progress and complaints go to stderr.
"""

from __future__ import annotations

import os

import typer

from service.cli import machine, planning, recordings, upkeep

__all__ = ["app", "main"]

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
"""Whether numpy divides the sum of a product among the cores; it reads them when it is imported."""

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Backlash monitoring of rack-and-pinion axes: ten short steps, the motor's speed and an accelerometer.",
)
for _command in (
    recordings.analyze,
    recordings.explain,
    machine.demo,
    machine.serve,
    machine.check,
    machine.check_config,
    planning.plan,
    recordings.picture,
    upkeep.backup,
    upkeep.restore,
):
    app.command()(_command)


def main() -> None:
    """Entry point of the installed command.

    Its matrices are small: threads win nothing, and the order of a sum would tell the cores of a machine.
    """
    for variable in ONE_THREAD:
        os.environ.setdefault(variable, "1")
    app()
