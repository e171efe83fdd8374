"""``flankwatch``: the command line. One function per command; what a command needs is imported when it runs.

Exit status: 0 done, 1 something could not be read or done (said on stderr), 2 wrong usage.
With ``--json`` stdout carries JSON and nothing else; progress and complaints go to stderr.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

if TYPE_CHECKING:
    from service.app import House
    from service.backlash.results import AxisResult
    from service.config import Settings
    from service.demo import ComparedAxis, Comparison
    from service.motion.process import MachineOpener
    from service.store.records import RunRecord

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Backlash monitoring of rack-and-pinion axes: ten short steps, the motor's speed and an accelerometer.",
)

ConfigOption = Annotated[
    Path,
    typer.Option("--config", "-c", help="Configuration of the machine (TOML).", envvar="FLANKWATCH_CONFIG"),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON (SI units) on stdout, nothing else.")]

UrlOption = Annotated[str, typer.Option(help="Where the service listens.", envvar="FLANKWATCH_URL")]

LOCAL_SERVICE = "http://127.0.0.1:8470"
DEFAULT_CONFIG = Path("/etc/flankwatch/flankwatch.toml")


def main() -> None:
    """Entry point of the installed command."""
    app()


def complain(message: str) -> None:
    """Say on stderr what went wrong."""
    Console(stderr=True, soft_wrap=True, highlight=False).print(message, markup=False)


def progress_bar() -> Progress:
    """A progress bar on stderr, shown only where a person looks."""
    console = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
        disable=not console.is_terminal,
        transient=True,
    )


@app.command()
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


@app.command()
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
    url: UrlOption = LOCAL_SERVICE,
) -> None:
    """Find what the declared model of each axis lacks, and report the error before and after adding it."""
    if (run is None) == (not train or validate is None):
        complain("give --train FILE and --validate FILE, or --run ID of the running service")
        raise typer.Exit(2)
    with progress_bar() as bar:
        task = bar.add_task("explain", total=None)

        def tell(text: str) -> None:
            bar.update(task, description=text)

        if run is not None:
            found = _explain_run(run, url, predictions, report, tell)
        else:
            assert train and validate
            found = _explain_files(train, validate, predictions, report, tell)
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
) -> dict[str, Any]:
    from service.captures import CaptureError
    from service.explaining import explain_captures
    from service.identification.explanation import CannotExplain

    try:
        return explain_captures(train, validate, predictions=predictions, report=report, tell=tell)
    except (CaptureError, CannotExplain, OSError) as error:
        complain(str(error))
        raise typer.Exit(1) from None


def _explain_run(
    run: int, url: str, predictions: Path | None, report: Path | None, tell: Callable[[str], None]
) -> dict[str, Any]:
    from service.remote import RemoteError, Service

    service = Service(url, os.environ.get("FLANKWATCH_TOKEN"))
    try:
        explained = service.explain(run, tell)
        for path, part in ((predictions, "predictions"), (report, "report")):
            if path is not None:
                path.write_bytes(service.part_of_explanation(explained["id"], part))
    except (RemoteError, OSError) as error:
        complain(str(error))
        raise typer.Exit(1) from None
    return {"run_id": run, "train_run_ids": explained["train_run_ids"], **explained["found"]}


@app.command()
def demo(
    once: Annotated[bool, typer.Option("--once", help="Exit after the first run of every group.")] = False,
    as_json: JsonOption = False,
    port: Annotated[int, typer.Option(help="Port of the API on loopback; 0 takes a free one.")] = 8470,
    directory: Annotated[
        Path | None, typer.Option(help="Keep the data here; else they are thrown away.")
    ] = None,
) -> None:
    """Run the whole product against a simulated laser cutter: a gantry and a single axis on virtual CAN."""
    from service.demo import compare, demo_settings, open_demo

    with ExitStack() as stack:
        folder = directory or Path(stack.enter_context(TemporaryDirectory(prefix="flankwatch-")))
        settings = demo_settings(folder, port)
        house = stack.enter_context(_opened(settings, partial(open_demo, paced=not once), refine=not once))
        runs = [_run_group(house, group) for group in settings.groups]
        comparison = compare(house, runs)
        if as_json:
            print_json(comparison.as_json())
        else:
            print_comparison(comparison)
        if not once:
            _serve(house, settings)
    if comparison.failed or any(axis.error is None for axis in comparison.axes):
        raise typer.Exit(1)


@app.command()
def serve(config: ConfigOption = DEFAULT_CONFIG) -> None:
    """Run the service: REST API and page, nightly schedule, checks on demand."""
    settings = _settings(config)
    with _opened(settings) as house:
        _serve(house, settings)


@app.command()
def check(
    target: Annotated[str, typer.Argument(help="Axis or group, e.g. X1.", metavar="AXIS")],
    url: UrlOption = LOCAL_SERVICE,
    as_json: JsonOption = False,
) -> None:
    """Have the running service make a diagnostic run now, wait for it, and print what it found. The axis moves."""
    from service.remote import RemoteError, Service

    service = Service(url, os.environ.get("FLANKWATCH_TOKEN"))
    try:
        with progress_bar() as bar:
            task = bar.add_task(f"check {target}", total=None)
            run = service.check(target, lambda done, total, text: _advance(bar, task, done, total, text))
    except RemoteError as error:
        complain(str(error))
        raise typer.Exit(1) from None
    if as_json:
        print_json(run)
    else:
        print_run(run)
    if run["state"] != "ok":
        raise typer.Exit(1)


@app.command("check-config")
def check_config(
    config: Annotated[Path, typer.Argument(help="Configuration (TOML).")] = DEFAULT_CONFIG,
) -> None:
    """Check a configuration and print what it means: groups, the step, the load of each bus."""
    from drivers.busload import bus_load
    from service.config import frames_on
    from service.dynamics.trajectory import jerk_limited_step

    settings = _settings(config)
    excitation = settings.excitation
    limits = (
        min(axis.acceleration_limit_m_s2 for axis in settings.axis),
        min(axis.velocity_limit_m_s for axis in settings.axis),
    )
    step = jerk_limited_step(excitation.step_length_m, excitation.jerk_m_s3, *limits)
    console = Console(highlight=False)
    console.print(f"{config}: sound, machine {settings.machine.name!r}", markup=False)
    for group, axes in settings.groups.items():
        console.print(f"  group {group}: {', '.join(axes)}", markup=False)
    console.print(
        f"  step: {excitation.step_length_m * 1e3:g} mm in {step.duration * 1e3:.1f} ms, "
        f"a_max {step.a_max:.2f} m/s², v_max {step.v_max * 1e3:.1f} mm/s"
    )
    for bus in settings.bus:
        load = bus_load(frames_on(settings, bus), bus.bitrate)
        console.print(f"  bus {bus.name}: {load:.0%} of {bus.bitrate // 1000} kbit/s", markup=False)


@app.command()
def plan(
    axis: Annotated[str | None, typer.Argument(help="Axis of the configuration, e.g. X1.")] = None,
    config: Annotated[
        Path | None, typer.Option("--config", "-c", help="Configuration of the machine (TOML).")
    ] = None,
    backlash_um: Annotated[float | None, typer.Option(min=1.0, max=5000.0, help="Expected backlash.")] = None,
    v_lim: Annotated[float | None, typer.Option(min=0.0, help="Speed limit [m/s].")] = None,
    a_lim: Annotated[float | None, typer.Option(min=0.0, help="Acceleration limit [m/s²].")] = None,
    jerk_lim: Annotated[float | None, typer.Option(min=1.0, help="Jerk limit [m/s³].")] = None,
    travel_mm: Annotated[float | None, typer.Option(min=0.0, help="Room for a step.")] = None,
    speed_hz: Annotated[float | None, typer.Option(min=1.0, help="Rate of the motor speed.")] = None,
    accel_hz: Annotated[float | None, typer.Option(min=100.0, help="Rate of the accelerometer.")] = None,
    noise: Annotated[float | None, typer.Option(min=1e-6, help="Of one sample at rest [m/s²].")] = None,
    gantry: Annotated[bool, typer.Option("--gantry", help="Two axes move one bridge.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Propose length, jerk and number of the steps, with the interval to expect; nothing moves."""
    from service.backlash.excitation import Limits, NoStep
    from service.backlash.step_information import Sensing
    from service.planning import LARGEST_JERK, TYPICAL, in_words, of_axis, planned
    from service.planning import as_json as plan_json

    limits, sensing, b, axes = Limits(1.5, 10.0, LARGEST_JERK, 0.1), Sensing(), TYPICAL, 1
    if axis is not None:
        try:
            limits, sensing, b, axes = of_axis(_settings(config or DEFAULT_CONFIG), axis)
        except KeyError:
            complain(f"the configuration names no axis {axis!r}")
            raise typer.Exit(1) from None
    elif None in (v_lim, a_lim, travel_mm):
        complain("name an axis of the configuration, or give --v-lim, --a-lim and --travel-mm")
        raise typer.Exit(2)
    limits = _with(
        limits, v=v_lim, a=a_lim, jerk=jerk_lim, travel=None if travel_mm is None else travel_mm * 1e-3
    )
    sensing = _with(sensing, speed_rate=speed_hz, acceleration_rate=accel_hz, noise=noise)
    b = b if backlash_um is None else backlash_um * 1e-6
    found = planned(limits, sensing, b, 2 if gantry else axes)
    if as_json:
        print_json(plan_json(found, b))
    elif isinstance(found, NoStep):
        complain(f"limit: {found.limit}. {found.detail}")
    else:
        Console(highlight=False, soft_wrap=True).print(in_words(found, b), markup=False)
    if isinstance(found, NoStep):
        raise typer.Exit(1)


