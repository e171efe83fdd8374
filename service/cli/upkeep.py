"""Commands on the store: backup, restore. The service makes a backup a day by itself."""

from __future__ import annotations

import os
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from service.cli.common import DEFAULT_CONFIG, ConfigOption, complain, settings_of

if TYPE_CHECKING:
    from service.config import Settings
    from service.store.restoring import Backup


def backup(
    folder: Annotated[Path, typer.Argument(help="Where to write it, e.g. a drive that is taken away.")],
    config: ConfigOption = DEFAULT_CONFIG,
) -> None:
    """Write a checked backup of the store, also while the service runs. The captures are files of their own."""
    from service.store.database import vacuum_into
    from service.store.errors import StoreError

    storage = settings_of(config).storage
    target = folder / f"{storage.database.stem}-{datetime.now(UTC):%Y%m%dT%H%M%S}.sqlite"
    if not storage.database.is_file():
        complain(
            f"{storage.database} is absent: there is nothing to back up; `flankwatch restore` puts a backup back"
        )
        raise typer.Exit(1)
    try:
        vacuum_into(storage.database, target)
    except (StoreError, OSError) as error:
        complain(f"no backup was made: {error}")
        raise typer.Exit(1) from None
    Console(highlight=False, soft_wrap=True).print(
        f"{target}\nThe recordings are not in it; copy {storage.captures} as well.", markup=False
    )


def restore(
    config: ConfigOption = DEFAULT_CONFIG,
    source: Annotated[
        Path | None, typer.Option("--from", help="Backup to put back; the newest sound one if not given.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
) -> None:
    """Put a backup in the store's place; what stands there is kept aside. The service must be stopped."""
    from service.store.errors import StoreError
    from service.store.restoring import newest_sound, read_backup
    from service.store.restoring import restore as put_back

    settings = settings_of(config)
    storage = settings.storage
    _require_owner(storage.directory)
    try:
        chosen = (
            newest_sound(storage.backups, storage.database.stem) if source is None else read_backup(source)
        )
        console = Console(highlight=False, soft_wrap=True)
        console.print(_said(settings, chosen), markup=False)
        if not yes:
            typer.confirm(f"Put it in the place of {storage.database}?", abort=True)
        done = put_back(storage.database, chosen, datetime.now(UTC))
    except (StoreError, OSError) as error:
        complain(str(error))
        raise typer.Exit(1) from None
    kept = f"What stood there is kept as {done.aside}." if done.aside else "Nothing stood there."
    console.print(f"{chosen.path} is the store now. {kept} Start the service again.", markup=False)


def _said(settings: Settings, chosen: Backup) -> str:
    """What a backup holds, and what will be missing after it is put back."""
    said = f"{chosen.path}: sound, {chosen.runs} runs"
    if chosen.last_run is None:
        return said
    said += f", the last of {chosen.last_run:%Y-%m-%d %H:%M} UTC"
    later = [
        path for path in settings.storage.captures.rglob("*.parquet")
        if ".explanation-" not in path.name and path.stat().st_mtime > chosen.last_run.timestamp() + 60
    ]  # fmt: skip
    if later:
        said += (
            f"\n{len(later)} recordings are newer. Their values will not be in the history; the recordings stay "
            "where they are, and `flankwatch analyze` reads them"
        )
    return said


def _require_owner(directory: Path) -> None:
    """A file that root puts there cannot be written by the service's user."""
    if os.geteuid() == 0 and directory.exists() and directory.stat().st_uid != 0:
        complain(
            f"{directory} belongs to {directory.owner()}: run this as that user, sudo -u {directory.owner()} …"
        )
        raise typer.Exit(1)
