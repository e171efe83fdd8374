"""The machine code is made by a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from service.dynamics import compiling

SAYS = """
from service.dynamics import compiling
before = compiling.is_kept(compiling.propagate)
compiling.compiled_apart()
print(before, compiling.is_kept(compiling.propagate), len(compiling.propagate.signatures))
"""

BENDS = """
import numpy as np
from service.dynamics.driven_motion import add_error
c = np.sin(np.arange(2000.0)).reshape(2, 2, 100, 1, 5)
add_error(c, 0, np.cos(np.arange(8.0)).reshape(2, 4), 0.3, 1.7, 1e-3)
print(c.tobytes().hex())
"""


def said_by(script: str, cache: Path) -> str:
    """What a process prints that keeps its machine code there."""
    return subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    ).stdout


def test_another_process_keeps_the_code_where_this_one_finds_it(tmp_path: Path) -> None:
    said = said_by(SAYS, tmp_path)
    assert said.split() == ["False", "True", "0"], "kept now, and nothing was compiled here"


def test_what_the_compiling_process_computes_is_what_later_ones_do(tmp_path: Path) -> None:
    assert said_by(BENDS, tmp_path) == said_by(BENDS, tmp_path), "to the last bit"


@pytest.mark.parametrize("kept", [True, None])
def test_nothing_is_compiled_apart_that_is_kept_or_cannot_be(
    monkeypatch: pytest.MonkeyPatch, kept: bool | None
) -> None:
    def started(*_: object, **__: object) -> None:
        raise AssertionError("a process was started")

    monkeypatch.setattr(compiling, "is_kept", lambda _: kept)
    monkeypatch.setattr(compiling.subprocess, "run", started)
    compiling.compiled_apart()


def test_where_no_process_can_be_started_the_code_is_compiled_when_it_is_needed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refused(*_: object, **__: object) -> None:
        raise OSError("no more processes")

    monkeypatch.setattr(compiling, "is_kept", lambda _: False)
    monkeypatch.setattr(compiling.subprocess, "run", refused)
    compiling.compiled_apart()
