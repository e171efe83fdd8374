"""The command that proposes the step to command; nothing moves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from service.cli.common import DEFAULT_CONFIG, JsonOption, complain, print_json, settings_of


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
            limits, sensing, b, axes = of_axis(settings_of(config or DEFAULT_CONFIG), axis)
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


def _with(described: Any, **given: float | None) -> Any:
    """A frozen description with those values changed that were given."""
    return replace(described, **{name: value for name, value in given.items() if value is not None})
