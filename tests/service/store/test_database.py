"""The file: opened, refused, backed up, migrated; and what a kill and two writers do to it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import zipfile
from datetime import UTC, datetime
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import text
from sqlalchemy.exc import OperationalError

import migrations
from service.store.database import Database, backups, dbapi, open_database, verify
from service.store.errors import (
    StoreCorruptError,
    StoreInUseError,
    StoreTooNewError,
    StoreVanishedError,
)
from service.store.records import Queued, RunEnd, RunOrder
from service.store.repository import Repository
from service.store.tables import metadata

ROOT = Path(__file__).parents[3]
NOON = datetime(2026, 11, 21, 12, tzinfo=UTC)


def a_store(folder: Path) -> Path:
    path = folder / "flankwatch.sqlite"
    open_database(path).close()
    return path


def test_a_new_store_is_durable_and_strict(database: Database) -> None:
    with database.writing() as connection:
        pragmas = {
            name: connection.execute(text(f"PRAGMA {name}")).scalar_one()
            for name in ("journal_mode", "synchronous", "foreign_keys")
        }
    assert pragmas == {"journal_mode": "wal", "synchronous": 2, "foreign_keys": 1}


def test_sqlite_is_free_of_the_wal_reset_bug() -> None:
    assert dbapi().sqlite_version_info >= (3, 51, 3)


def test_tables_and_migrations_agree(database: Database) -> None:
    with database.writing() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, metadata) == []


def test_tables_and_migrations_agree_on_checks(database: Database) -> None:
    """Alembic compares no CHECKs, which are what keeps a wrong value out; SQLite's own text does."""
    with database.reading() as connection:
        rows = connection.execute(text("SELECT name, sql FROM sqlite_master WHERE type = 'table'"))
        migrated = dict(rows.all())
    for table in metadata.tables.values():
        for constraint in table.constraints:
            if constraint.__visit_name__ == "check_constraint":
                condition = " ".join(str(constraint.sqltext).split())  # type: ignore[attr-defined]
                assert condition in " ".join(migrated[table.name].split()), constraint.name


def test_readers_cannot_write(database: Database) -> None:
    with pytest.raises(OperationalError, match="readonly"), database.reading() as connection:
        connection.execute(text("DELETE FROM runs"))


def test_one_writing_process(tmp_path: Path) -> None:
    path = tmp_path / "flankwatch.sqlite"
    first = open_database(path)
    with pytest.raises(StoreInUseError, match="another process"):
        open_database(path)
    first.close()
    open_database(path).close()


def test_a_file_of_noise_is_refused_and_kept(tmp_path: Path) -> None:
    path = a_store(tmp_path)
    noise = os.urandom(8192)
    path.write_bytes(noise)
    with pytest.raises(StoreCorruptError, match="newest backup"):
        open_database(path)
    assert path.read_bytes() == noise


def test_a_torn_page_is_refused(tmp_path: Path) -> None:
    path = a_store(tmp_path)
    content = bytearray(path.read_bytes())
    content[4096:8192] = bytes(4096)
    path.write_bytes(content)
    with pytest.raises(StoreCorruptError, match="damaged"):
        open_database(path)


@pytest.mark.parametrize("size", [0, 100, 5000])
def test_a_truncated_file_is_refused_not_begun_anew(tmp_path: Path, size: int) -> None:
    path = a_store(tmp_path)
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(StoreCorruptError):
        open_database(path)


def test_another_programs_database_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "flankwatch.sqlite"
    connection = dbapi().connect(str(path))
    connection.execute("CREATE TABLE songs (id INTEGER)")
    connection.close()
    with pytest.raises(StoreCorruptError, match="not a store of Flankwatch"):
        open_database(path)


def test_a_vanished_file_is_not_begun_anew_while_backups_say_it_was_there(tmp_path: Path) -> None:
    path = tmp_path / "flankwatch.sqlite"
    database = open_database(path)
    database.backup(tmp_path / "backups", NOON)
    database.close()
    path.unlink()
    with pytest.raises(StoreVanishedError, match="not mounted"):
        open_database(path)
    assert not path.exists()


def test_a_backup_holds_the_runs_and_opens_as_a_store(tmp_path: Path) -> None:
    database = open_database(tmp_path / "flankwatch.sqlite")
    answer = Repository(database).queue_run(RunOrder("on_demand", "X", "X", (), NOON))
    backup = database.backup(tmp_path / "backups", NOON)
    database.close()
    verify(backup)
    restored = tmp_path / "elsewhere" / "flankwatch.sqlite"
    restored.parent.mkdir()
    restored.write_bytes(backup.read_bytes())
    again = open_database(restored)
    assert isinstance(answer, Queued)
    assert Repository(again).run(answer.run_id).requested_at == NOON
    again.close()


