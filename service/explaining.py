"""Captures explained for the command line: read, explain, write what was asked for beside the answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from service.captures import read_capture
from service.captures.report import predicted_traces, write_predictions
from service.identification.explain import explain
from service.report.page import report_page


def explain_captures(
    train: Sequence[Path],
    validate: Path,
    *,
    predictions: Path | None,
    report: Path | None,
    tell: Callable[[str], None],
    patience: float = 1.0,
) -> dict[str, Any]:
    """Explain recorded runs; the JSON object of ``flankwatch explain``.

    ``predictions`` (Parquet) and ``report`` (HTML) are written where they are given; ``patience`` as for ``explain``.

    Raises
    ------
    CaptureError, CannotExplain, OSError
    """
    recordings = [read_capture(path) for path in train]
    judging = read_capture(validate)
    explanation = explain(recordings, judging, tell, patience=patience)
    found, columns = explanation.as_json(), explanation.predictions()
    if predictions is not None:
        write_predictions(columns, predictions)
    if report is not None:
        fitted = ", ".join(path.name for path in train)
        about = [f"Judged on {validate.name}; fitted to {fitted}."]
        page = report_page(
            f"Model check of {validate.name}", about, found, predicted_traces(columns), judging
        )
        report.write_text(page, encoding="utf-8")
    return found
