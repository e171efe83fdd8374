"""The SQLite file: opened, checked, migrated, backed up.

One writer per file (a lock file for processes, a lock for threads) and read-only readers. The journal is WAL
with synchronous FULL, so that a committed run survives a kill and a power cut. A file that is damaged is
refused, never replaced: an empty history raises no alarm.
"""

from __future__ import annotations

import fcntl
import logging
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from types import ModuleType
from typing import IO, Any

from sqlalchemy import Connection, Engine, create_engine, event, inspect, text
from sqlalchemy.exc import DatabaseError

import migrations
from service.store.errors import StoreCorruptError, StoreInUseError, StoreTooNewError, StoreVanishedError

log = logging.getLogger(__name__)

WAL_SAFE = (3, 51, 3)
"""First SQLite without the WAL-reset bug, which can corrupt a file (sqlite.org/wal.html)."""


class Database:
    """One SQLite file with a writing engine and a read-only one; ``open_database`` builds it."""

    def __init__(self, path: Path, lock_file: IO[str]) -> None:
        """Take over an open, checked and migrated file."""
        self.path = path
        self._writer = _engine(path)
        self._reader = _engine(path, read_only=True)
        self._lock = threading.Lock()
        self._lock_file = lock_file

    @contextmanager
    def writing(self) -> Iterator[Connection]:
        """One transaction of the one writer: all of it or nothing."""
        with self._lock, self._writer.begin() as connection:
            yield connection

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """One consistent view, which waits for nobody."""
        with self._reader.begin() as connection:
            yield connection

    def backup(self, folder: Path, at: datetime, keep: int = 14) -> Path:
        """Write a backup by VACUUM INTO, check it, and drop the oldest beyond ``keep``; return its path."""
        target = folder / f"{self.path.stem}-{at:%Y%m%dT%H%M%S}.sqlite"
        vacuum_into(self.path, target)
        for old in backups(folder, self.path.stem)[keep:]:
            old.unlink()
        return target

    def close(self) -> None:
        """Close both engines and give the writer's lock back."""
        self._reader.dispose()
        self._writer.dispose()
        self._lock_file.close()


def open_database(path: Path, backup_folder: Path | None = None) -> Database:
    """Open the store's file, creating it where there never was one, and bring it to the newest revision.

    Raises
    ------
    StoreCorruptError, StoreVanishedError, StoreInUseError, StoreTooNewError
        See ``service.store.errors``; the message says what to do.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    folder = backup_folder or path.parent / "backups"
    lock_file = take_writers_lock(path)
    try:
        _prepare(path, folder)
        return Database(path, lock_file)
    except BaseException:
        lock_file.close()
        raise


def backups(folder: Path, stem: str) -> list[Path]:
    """Return the backups of a store in a folder, the newest first."""
    return sorted(folder.glob(f"{stem}-*.sqlite"), reverse=True)


def verify(path: Path) -> None:
    """Check a file from end to end: pages, indices, foreign keys, and that it is a store of ours.

    Raises
    ------
    StoreCorruptError
        When any check fails.
    """
    if not path.is_file() or path.stat().st_size == 0:
        raise StoreCorruptError(_corrupt(path, "it is empty"))
    engine = _engine(path, read_only=True)
    try:
        with engine.begin() as connection:
            _check(connection, path)
    except DatabaseError as error:
        raise StoreCorruptError(_corrupt(path, str(error.orig))) from error
    finally:
        engine.dispose()


def dbapi() -> ModuleType:
    """Return the newest SQLite at hand: pysqlite3 bundles its own, the system's is often years old."""
    try:
        import pysqlite3.dbapi2 as module
    except ImportError:
        import sqlite3 as module
    return module  # type: ignore[no-any-return]


def _engine(path: Path, *, read_only: bool = False) -> Engine:
    module = dbapi()
    engine = create_engine(f"sqlite:///{path}", module=module)
    # WAL is not worth a corrupt file: an old library gets the rollback journal, whose readers wait a little.
    journal = "WAL" if module.sqlite_version_info >= WAL_SAFE else "DELETE"
    event.listen(engine, "connect", lambda connection, _: _set_up(connection, journal, read_only))
    begin = "BEGIN" if read_only else "BEGIN IMMEDIATE"
    event.listen(engine, "begin", lambda connection: connection.exec_driver_sql(begin))
    return engine


def _set_up(connection: Any, journal: str, read_only: bool) -> None:
    """Set what a connection needs; isolation_level None leaves BEGIN to the engine's own event."""
    connection.isolation_level = None
    connection.execute("PRAGMA busy_timeout = 5000")
    if read_only:
        connection.execute("PRAGMA query_only = ON")
        return
    connection.execute(f"PRAGMA journal_mode = {journal}")
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute("PRAGMA foreign_keys = ON")


