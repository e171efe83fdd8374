"""``flankwatch explain --run`` against a service, and the page that ``--report`` writes."""

from __future__ import annotations

import io
import json
import urllib.request
from typing import Any

import pytest
from typer.testing import CliRunner

from service.cli import app

FOUND = {
    "axes": [
        {
            "axis": "Y",
            "channel": "acceleration",
            "finding": "effect",
            "effects": ["sensor_latency"],
            "indistinguishable": [],
            "noise_rms": 0.03,
            "before": {"validation_rms": 0.09, "backlash_m": 80e-6},
            "after": {"validation_rms": 0.031, "backlash_m": 57e-6},
        }
    ]
}


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the service answers, by method and path."""
    known: dict[str, Any] = {
        "POST /api/v1/runs/7/explanations": {"id": 3, "location": "/api/v1/explanations/3"},
        "GET /api/v1/explanations/3": {
            "id": 3, "state": "done", "detail": None, "train_run_ids": [6], "found": FOUND,
        },
        "GET /api/v1/explanations/3/report": b"<!doctype html>",
    }  # fmt: skip

    def answer(request: urllib.request.Request, timeout: float) -> io.BytesIO:
        path = request.full_url.removeprefix("http://127.0.0.1:8470")
        content = known[f"{request.method} {path}"]
        return io.BytesIO(content if isinstance(content, bytes) else json.dumps(content).encode())

    monkeypatch.setattr(urllib.request, "urlopen", answer)
    return known


def test_a_run_is_explained_by_the_service(answers: dict[str, Any], tmp_path: Any) -> None:
    page = tmp_path / "page.html"
    result = CliRunner().invoke(app, ["explain", "--run", "7", "--json", "--report", str(page)])
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout) == {"run_id": 7, "train_run_ids": [6], **FOUND}
    assert page.read_bytes() == b"<!doctype html>"
    told = CliRunner().invoke(app, ["explain", "--run", "7"])
    assert "a time lag" in told.stdout
    assert "judged by a fit to run 6" in told.stdout


def test_a_verdict_that_cannot_be_told_is_no_answer(answers: dict[str, Any]) -> None:
    answers["GET /api/v1/explanations/3"] |= {"state": "cannot_tell", "detail": "flat", "found": None}
    result = CliRunner().invoke(app, ["explain", "--run", "7"])
    assert result.exit_code == 1
    assert "cannot tell: flat" in result.stderr


@pytest.mark.parametrize(
    "arguments",
    [[], ["--train", "a"], ["--validate", "b"], ["--run", "1", "--train", "a", "--validate", "b"]],
)
def test_one_way_of_asking_is_wanted(arguments: list[str]) -> None:
    result = CliRunner().invoke(app, ["explain", *arguments])
    assert result.exit_code == 2
    assert "--run ID" in result.stderr
