"""A backup put back in the store's place, with what stood there moved aside and never deleted."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from sqlalchemy import func, select

from service.store import tables
from service.store.database import (
    backups,
    open_for_reading,
    require_known_revision,
    sync,
    take_writers_lock,
    vacuum_into,
    verify,
)  # fmt: skip
from service.store.errors import StoreError


class NoBackupError(StoreError):
    """There is no backup that could be put back."""


@dataclass(frozen=True)
class Backup:
    """A sound backup: how many runs it holds, and when the last of them ended (None without runs)."""

    path: Path
    runs: int
    last_run: datetime | None


@dataclass(frozen=True)
class Restored:
    """What was done: the backup that is the store now, and where the store before was put (None: there was none)."""

    backup: Backup
    aside: Path | None


def read_backup(path: Path) -> Backup:
    """Check a backup from end to end and say what it holds. Raises StoreCorruptError, StoreTooNewError."""
    verify(path)
    require_known_revision(path)
    runs = tables.runs.c
    with open_for_reading(path) as connection:
        row = connection.execute(select(func.count(), func.max(runs.finished_at_utc))).one()
    return Backup(path, row[0], row[1])


def newest_sound(folder: Path, stem: str) -> Backup:
    """The newest backup that passes its check. Raises NoBackupError."""
    found = backups(folder, stem)
    for path in found:
        try:
            return read_backup(path)
        except StoreError:
            continue
    raise NoBackupError(
        f"none of the {len(found)} backups in {folder} is sound: the disk may be failing. Look for copies that were "
        "made elsewhere, and name one with --from"
        if found
        else f"there are no backups in {folder}: the service makes one a day, beside its store. Look whether the "
        "configuration names the right directory, or name a copy with --from"
    )


def restore(store: Path, backup: Backup, at: datetime) -> Restored:
    """Make the backup the store; what stands in its place, sound or not, is moved aside with its journal.

    Raises
    ------
    StoreInUseError : the service runs on the store.
    StoreCorruptError : the backup could not be copied whole; nothing was changed.
    """
    lock_file = take_writers_lock(store)
    try:
        half = store.with_name(store.name + ".new")
        vacuum_into(backup.path, half)
        aside = _move_aside(store, at)
        half.replace(store)
        sync(store.parent)
        return Restored(backup, aside)
    finally:
        lock_file.close()


def _move_aside(store: Path, at: datetime) -> Path | None:
    aside = store.with_name(f"{store.stem}.replaced-{at.astimezone(UTC):%Y%m%dT%H%M%S}{store.suffix}")
    for ending in ("-wal", "-shm", "-journal"):
        part = store.with_name(store.name + ending)
        if part.exists():
            part.rename(aside.with_name(aside.name + ending))
    if not store.exists():
        return None
    store.rename(aside)
    return aside