def take_writers_lock(path: Path) -> IO[str]:
    """Become the one writer of a store until the file is closed; StoreInUseError where there is one."""
    lock_file = path.with_name(path.name + ".lock").open("a", encoding="ascii")
    try:
        fcntl.flock(lock_file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        lock_file.close()
        raise StoreInUseError(
            f"another process writes to {path}: as a rule the service is running. Ask it through its API, "
            f"or stop it"
        ) from error
    return lock_file


def _prepare(path: Path, backup_folder: Path) -> None:
    """Leave a checked file of the newest revision at ``path``."""
    if not path.exists():
        _refuse_vanished(path, backup_folder)
        _create(path)
        return
    verify(path)
    _migrate(path, backup_folder)


def _refuse_vanished(path: Path, backup_folder: Path) -> None:
    known = backups(backup_folder, path.stem)
    wal = path.with_name(path.name + "-wal")
    if known or wal.exists():
        evidence = known[0] if known else wal
        raise StoreVanishedError(
            f"{path} is absent, though {evidence} shows that it was there: a wrong path, a disk that is not mounted, "
            "or a deleted file. Mount the disk, or put the newest backup back with `flankwatch restore`; to start "
            "with an empty history on purpose, move the backups away"
        )


def _create(path: Path) -> None:
    """Build a new file beside its place and move it there whole: a kill leaves no half-made store."""
    half = path.with_name(path.name + ".new")
    half.unlink(missing_ok=True)
    engine = _engine(half)
    try:
        with engine.begin() as connection:
            migrations.upgrade(connection)
    finally:
        engine.dispose()
    sync(half)
    half.replace(path)
    sync(path.parent)


def _migrate(path: Path, backup_folder: Path) -> None:
    """Bring an older file up, after a backup of it."""
    engine = _engine(path)
    try:
        newest = migrations.revisions()[0]
        if require_known_revision(path) == newest:
            return
        vacuum_into(path, backup_folder / f"{path.stem}-before-{newest}.sqlite")
        with engine.begin() as connection:
            migrations.upgrade(connection)
    finally:
        engine.dispose()


def require_known_revision(path: Path) -> str:
    """Return the revision of a store's tables; StoreTooNewError where this installation does not know it."""
    with open_for_reading(path) as connection:
        found = str(connection.execute(text("SELECT version_num FROM alembic_version")).scalar_one())
    known = migrations.revisions()
    if found not in known:
        raise StoreTooNewError(
            f"{path} has revision {found}, this installation knows {known[0]} as the newest: it was written by a "
            "newer Flankwatch. Install that version, or restore the backup made before it was installed"
        )
    return found


@contextmanager
def open_for_reading(path: Path) -> Iterator[Connection]:
    """One consistent view of a store that is nobody's, such as a backup."""
    engine = _engine(path, read_only=True)
    try:
        with engine.begin() as connection:
            yield connection
    finally:
        engine.dispose()


def vacuum_into(source: Path, target: Path) -> None:
    """Copy a live store into a new, checked file, which appears under its name only when it is whole."""
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = target.with_name(target.name + ".partial")
    partial.unlink(missing_ok=True)
    connection = dbapi().connect(str(source), isolation_level=None)
    try:
        connection.execute("VACUUM INTO ?", (str(partial),))
    finally:
        connection.close()
    sync(partial)
    verify(partial)
    partial.replace(target)
    sync(target.parent)


def _check(connection: Connection, path: Path) -> None:
    found = [row[0] for row in connection.execute(text("PRAGMA integrity_check(5)"))]
    if found != ["ok"]:
        raise StoreCorruptError(_corrupt(path, "; ".join(found)))
    if orphans := connection.execute(text("PRAGMA foreign_key_check")).all():
        raise StoreCorruptError(_corrupt(path, f"{len(orphans)} rows refer to rows that are not there"))
    if not inspect(connection).has_table("alembic_version"):
        raise StoreCorruptError(_corrupt(path, "it is a database, but not a store of Flankwatch"))


def _corrupt(path: Path, what: str) -> str:
    return (
        f"{path} is damaged ({what}): a worn disk, or a power cut on a disk that does not keep its promises. "
        "Nothing is measured on it. Check the disk, then put the newest backup in its place with `flankwatch "
        "restore`, which keeps the damaged file aside; the captures on disk hold what came after"
    )


def sync(path: Path) -> None:
    """Flush a file or a folder to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
