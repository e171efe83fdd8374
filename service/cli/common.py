"""What every command shares: complaints on stderr, JSON on stdout, a progress bar, the configuration."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

if TYPE_CHECKING:
    from service.config import Settings

ConfigOption = Annotated[
    Path,
    typer.Option("--config", "-c", help="Configuration of the machine (TOML).", envvar="FLANKWATCH_CONFIG"),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON (SI units) on stdout, nothing else.")]
UrlOption = Annotated[str, typer.Option(help="Where the service listens.", envvar="FLANKWATCH_URL")]

LOCAL_SERVICE = "http://127.0.0.1:8470"
DEFAULT_CONFIG = Path("/etc/flankwatch/flankwatch.toml")


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


def advance(bar: Progress, task: TaskID, done: int, total: int, text: str) -> None:
    """Show that ``done`` of ``total`` steps are made; 0 of 0 where nobody knows how many."""
    bar.update(task, completed=done, total=total or None, description=text)


def print_json(value: Any) -> None:
    """One JSON object on one line of stdout; NaN is a programming error."""
    sys.stdout.write(json.dumps(value, allow_nan=False) + "\n")
    sys.stdout.flush()


def settings_of(path: Path) -> Settings:
    """Read a configuration, or end with what is wrong with it."""
    from service.config import ConfigError, load_settings

    try:
        return load_settings(path)
    except ConfigError as error:
        complain(str(error))
        raise typer.Exit(1) from None
