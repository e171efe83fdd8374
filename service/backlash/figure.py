"""A picture of one step as SVG text: motor and load acceleration over time, release and impact marked.

What the README and the technician's page show. It is drawn from the recording itself, needs no library, and its
colours are readable on a light and on a dark page.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from service.backlash.results import AxisResult, StepResult
from service.backlash.signals import AxisSignals, axis_signals, derivative
from service.recording import FloatArray, Move, Recording

WIDTH, HEIGHT = 760, 380
LEFT, RIGHT, TOP, BOTTOM = 64, 20, 56, 52
MOTOR, LOAD, PASS, INK = "#2f7ed8", "#e07b00", "#946fd0", "#7d8590"
BEFORE, AFTER = 0.15, 0.25
"""Shown before and after the move, in its durations."""


@dataclass(frozen=True)
class _Frame:
    """Linear map from time [ms] and acceleration [m/s²] to the picture."""

    x: tuple[float, float]
    y: tuple[float, float]

    def at_x(self, value: float) -> float:
        return LEFT + (value - self.x[0]) / (self.x[1] - self.x[0]) * (WIDTH - LEFT - RIGHT)

    def at_y(self, value: float) -> float:
        return HEIGHT - BOTTOM - (value - self.y[0]) / (self.y[1] - self.y[0]) * (HEIGHT - TOP - BOTTOM)


def step_picture(recording: Recording, axis: str, index: int, result: AxisResult | None = None) -> str | None:
    """SVG of one step: accelerations [m/s²] along the travel over the time since the move's start [ms].

    With a result that holds the step's t1 and t2, the pass of the gap is marked and its backlash written [µm].
    None when the recording has no such step.
    """
    if not 0 <= index < len(recording.moves):
        return None
    signals = axis_signals(recording, axis)
    move = recording.moves[index]
    step = _step_of(result, index)
    way = "forward" if move.direction > 0 else "backward"
    title = f"{axis}, step {index + 1} of {len(recording.moves)}, {way}"
    if signals is None:
        return _document(title, [_text(WIDTH / 2, HEIGHT / 2, "not recorded", anchor="middle")])
    curves = _curves(signals, move)
    values = np.concatenate([value for _, value in curves])
    if len(values) == 0:
        return _document(title, [_text(WIDTH / 2, HEIGHT / 2, "no samples", anchor="middle")])
    duration = 1e3 * move.duration
    frame = _Frame((-BEFORE * duration, (1 + AFTER) * duration), _padded(values))
    parts = [*_marks(frame, move, step), *_axes(frame)]
    parts += [_line(frame, *curve, colour) for curve, colour in zip(curves, (LOAD, MOTOR), strict=True)]
    return _document(title, [*parts, *_legend()])


def _step_of(result: AxisResult | None, index: int) -> StepResult | None:
    return next((step for step in result.steps if step.index == index), None) if result else None


def _curves(signals: AxisSignals, move: Move) -> list[tuple[FloatArray, FloatArray]]:
    """Load and motor acceleration [m/s²] over time [ms]: as measured, and the shortest derivative of the speed."""
    start, end = move.start - BEFORE * move.duration, move.start + (1 + AFTER) * move.duration
    load, speed = signals.load.between(start, end), signals.speed.between(start, end)
    curves = [(1e3 * (load.time - move.start), move.direction * load.value)]
    if len(speed) > 3:
        period = float(np.median(np.diff(speed.time)))
        motor = move.direction * derivative(speed.value, period, 3)
        curves.append((1e3 * (speed.time - move.start), motor))
    return curves


def _padded(values: FloatArray) -> tuple[float, float]:
    low, high = float(np.min(values)), float(np.max(values))
    margin = 0.08 * (high - low) or 1.0
    return low - margin, high + margin


def _marks(frame: _Frame, move: Move, step: StepResult | None) -> list[str]:
    """The pass from t1 to t2 as a band with its names above, or nothing."""
    if step is None or step.t1 is None or step.t2 is None or step.backlash is None:
        return []
    x1, x2 = (frame.at_x(1e3 * (t - move.start)) for t in (step.t1, step.t2))
    height = HEIGHT - TOP - BOTTOM
    band = f'<rect x="{x1:.1f}" y="{TOP}" width="{x2 - x1:.1f}" height="{height}" fill="{PASS}" fill-opacity="0.18"/>'
    ends = [
        f'<line x1="{x:.1f}" y1="{TOP}" x2="{x:.1f}" y2="{HEIGHT - BOTTOM}" stroke="{PASS}" stroke-dasharray="4 3"/>'
        for x in (x1, x2)
    ]
    return [
        band,
        *ends,
        _text(x1 - 4, TOP + 14, 't<tspan font-size="9" dy="3">1</tspan>', anchor="end", colour=PASS),
        _text(x2 + 4, TOP + 14, 't<tspan font-size="9" dy="3">2</tspan>', colour=PASS),
        _text(x2 + 4, TOP + 32, f"backlash {step.backlash * 1e6:.1f} µm", colour=PASS),
    ]


def _axes(frame: _Frame) -> list[str]:
    """Grid, tick labels and axis titles with units."""
    bottom, right = HEIGHT - BOTTOM, WIDTH - RIGHT
    parts = []
    for value in _ticks(*frame.x):
        x = frame.at_x(value)
        parts.append(_rule(x, TOP, x, bottom, 0.25))
        parts.append(_text(x, bottom + 18, f"{value:g}", anchor="middle"))
    for value in _ticks(*frame.y):
        y = frame.at_y(value)
        parts.append(_rule(LEFT, y, right, y, 0.7 if value == 0 else 0.25))
        parts.append(_text(LEFT - 8, y + 4, f"{value:g}".replace("-", "−"), anchor="end"))
    middle = (TOP + bottom) / 2
    parts.append(
        _text((LEFT + right) / 2, HEIGHT - 12, "time since the start of the move / ms", anchor="middle")
    )
    title = _text(0, 0, "acceleration / (m/s²)", anchor="middle")
    parts.append(f'<g transform="translate(18 {middle:.0f}) rotate(-90)">{title}</g>')
    return parts


def _ticks(low: float, high: float, about: int = 7) -> list[float]:
    """Round values between low and high, `about` so many: steps of 1, 2 or 5 times a power of ten."""
    rough = (high - low) / about
    power = 10.0 ** np.floor(np.log10(rough))
    spacing = float(power * min((m for m in (1, 2, 5, 10) if m * power >= rough), default=10))
    first, last = int(np.ceil(low / spacing)), int(np.floor(high / spacing))
    return [round(k * spacing, 9) for k in range(first, last + 1)]


def _line(frame: _Frame, x: FloatArray, y: FloatArray, colour: str) -> str:
    points = " ".join(f"{frame.at_x(a):.1f},{frame.at_y(b):.1f}" for a, b in zip(x, y, strict=True))
    return f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.6" stroke-linejoin="round"/>'


def _legend() -> list[str]:
    """Names of the two curves, to the right above the picture."""
    parts = []
    for x, colour, name in ((WIDTH - 330, MOTOR, "motor (at the output)"), (WIDTH - 140, LOAD, "load")):
        parts.append(f'<line x1="{x}" y1="28" x2="{x + 24}" y2="28" stroke="{colour}" stroke-width="3"/>')
        parts.append(_text(x + 30, 32, name))
    return parts


def _rule(x1: float, y1: float, x2: float, y2: float, opacity: float) -> str:
    return f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{INK}" stroke-opacity="{opacity}"/>'


def _text(x: float, y: float, markup: str, anchor: str = "start", colour: str = INK) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}">{markup}</text>'


def _document(title: str, parts: Sequence[str]) -> str:
    name = escape(title)
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
        f'font-family="system-ui, sans-serif" font-size="13" role="img" aria-label="{name}">'
    )
    heading = f'<text x="{LEFT}" y="32" font-size="15" font-weight="600" fill="{INK}">{name}</text>'
    return "\n".join([head, f"<title>{name}</title>", heading, *parts, "</svg>"]) + "\n"
