"""``flankwatch``: the command line. One function per command; what a command needs is imported when it runs.

Exit status: 0 done, 1 something could not be read or done (said on stderr), 2 wrong usage.
With ``--json`` stdout carries JSON and nothing else; progress and complaints go to stderr.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

if TYPE_CHECKING:
    from service.backlash.results import AxisResult

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Backlash monitoring of rack-and-pinion axes: ten short steps, the motor's speed and an accelerometer.",
)

ConfigOption = Annotated[
    Path, typer.Option("--config", "-c", help="Configuration of the machine (TOML).", envvar="FLANKWATCH_CONFIG")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON (SI units) on stdout, nothing else.")]

DEFAULT_CONFIG = Path("/etc/flankwatch/flankwatch.toml")


def main() -> None:
    """Entry point of the installed command."""
    app()


def complain(message: str) -> None:
    """Say on stderr what went wrong."""
    Console(stderr=True, soft_wrap=True, highlight=False).print(message, markup=False)


def progress_bar() -> Progress:
    """A progress bar on stderr, shown only where a person looks."""
    console = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
        disable=not console.is_terminal,
        transient=True,
    )


@app.command()
def analyze(
    files: Annotated[list[Path], typer.Argument(help="Captures: Parquet, or CSV with a .json beside it.")],
    as_json: JsonOption = False,
) -> None:
    """Determine the backlash in recorded runs, of this machine or of any other."""
    from service.backlash.estimate import estimate
    from service.captures import CaptureError, read_capture
    from service.captures.report import axis_result_to_json

    failed = False
    with progress_bar() as bar:
        for path in bar.track(files, description="analyse"):
            try:
                results = estimate(read_capture(path))
            except CaptureError as error:
                complain(str(error))
                failed = True
                continue
            if as_json:
                print_json({"capture": str(path), "axes": [axis_result_to_json(result) for result in results]})
            else:
                print_results(str(path), results)
    if failed:
        raise typer.Exit(1)


def print_json(value: Any) -> None:
    """One JSON object on one line of stdout; NaN is a programming error."""
    sys.stdout.write(json.dumps(value, allow_nan=False) + "\n")
    sys.stdout.flush()


def print_results(title: str, results: Iterable[AxisResult]) -> None:
    """A table for a person: value and interval in µm, or the reason of the refusal in a sentence."""
    table = Table(title=title, title_justify="left", title_style="bold")
    for heading, justify in (("axis", "left"), ("backlash µm", "right"), ("95 % µm", "right"), ("steps", "right")):
        table.add_column(heading, justify="right" if justify == "right" else "left")
    table.add_column("method")
    table.add_column("says", overflow="fold")
    for result in results:
        usable = sum(step.verdict == "ok" for step in result.steps)
        table.add_row(
            result.axis,
            "–" if result.backlash is None else f"{result.backlash * 1e6:.2f}",
            _interval_text(result.interval_95),
            f"{usable}/{len(result.steps)}",
            result.method,
            result.detail or result.verdict,
        )
    Console(soft_wrap=False).print(table)


def _interval_text(interval: tuple[float, float] | None) -> str:
    return "–" if interval is None else f"{interval[0] * 1e6:.2f} … {interval[1] * 1e6:.2f}"


if __name__ == "__main__":
    main()
