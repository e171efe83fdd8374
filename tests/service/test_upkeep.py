"""The commands backup and restore, as a maintenance planner uses them."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from service.cli import app
from service.store.database import open_database, verify

EXAMPLE = Path(__file__).parents[2] / "deploy" / "flankwatch.toml"


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """The example's machine with its data under the test's own folder, and a store."""
    path = tmp_path / "machine.toml"
    text = EXAMPLE.read_text(encoding="utf-8").replace("/var/lib/flankwatch", str(tmp_path / "data"))
    path.write_text(text, encoding="utf-8")
    open_database(tmp_path / "data" / "flankwatch.sqlite").close()
    return path


def call(*arguments: object, answer: str = "") -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments], input=answer)


def test_a_backup_is_made_while_the_service_runs_and_put_back_when_it_does_not(
    config: Path, tmp_path: Path
) -> None:
    store = tmp_path / "data" / "flankwatch.sqlite"
    database = open_database(store)
    made = call("backup", tmp_path / "stick", "--config", config)
    assert made.exit_code == 0, made.stderr
    assert "captures" in made.stdout
    (backup,) = (tmp_path / "stick").glob("*.sqlite")
    verify(backup)
    busy = call("restore", "--from", backup, "--config", config, "--yes")
    assert busy.exit_code == 1
    assert "stop it" in busy.stderr
    database.close()
    store.write_bytes(os.urandom(4096))
    done = call("restore", "--from", backup, "--config", config, "--yes")
    assert done.exit_code == 0, done.stderr
    assert "replaced-" in done.stdout
    verify(store)


def test_nothing_is_replaced_without_a_yes(config: Path, tmp_path: Path) -> None:
    store = tmp_path / "data" / "flankwatch.sqlite"
    call("backup", tmp_path / "data" / "backups", "--config", config)
    before = store.read_bytes()
    asked = call("restore", "--config", config, answer="n\n")
    assert asked.exit_code == 1
    assert "sound, 0 runs" in asked.stdout
    assert store.read_bytes() == before
    assert not list(store.parent.glob("*.replaced-*"))


def test_without_backups_it_says_what_to_do(config: Path) -> None:
    refused = call("restore", "--config", config)
    assert refused.exit_code == 1
    assert "--from" in refused.stderr
