"""The web application on a store, empty or with three weeks of nights in it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from service.api.ports import WebSettings
from service.api.web import create_web_app
from service.store.database import open_database
from service.store.records import AxisRecord
from service.store.repository import Repository
from tests.service.api.house import NOON, PAGE, Box, House, Loop, picture, run_night

AXES = (
    AxisRecord("X1", "gantry", 57e-6, 15e-6),
    AxisRecord("X2", "gantry"),
    AxisRecord("Y", "Y", 40e-6, 10e-6),
)


@pytest.fixture(scope="session")
def stores(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two files to copy: without runs, and with twelve nights at 57 µm, one refused, eight at 80 µm."""
    folder = tmp_path_factory.mktemp("stores")
    database = open_database(folder / "flankwatch.sqlite")
    repository = Repository(database)
    repository.declare_axes(AXES)
    empty = database.backup(folder, NOON)
    for day, b in enumerate([57e-6] * 12 + [None] + [80e-6] * 8):
        run_night(repository, day, b)
    full = database.backup(folder, NOON + timedelta(days=1))
    database.close()
    return empty, full


def serve(store: Path, tmp_path: Path) -> Iterator[House]:
    shutil.copy(store, tmp_path / "flankwatch.sqlite")
    database = open_database(tmp_path / "flankwatch.sqlite")
    repository = Repository(database)
    box = Box(repository)
    missing: list[str] = []
    loop = Loop(repository)

    def build(**settings: object) -> TestClient:
        told = WebSettings("0.1.0", tmp_path / "captures", **settings)  # type: ignore[arg-type]
        app = create_web_app(
            repository,
            box,
            loop,
            told,
            picture=picture,
            report=lambda found: PAGE if found.found is not None else None,
            missing=lambda: missing,
            clock=lambda: NOON,
        )
        return TestClient(app, base_url="http://127.0.0.1:8470", raise_server_exceptions=False)

    yield House(build(), repository, box, tmp_path / "captures", build, missing, loop)
    database.close()


@pytest.fixture
def house(stores: tuple[Path, Path], tmp_path: Path) -> Iterator[House]:
    """Serve a store without runs."""
    yield from serve(stores[0], tmp_path)


@pytest.fixture
def nights(stores: tuple[Path, Path], tmp_path: Path) -> Iterator[House]:
    """Serve a store with three weeks of nights, and an alarm."""
    yield from serve(stores[1], tmp_path)
