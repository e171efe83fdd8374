"""Curves and bars as SVG text, coloured by the page's own classes: no library, no script, nothing from elsewhere."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from service.recording import FloatArray

WIDTH, HEIGHT = 860, 300
LEFT, RIGHT, TOP, BOTTOM = 76, 16, 34, 46
MOST_POINTS = 1600
"""Points of a curve beyond which it is drawn as the envelope of its samples: more than there are pixels."""


@dataclass(frozen=True)
class Curve:
    """One curve: its name in the legend, its class in the page's style, x and y (n,) in the axes' units."""

    name: str
    style: str
    x: FloatArray
    y: FloatArray


def curves(title: str, x_label: str, y_label: str, shown: Sequence[Curve], *, log_y: bool = False) -> str:
    """Draw curves over one another, the first one lowest."""
    drawn = [_thinned(curve) for curve in shown if len(curve.x)]
    if not drawn:
        return ""
    if log_y:
        drawn = [Curve(c.name, c.style, c.x, np.log10(np.maximum(c.y, 1e-12))) for c in drawn]
    frame = _Frame(_range([c.x for c in drawn], 0.0), _range([c.y for c in drawn], 0.06))
    parts = [*_grid(frame, x_label, y_label, log_y), *(_polyline(frame, c) for c in drawn), *_legend(drawn)]
    return _document(title, parts)


@dataclass(frozen=True)
class _Frame:
    """Linear map from the data to the picture."""

    x: tuple[float, float]
    y: tuple[float, float]

    def at_x(self, value: FloatArray) -> FloatArray:
        return LEFT + (value - self.x[0]) / (self.x[1] - self.x[0]) * (WIDTH - LEFT - RIGHT)

    def at_y(self, value: FloatArray) -> FloatArray:
        return HEIGHT - BOTTOM - (value - self.y[0]) / (self.y[1] - self.y[0]) * (HEIGHT - TOP - BOTTOM)


def _range(values: Sequence[FloatArray], margin: float) -> tuple[float, float]:
    low, high = (float(edge) for edge in (min(v.min() for v in values), max(v.max() for v in values)))
    pad = margin * (high - low) if high > low else max(abs(high), 1.0) * 0.1
    return low - pad, high + pad


def _thinned(curve: Curve) -> Curve:
    """The smallest and largest sample of each of many equal parts: no peak is lost."""
    n = len(curve.x)
    if n <= MOST_POINTS:
        return curve
    edges = np.linspace(0, n, MOST_POINTS // 2 + 1).astype(int)
    chosen: list[int] = []
    for start, end in itertools.pairwise(edges):
        part = curve.y[start:end]
        chosen += sorted({start + int(np.argmin(part)), start + int(np.argmax(part))})
    return Curve(curve.name, curve.style, curve.x[chosen], curve.y[chosen])


def _polyline(frame: _Frame, curve: Curve) -> str:
    x, y = frame.at_x(curve.x), frame.at_y(curve.y)
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    return f'<polyline class="{curve.style}" points="{points}"/>'


def _grid(frame: _Frame, x_label: str, y_label: str, log_y: bool) -> list[str]:
    bottom, right = HEIGHT - BOTTOM, WIDTH - RIGHT
    parts = []
    for value in ticks(*frame.x):
        x = float(frame.at_x(np.array(value)))
        parts.append(f'<line class="grid" x1="{x:.1f}" y1="{TOP}" x2="{x:.1f}" y2="{bottom}"/>')
        parts.append(text(x, bottom + 18, f"{value:g}", "middle"))
    for value in ticks(*frame.y, about=5):
        y = float(frame.at_y(np.array(value)))
        parts.append(f'<line class="grid" x1="{LEFT}" y1="{y:.1f}" x2="{right}" y2="{y:.1f}"/>')
        parts.append(text(LEFT - 8, y + 4, f"{10**value:.2g}" if log_y else f"{value:g}", "end"))
    parts.append(text((LEFT + right) / 2, HEIGHT - 10, x_label, "middle"))
    turned = text(0, 0, y_label, "middle")
    return [*parts, f'<g transform="translate(16 {(TOP + bottom) / 2:.0f}) rotate(-90)">{turned}</g>']


def ticks(low: float, high: float, about: int = 8) -> list[float]:
    """Round values between low and high, `about` so many: steps of 1, 2 or 5 times a power of ten."""
    rough = (high - low) / about
    power = 10.0 ** np.floor(np.log10(rough))
    spacing = float(power * min((m for m in (1, 2, 5, 10) if m * power >= rough), default=10))
    first, last = int(np.ceil(low / spacing)), int(np.floor(high / spacing))
    return [round(k * spacing, 12) for k in range(first, last + 1)]


def _legend(shown: Sequence[Curve]) -> list[str]:
    parts, x = [], float(LEFT)
    for curve in shown:
        parts.append(f'<line class="{curve.style}" x1="{x:.0f}" y1="16" x2="{x + 26:.0f}" y2="16"/>')
        parts.append(text(x + 32, 20, curve.name))
        x += 48 + 7.2 * len(curve.name)
    return parts


def text(x: float, y: float, content: str, anchor: str = "start") -> str:
    """Text in the page's ink."""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(content).replace("-", "−")}</text>'


def _document(title: str, parts: Sequence[str]) -> str:
    name = escape(title)
    head = f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{name}">'
    return "\n".join([head, f"<title>{name}</title>", *parts, "</svg>"])
