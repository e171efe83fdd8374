"""What commands print for a person: tables, values in µm, refusals in a sentence."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table

if TYPE_CHECKING:
    from service.backlash.results import AxisResult
    from service.demo import ComparedAxis, Comparison


def print_comparison(comparison: Comparison) -> None:
    """The demo's table: estimated beside the simulated truth."""
    table = Table(title="Estimated and simulated backlash", title_justify="left", title_style="bold")
    table.add_column("axis")
    for heading in ("estimated µm", "95 % µm", "true µm", "error µm", "error %"):
        table.add_column(heading, justify="right")
    table.add_column("method")
    for axis in comparison.axes:
        table.add_row(axis.result.axis, *_compared_cells(axis))
    console = Console()
    console.print(table)
    for run in comparison.failed:
        console.print(f"{run.group}: {run.reason}: {run.detail}", markup=False)


def _compared_cells(axis: ComparedAxis) -> tuple[str, ...]:
    result, error = axis.result, axis.error
    truth = f"{axis.truth * 1e6:.2f}"
    if result.backlash is None or error is None:
        return "–", "–", truth, "–", "–", f"refused: {result.detail or result.reason}"
    return (
        f"{result.backlash * 1e6:.2f}",
        _interval_text(result.interval_95),
        truth,
        f"{error * 1e6:+.2f}",
        f"{error / axis.truth:+.1%}",
        result.method,
    )


def print_explanation(found: dict[str, Any]) -> None:
    """What each axis' model lacks, for a person: the finding in words, the errors, the evidence."""
    from service.report.words import finding_in_words

    console = Console(highlight=False)
    if "run_id" in found:
        fitted = ", ".join(str(number) for number in found["train_run_ids"])
        console.print(f"run {found['run_id']}, judged by a fit to run {fitted}", markup=False)
    for axis in found["axes"]:
        names = ", ".join(axis["effects"]) or axis["finding"]
        console.print(f"{axis['axis']} ({axis['channel']}): {names}", style="bold", markup=False)
        console.print(finding_in_words(axis), markup=False)
        table = Table()
        for heading in ("model", "held-out RMS", "over noise", "backlash µm"):
            table.add_column(heading, justify="left" if heading == "model" else "right")
        for label in ("before", "after"):
            error, noise = axis[label]["validation_rms"], axis["noise_rms"]
            backlash = axis[label]["backlash_m"]
            table.add_row(
                label,
                "–" if error is None else f"{error:.4g}",
                f"{error / noise:.2f}" if error is not None and noise else "–",
                "–" if backlash is None else f"{backlash * 1e6:.2f}",
            )
        console.print(table)
        for line in axis.get("evidence", ()):
            console.print(f"  {line}", markup=False)


def print_run(run: dict[str, Any]) -> None:
    """One finished run of the service, as a technician reads it."""
    console = Console(highlight=False)
    console.print(f"run {run['id']} on {run['group']}: {run['state']}", markup=False)
    if run.get("detail"):
        console.print(run["detail"], markup=False)
    for value in run["results"]:
        if value["backlash_m"] is None:
            console.print(f"  {value['axis']}: refused, {value['detail'] or value['reason']}", markup=False)
        else:
            interval = _interval_text(tuple(value["interval_95_m"]) if value["interval_95_m"] else None)
            console.print(
                f"  {value['axis']}: {value['backlash_m'] * 1e6:.2f} µm (95 %: {interval} µm), {value['method']}",
                markup=False,
            )
    if any(value["method"] == "paper" and value["reported"] for value in run["results"]):
        console.print(
            f"  the fit of the whole model follows: see the page, or /api/v1/runs/{run['id']}", markup=False
        )
    for check in run.get("model_checks", ()):
        for axis, words in check["in_words"].items():
            console.print(f"  {axis}, model check: {words}", markup=False)


def print_results(title: str, results: Iterable[AxisResult]) -> None:
    """A table for a person: value and interval in µm, or the reason of the refusal in a sentence."""
    table = Table(title=title, title_justify="left", title_style="bold")
    for heading, justify in (
        ("axis", "left"),
        ("backlash µm", "right"),
        ("95 % µm", "right"),
        ("steps", "right"),
    ):
        table.add_column(heading, justify="right" if justify == "right" else "left")
    table.add_column("method")
    table.add_column("says", overflow="fold")
    for result in results:
        usable = sum(step.verdict == "ok" for step in result.steps)
        table.add_row(
            result.axis,
            "–" if result.backlash is None else f"{result.backlash * 1e6:.2f}",
            _interval_text(result.interval_95),
            f"{usable}/{len(result.steps)}",
            result.method,
            result.detail or result.verdict,
        )
    Console(soft_wrap=False).print(table)


def _interval_text(interval: tuple[float, float] | None) -> str:
    return "–" if interval is None else f"{interval[0] * 1e6:.2f} … {interval[1] * 1e6:.2f}"
