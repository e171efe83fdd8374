"""``flankwatch``: the command line. One function per command; what a command needs is imported when it runs.

Exit status: 0 done, 1 something could not be read or done (said on stderr), 2 wrong usage.
With ``--json`` stdout carries JSON and nothing else; progress and complaints go to stderr.
"""

from __future__ import annotations

import typer

from service.cli import machine, planning, recordings, upkeep

__all__ = ["app", "main"]

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
    """Entry point of the installed command."""
    app()
