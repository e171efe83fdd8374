"""A store of two groups in a fresh folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from service.store.database import Database, open_database
from service.store.records import AxisRecord
from service.store.repository import Repository

AXES = (
    AxisRecord("X1", "gantry", 57e-6, 15e-6),
    AxisRecord("X2", "gantry", 57e-6, 15e-6),
    AxisRecord("Y", "Y"),
)


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path / "flankwatch.sqlite")
    yield opened
    opened.close()


@pytest.fixture
def repository(database: Database) -> Repository:
    store = Repository(database)
    store.declare_axes(AXES)
    return store
