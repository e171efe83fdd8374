"""A backup put back: what it holds, what stood there before, and when nothing is touched."""

from __future__ import annotations

import os
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from service.store.database import open_database
from service.store.errors import StoreCorruptError, StoreInUseError
from service.store.records import RunEnd, RunOrder
from service.store.repository import Repository
from service.store.restoring import NoBackupError, newest_sound, read_backup, restore

NOON = datetime(2026, 11, 1, 12, tzinfo=UTC)


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """A store with three runs, of which the backup holds two."""
    path = tmp_path / "flankwatch.sqlite"
    database = open_database(path)
    for day in range(3):
        if day == 2:
            database.backup(tmp_path / "backups", NOON + timedelta(days=1, hours=1))
        add_run(Repository(database), NOON + timedelta(days=day))
    database.close()
    return path


def add_run(repository: Repository, at: datetime) -> None:
    repository.queue_run(RunOrder("on_demand", "X", "X", (), at))
    run = repository.unfinished_run()
    assert run is not None
    repository.finish_run(RunEnd(run.id, "failed", at, "NodeSilent"))


def runs_of(path: Path) -> int:
    database = open_database(path)
    count = sum(Repository(database).run_counts().values())
    database.close()
    return count


def test_a_damaged_store_is_replaced_and_kept(store: Path) -> None:
    noise = os.urandom(8192)
    store.write_bytes(noise)
    chosen = newest_sound(store.parent / "backups", "flankwatch")
    assert (chosen.runs, chosen.last_run) == (2, NOON + timedelta(days=1))
    done = restore(store, chosen, NOON)
    assert runs_of(store) == 2
    assert done.aside is not None
    assert done.aside.read_bytes() == noise
    assert chosen.path.exists()


def test_a_journal_of_the_old_store_is_not_played_into_the_new_one(store: Path) -> None:
    wal = store.with_name(store.name + "-wal")
    wal.write_bytes(b"of the old store")
    done = restore(store, newest_sound(store.parent / "backups", "flankwatch"), NOON)
    assert done.aside is not None
    assert done.aside.with_name(done.aside.name + "-wal").read_bytes() == b"of the old store"
    assert runs_of(store) == 2


def test_a_vanished_store_comes_back(store: Path) -> None:
    store.unlink()
    done = restore(store, newest_sound(store.parent / "backups", "flankwatch"), NOON)
    assert done.aside is None
    assert runs_of(store) == 2


def test_a_damaged_backup_is_passed_over_and_refused_by_name(store: Path) -> None:
    later = store.parent / "backups" / "flankwatch-20261109T120000.sqlite"
    later.write_bytes(os.urandom(8192))
    assert newest_sound(store.parent / "backups", "flankwatch").path != later
    with pytest.raises(StoreCorruptError, match="damaged"):
        read_backup(later)


def test_without_a_sound_backup_it_says_where_to_look(tmp_path: Path) -> None:
    with pytest.raises(NoBackupError, match="no backups in"):
        newest_sound(tmp_path, "flankwatch")


def test_a_running_service_is_not_disturbed(store: Path) -> None:
    chosen = newest_sound(store.parent / "backups", "flankwatch")
    database = open_database(store)
    with pytest.raises(StoreInUseError, match="another process"):
        restore(store, chosen, NOON)
    database.close()
    assert runs_of(store) == 3
