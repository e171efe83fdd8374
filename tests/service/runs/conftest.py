"""A bench with an axis of 57 ± 10 µm."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from service.runs.workbench import Workbench
from service.store.database import open_database
from service.store.records import AxisRecord
from service.store.repository import Repository
from tests.service.runs.bench import Bench


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    database = open_database(tmp_path / "flankwatch.sqlite")
    repository = Repository(database)
    repository.declare_axes([AxisRecord("Y", "Y", 57e-6, 10e-6)])
    (tmp_path / "captures").mkdir()
    yield Bench(repository, tmp_path / "captures")
    database.close()


@pytest.fixture
def workbench(bench: Bench) -> Iterator[Workbench]:
    with Workbench(bench.workshop, is_busy=lambda: False) as opened:
        yield opened
