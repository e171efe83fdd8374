"""What every test shares: where the shared data lies, and the proof that a test leaves nothing running."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def shared_dir() -> Path:
    """The folder of shared captures beside the checkout; the test skips where it is absent."""
    path = (ROOT / ".." / "shared").resolve()
    if not path.is_dir():
        pytest.skip(f"no shared data: {path} is absent")
    return path


@pytest.fixture(autouse=True)
def no_thread_left_running() -> Iterator[None]:
    """Fail the test that leaves a thread running: a forgotten receive loop would disturb all that follow."""
    before = set(threading.enumerate())
    yield
    left = [t for t in threading.enumerate() if t not in before and t.is_alive() and not t.daemon]
    for thread in left:
        thread.join(timeout=2)
    still = [t.name for t in left if t.is_alive()]
    assert not still, f"threads left running: {still}"