@app.command()
def picture(
    file: Annotated[Path, typer.Argument(help="Capture.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="SVG to write.")],
    axis: Annotated[str | None, typer.Option(help="Axis; the first one of the capture if not given.")] = None,
    step: Annotated[int, typer.Option(min=0, help="Index of the step.")] = 0,
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


def _with(described: Any, **given: float | None) -> Any:
    """A frozen description with those values changed that were given."""
    return replace(described, **{name: value for name, value in given.items() if value is not None})


def _settings(path: Path) -> Settings:
    from service.config import ConfigError, load_settings

    try:
        return load_settings(path)
    except ConfigError as error:
        complain(str(error))
        raise typer.Exit(1) from None


@contextmanager
def _opened(
    settings: Settings, machine: MachineOpener | None = None, *, refine: bool = True
) -> Iterator[House]:
    """The whole service, or exit status 1 with the store's own words."""
    from service.app import house
    from service.motion.machine import open_machine
    from service.store.errors import StoreError

    try:
        with house(settings, machine or open_machine, refine=refine) as opened:
            yield opened
    except (StoreError, OSError) as error:
        complain(str(error))
        raise typer.Exit(1) from None


def _run_group(house: House, group: str) -> RunRecord:
    """Make one run through the box, as a technician would, with a progress bar."""
    from service.store.records import Queued

    answer = house.box.request(group)
    if not isinstance(answer, Queued):
        complain(f"{group}: the machine is not free: {answer}")
        raise typer.Exit(1)
    with progress_bar() as bar:
        task = bar.add_task(group, total=None)
        while (run := house.box.wait(answer.run_id, 0.1)).state not in ("ok", "refused", "failed"):
            if progress := house.box.progress():
                _advance(bar, task, progress.done, progress.total, f"{group}: {progress.phase}")
    return run


def _advance(bar: Progress, task: TaskID, done: int, total: int, text: str) -> None:
    bar.update(task, completed=done, total=total or None, description=text)


def _serve(house: House, settings: Settings) -> None:
    import uvicorn

    address = f"http://{settings.api.host}:{settings.api.port}"
    complain(f"Flankwatch watches {settings.machine.name}: {address} (Ctrl-C ends it)")
    uvicorn.run(house.web(), host=settings.api.host, port=settings.api.port, log_level="warning")


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
    for check in run.get("model_checks", ()):
        for axis, words in check["in_words"].items():
            console.print(f"  {axis}, model check: {words}", markup=False)


def print_json(value: Any) -> None:
    """One JSON object on one line of stdout; NaN is a programming error."""
    sys.stdout.write(json.dumps(value, allow_nan=False) + "\n")
    sys.stdout.flush()


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


if __name__ == "__main__":
    main()