def test_only_the_newest_backups_are_kept(database: Database, tmp_path: Path) -> None:
    folder = tmp_path / "backups"
    for day in range(1, 6):
        database.backup(folder, NOON.replace(day=day), keep=3)
    assert [path.name[-22:-14] for path in backups(folder, "flankwatch")] == [
        "20261105",
        "20261104",
        "20261103",
    ]
    assert list(folder.glob("*.partial")) == []


def test_a_newer_store_is_refused(tmp_path: Path) -> None:
    path = a_store(tmp_path)
    connection = dbapi().connect(str(path), isolation_level=None)
    connection.execute("UPDATE alembic_version SET version_num = '9999'")
    connection.close()
    with pytest.raises(StoreTooNewError, match="newer Flankwatch"):
        open_database(path)


def test_migrations_are_one_line_of_revisions() -> None:
    assert migrations.revisions()[-1] == "0001"
    assert len(set(migrations.revisions())) == len(migrations.revisions())


def test_concurrent_writers_and_readers_see_whole_runs(repository: Repository) -> None:
    """Four threads want the one box; each run that is seen as ended is seen with its end."""
    taken: list[int] = []
    torn: list[int] = []

    def work() -> None:
        for _ in range(10):
            answer = repository.queue_run(RunOrder("on_demand", "Y", "Y", ("Y",), NOON))
            if isinstance(answer, Queued):
                repository.finish_run(RunEnd(answer.run_id, "failed", NOON, "drive_fault"))
                taken.append(answer.run_id)
            torn.extend(
                run.id for run in repository.runs() if run.state == "failed" and run.finished_at is None
            )

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert torn == []
    assert sorted(taken) == sorted(run.id for run in repository.runs(limit=100))


WRITER = """
import sys
from datetime import UTC, datetime
from pathlib import Path
from service.store.database import open_database
from service.store.records import RunEnd, RunOrder
from service.store.repository import Repository

repository = Repository(open_database(Path(sys.argv[1])))
now = datetime.now(UTC)
repository.fail_interrupted(now)
while True:
    run = repository.queue_run(RunOrder("on_demand", "Y", "Y", (), now))
    repository.start_run(run.run_id, now)
    repository.finish_run(RunEnd(run.run_id, "failed", now, "drive_fault"))
    print(run.run_id, flush=True)
"""


def test_no_acknowledged_run_is_lost_by_a_kill(tmp_path: Path) -> None:
    """Kill -9 a process that writes runs, several times; what it had reported as stored must be there."""
    path = tmp_path / "flankwatch.sqlite"
    acknowledged: list[int] = []
    for kill in range(3):
        writer = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True, cwd=ROOT
        )
        assert writer.stdout is not None
        acknowledged += [int(writer.stdout.readline()) for _ in range(20 + 7 * kill)]
        writer.send_signal(signal.SIGKILL)
        acknowledged += [int(line) for line in writer.stdout.read().split("\n")[:-1]]
        writer.stdout.close()
        writer.wait()
    database = open_database(path)
    stored = {run.id for run in Repository(database).runs(limit=10_000) if run.state == "failed"}
    database.close()
    assert len(acknowledged) >= 81
    assert set(acknowledged) <= stored


@pytest.fixture
def wheel(tmp_path: Path) -> Path:
    """The packages as a wheel holds them: an archive's folder, away from the checkout."""
    folder = tmp_path / "site"
    archive = tmp_path / "packages.zip"
    with zipfile.ZipFile(archive, "w") as packed:
        for top in ("service", "migrations"):
            for file in (ROOT / top).rglob("*"):
                if file.is_file() and "__pycache__" not in file.parts:
                    packed.write(file, file.relative_to(ROOT))
    with zipfile.ZipFile(archive) as packed:
        packed.extractall(folder)
    return folder


def test_an_installed_service_finds_its_migrations(wheel: Path, tmp_path: Path) -> None:
    code = (
        "import migrations, sys; from pathlib import Path; from service.store.database import open_database;"
        "open_database(Path(sys.argv[1])).close(); print(migrations.__file__)"
    )
    path = tmp_path / "elsewhere" / "flankwatch.sqlite"
    found = subprocess.run(
        [sys.executable, "-c", code, str(path)],
        env={**os.environ, "PYTHONPATH": str(wheel)}, cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert found.stdout.startswith(str(wheel))
    verify(path)
