"""Commands on recorded runs: analyze, explain, picture; nothing moves."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from service.cli.common import LOCAL_SERVICE, JsonOption, UrlOption, complain, print_json, progress_bar
from service.cli.printing import print_explanation, print_results


def analyze(
    files: Annotated[list[Path], typer.Argument(help="Captures: Parquet, or CSV with a .json beside it.")],
    as_json: JsonOption = False,
    quick: Annotated[
        bool, typer.Option("--quick", help="The paper's method only: at once, several percent.")
    ] = False,
) -> None:
    """Determine the backlash in recorded runs, of this machine or of any other."""
    from service.analyze import analysed
    from service.captures.report import axis_result_to_json

    failed = False
    with progress_bar() as bar:
        for answer in bar.track(analysed(files, quick), total=len(files), description="analyse"):
            if answer.error is not None:
                complain(answer.error)
                failed = True
            elif as_json:
                axes = [axis_result_to_json(result) for result in answer.results]
                print_json({"capture": str(answer.path), "axes": axes})
            else:
                print_results(str(answer.path), answer.results)
    if failed:
        raise typer.Exit(1)


def explain(
    train: Annotated[
        list[Path] | None, typer.Option("--train", help="Capture to fit to; may be given several times.")
    ] = None,
    validate: Annotated[
        Path | None, typer.Option("--validate", help="Capture that judges; it is not fitted.")
    ] = None,
    run: Annotated[
        int | None, typer.Option("--run", min=1, help="Instead: a run of the running service, by its number.")
    ] = None,
    as_json: JsonOption = False,
    predictions: Annotated[
        Path | None,
        typer.Option("--predictions", help="Parquet to write the predictions before and after to."),
    ] = None,
    report: Annotated[Path | None, typer.Option("--report", help="HTML page to write.")] = None,
    patience: Annotated[
        float, typer.Option(min=0.1, help="How many times longer than usual captures are searched.")
    ] = 1.0,
    url: UrlOption = LOCAL_SERVICE,
) -> None:
    """Find what the declared model of each axis lacks, and report the error before and after adding it."""
    if (run is None) == (not train or validate is None):
        complain("give --train FILE and --validate FILE, or --run ID of the running service")
        raise typer.Exit(2)
    if run is not None and patience != 1.0:
        complain(
            "the service searches a run as long as usual; give the files of its captures directory as --train FILE and "
            "--validate FILE to search longer"
        )
        raise typer.Exit(2)
    with progress_bar() as bar:
        task = bar.add_task("explain", total=None)

        def tell(text: str) -> None:
            bar.update(task, description=text)

        if run is not None:
            found = _explain_run(run, url, predictions, report, tell)
        else:
            assert train and validate
            found = _explain_files(train, validate, predictions, report, tell, patience)
    if as_json:
        print_json(found)
    else:
        print_explanation(found)


def _explain_files(
    train: list[Path],
    validate: Path,
    predictions: Path | None,
    report: Path | None,
    tell: Callable[[str], None],
    patience: float,
) -> dict[str, Any]:
    from service.captures import CaptureError
    from service.explaining import explain_captures
    from service.identification.explanation import CannotExplain

    try:
        return explain_captures(
            train, validate, predictions=predictions, report=report, tell=tell, patience=patience
        )
    except (CaptureError, CannotExplain, OSError) as error:
        complain(str(error))
        raise typer.Exit(1) from None


def _explain_run(
    run: int, url: str, predictions: Path | None, report: Path | None, tell: Callable[[str], None]
) -> dict[str, Any]:
    from service.remote import RemoteError, Service

    try:
        service = Service(url, os.environ.get("FLANKWATCH_TOKEN"))
        explained = service.explain(run, tell)
        for path, part in ((predictions, "predictions"), (report, "report")):
            if path is not None:
                path.write_bytes(service.part_of_explanation(explained["id"], part))
    except (RemoteError, OSError) as error:
        complain(str(error))
        raise typer.Exit(1) from None
    return {"run_id": run, "train_run_ids": explained["train_run_ids"], **explained["found"]}


def picture(
    file: Annotated[Path, typer.Argument(help="Capture.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="SVG to write.")],
    axis: Annotated[str | None, typer.Option(help="Axis; the first one of the capture if not given.")] = None,
    step: Annotated[int, typer.Option(min=0, help="Number of the step, from 0.")] = 0,
) -> None:
    """Draw one step of a capture: motor and load acceleration, t1 and t2."""
    from service.backlash.estimate import immediate
    from service.backlash.figure import step_picture
    from service.captures import CaptureError, read_capture

    try:
        recording = read_capture(file)
    except CaptureError as error:
        complain(str(error))
        raise typer.Exit(1) from None
    name = axis or recording.axes[0].name
    result = next((result for result in immediate(recording) if result.axis == name), None)
    drawn = None if result is None else step_picture(recording, name, step, result)
    if drawn is None:
        complain(f"{file}: there is no step {step} of axis {name!r} to draw")
        raise typer.Exit(1)
    out.write_text(drawn, encoding="utf-8")
