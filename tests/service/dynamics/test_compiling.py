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


def test_another_process_keeps_the_code_where_this_one_finds_it(tmp_path: Path) -> None:
    said = subprocess.run(
        [sys.executable, "-c", SAYS],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert said.stdout.split() == ["False", "True", "0"], "kept now, and nothing was compiled here"


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
