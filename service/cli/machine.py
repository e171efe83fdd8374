"""Commands on a machine, real or simulated: demo, serve, check, check-config."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from service.cli.common import (
    DEFAULT_CONFIG,
    LOCAL_SERVICE,
    ConfigOption,
    JsonOption,
    UrlOption,
    advance,
    complain,
    print_json,
    progress_bar,
    settings_of,
)
from service.cli.printing import print_comparison, print_run

if TYPE_CHECKING:
    from service.app import House
    from service.config import Settings
    from service.motion.process import MachineOpener
    from service.store.records import RunRecord


def demo(
    once: Annotated[bool, typer.Option("--once", help="Exit after the first run of every group.")] = False,
    as_json: JsonOption = False,
    port: Annotated[int, typer.Option(help="Port of the API on loopback; 0 takes a free one.")] = 8470,
    directory: Annotated[
        Path | None, typer.Option(help="Keep the data here; else they are thrown away.")
    ] = None,
) -> None:
    """Run the whole product against a simulated laser cutter: a gantry and a single axis on virtual CAN."""
    from service.demo import PLACES, compare, demo_settings, open_demo

    with ExitStack() as stack:
        folder = directory or Path(stack.enter_context(TemporaryDirectory(prefix="flankwatch-")))
        settings = demo_settings(folder, port, PLACES)
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


def serve(config: ConfigOption = DEFAULT_CONFIG) -> None:
    """Run the service: REST API and page, nightly schedule, checks on demand."""
    settings = settings_of(config)
    with _opened(settings) as house:
        _serve(house, settings)


def check(
    target: Annotated[str, typer.Argument(help="Axis or group, e.g. X1.", metavar="AXIS")],
    url: UrlOption = LOCAL_SERVICE,
    as_json: JsonOption = False,
) -> None:
    """Have the running service make a diagnostic run now, wait for it, and print what it found. The axis moves."""
    from service.remote import RemoteError, Service

    try:
        service = Service(url, os.environ.get("FLANKWATCH_TOKEN"))
        with progress_bar() as bar:
            task = bar.add_task(f"check {target}", total=None)
            run = service.check(target, lambda done, total, text: advance(bar, task, done, total, text))
        axes = [service.axis(name) for name in run["axes"]]
    except RemoteError as error:
        complain(str(error))
        raise typer.Exit(1) from None
    if as_json:
        print_json(run)
    else:
        print_run(run)
        for hint in filter(None, (axis["tolerance_hint"] for axis in axes)):
            Console(highlight=False, soft_wrap=True).print(hint, markup=False)
    if run["state"] != "ok":
        raise typer.Exit(1)


def check_config(
    config: Annotated[Path, typer.Argument(help="Configuration (TOML).")] = DEFAULT_CONFIG,
) -> None:
    """Check a configuration and print what it means: groups, the step, the load of each bus."""
    from drivers.busload import bus_load
    from service.config import frames_on
    from service.dynamics.trajectory import jerk_limited_step

    settings = settings_of(config)
    excitation = settings.excitation
    limits = (
        min(axis.acceleration_limit_m_s2 for axis in settings.axis),
        min(axis.velocity_limit_m_s for axis in settings.axis),
    )
    step = jerk_limited_step(excitation.step_length_m, excitation.jerk_m_s3, *limits)
    console = Console(highlight=False)
    console.print(f"{config}: sound, machine {settings.machine.name!r}", markup=False)
    for group, axes in settings.groups.items():
        console.print(f"  group {group}: {', '.join(axes)}{_places(settings, axes)}", markup=False)
    console.print(
        f"  step: {excitation.step_length_m * 1e3:g} mm in {step.duration * 1e3:.1f} ms, "
        f"a_max {step.a_max:.2f} m/s², v_max {step.v_max * 1e3:.1f} mm/s"
    )
    for bus in settings.bus:
        load = bus_load(frames_on(settings, bus), bus.bitrate)
        console.print(f"  bus {bus.name}: {load:.0%} of {bus.bitrate // 1000} kbit/s", markup=False)


def _places(settings: Settings, axes: tuple[str, ...]) -> str:
    """Where a check of the group travels to; nothing where it steps where it stands."""
    members = [settings.axis_named(name) for name in axes]
    places = ", ".join(f"{place:g} m" for place in members[0].diagnostic_positions_m)
    speed = min(settings.travel.velocity_m_s, *(axis.velocity_limit_m_s for axis in members))
    return f"; every check travels to {places} and back, at {speed:g} m/s at most" if places else ""


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
                advance(bar, task, progress.done, progress.total, f"{group}: {progress.phase}")
    return run


def _serve(house: House, settings: Settings) -> None:
    import uvicorn

    address = f"http://{settings.api.host}:{settings.api.port}"
    complain(f"Flankwatch watches {settings.machine.name}: {address} (Ctrl-C ends it)")
    uvicorn.run(house.web(), host=settings.api.host, port=settings.api.port, log_level="warning")
