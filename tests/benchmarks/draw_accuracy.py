"""Draw the README's picture from the records of the accuracy benchmark: the paper's Figs. 8 and 9, for both methods.

    python tests/benchmarks/draw_accuracy.py build/accuracy/results.jsonl -o deploy/accuracy.svg

Left single axes, right gantries. Above the estimated over the true backlash, below how far it is off, on a
logarithmic scale. Only axes that both methods answered are shown; how many were not is written in the picture.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from service.recording import FloatArray
from tests.benchmarks.campaign import records
from tests.benchmarks.measuring import Record

PAPER, OURS, INK = "#e07b00", "#2f7ed8", "#7d8590"
PANEL, HIGH, LOW, GAP, LEFT, TOP = 330, 250, 170, 70, 60, 62
WIDTH, HEIGHT = LEFT + 2 * PANEL + GAP + 16, TOP + HIGH + 46 + LOW + 50
LARGEST = 180.0
ERRORS = (1e-3, 1e2)
"""Range of the true backlash and of the errors [µm]."""


@dataclass(frozen=True)
class Panel:
    """A box in the picture with a linear x axis [µm] and a linear or logarithmic y axis [µm]."""

    left: float
    top: float
    height: float
    y: tuple[float, float]
    logarithmic: bool = False

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Where a point lies in the picture."""
        low, high = self._scaled(self.y[0]), self._scaled(self.y[1])
        share = (self._scaled(min(max(y, self.y[0]), self.y[1])) - low) / (high - low)
        return self.left + PANEL * x / LARGEST, self.top + self.height * (1.0 - share)

    def _scaled(self, y: float) -> float:
        return float(np.log10(y)) if self.logarithmic else y


def pairs(found: Sequence[Record], row: str) -> tuple[FloatArray, FloatArray, FloatArray, int]:
    """True, the paper's and our backlash [µm] of the axes that both answered (n,), and how many they did not."""
    answers = {
        method: {(r["capture"], r["axis"]): r for r in found if (r["row"], r["method"]) == (row, method)}
        for method in ("paper", "model_fit")
    }
    plain, fit = answers["paper"], answers["model_fit"]
    known = sorted(set(plain) & set(fit))
    both = [k for k in known if plain[k]["verdict"] == fit[k]["verdict"] == "ok"]
    columns = (
        [1e6 * plain[k]["true_m"] for k in both],
        *([1e6 * a[k]["backlash_m"] for k in both] for a in (plain, fit)),
    )
    true, paper, ours = (np.array(column, dtype=np.float64) for column in columns)
    return true, paper, ours, len(known) - len(both)


def picture(found: Sequence[Record]) -> str:
    """The whole picture as SVG text."""
    parts = []
    for column, (row, name) in enumerate((("single", "single axes"), ("gantry", "gantry axes"))):
        true, paper, ours, left_out = pairs(found, row)
        left = LEFT + column * (PANEL + GAP)
        above = Panel(left, TOP, HIGH, (0.0, LARGEST))
        below = Panel(left, TOP + HIGH + 46, LOW, ERRORS, logarithmic=True)
        note = f"; {left_out} not answered by both" if left_out else ""
        parts += [_text(left, TOP - 10, f"{len(true)} {name}{note}", weight=600)]
        parts += _frame(above, range(0, 181, 30)) + _frame(below, (1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0))
        parts.append(_line(above.at(0.0, 0.0), above.at(LARGEST, LARGEST)))
        for estimated, colour in ((paper, PAPER), (ours, OURS)):
            parts += [_dot(above.at(x, y), colour) for x, y in zip(true, estimated, strict=True)]
            off = np.maximum(np.abs(estimated - true), ERRORS[0])
            parts += [_dot(below.at(x, y), colour) for x, y in zip(true, off, strict=True)]
            parts += _median(below, off, colour)
    return _document([*parts, *_titles()])


def _median(panel: Panel, off: FloatArray, colour: str) -> list[str]:
    """A line at the median error with its number."""
    if len(off) == 0:
        return []
    middle = float(np.median(off))
    ends = panel.at(0.0, middle), panel.at(LARGEST, middle)
    return [
        _line(*ends, colour=colour, opacity=0.9),
        _text(ends[1][0] - 4, ends[1][1] - 4, f"{middle:.2g} µm", "end", colour),
    ]


def _frame(panel: Panel, ticks: Sequence[float]) -> list[str]:
    """Grid and tick labels."""
    parts = []
    for x in range(0, 181, 30):
        at = panel.at(x, panel.y[0])
        parts += [_line(at, (at[0], panel.top), opacity=0.2), _text(at[0], at[1] + 16, str(x), "middle")]
    for y in ticks:
        at = panel.at(0.0, y)
        parts += [
            _line(at, (at[0] + PANEL, at[1]), opacity=0.2),
            _text(at[0] - 6, at[1] + 4, f"{y:g}", "end"),
        ]
    return parts


def _titles() -> list[str]:
    """Legend and the axes' titles."""
    parts = []
    for x, colour, name in ((LEFT, PAPER, "the paper's thresholds"), (LEFT + 190, OURS, "model fit")):
        parts += [_dot((x + 4, 18), colour, 4.5), _text(x + 14, 22, name)]
    for column in range(2):
        parts.append(
            _text(LEFT + column * (PANEL + GAP) + PANEL / 2, HEIGHT - 12, "true backlash / µm", "middle")
        )
    for middle, name in ((TOP + HIGH / 2, "estimated / µm"), (TOP + HIGH + 46 + LOW / 2, "|error| / µm")):
        parts.append(
            f'<g transform="translate(16 {middle:.0f}) rotate(-90)">{_text(0, 0, name, "middle")}</g>'
        )
    return parts


def _dot(at: tuple[float, float], colour: str, radius: float = 2.6) -> str:
    return f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{radius}" fill="{colour}" fill-opacity="0.75"/>'


def _line(
    start: tuple[float, float], end: tuple[float, float], colour: str = INK, opacity: float = 0.7
) -> str:
    (x1, y1), (x2, y2) = start, end
    ends = f'x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"'
    return f'<line {ends} stroke="{colour}" stroke-opacity="{opacity}"/>'


def _text(x: float, y: float, text: str, anchor: str = "start", colour: str = INK, weight: int = 400) -> str:
    place = f'x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"'
    return f'<text {place} fill="{colour}" font-weight="{weight}">{text}</text>'


def _document(parts: Sequence[str]) -> str:
    name = "Estimated over true backlash: the paper's thresholds and the model fit, single axes and gantries"
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
        f'font-family="system-ui, sans-serif" font-size="12" role="img" aria-label="{name}">'
    )
    return "\n".join([head, f"<title>{name}</title>", *parts, "</svg>"]) + "\n"


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw the picture of the newest version's records in a file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", type=Path)
    parser.add_argument("--out", "-o", type=Path, required=True)
    options = parser.parse_args(arguments)
    found = records(options.results)
    if not found:
        parser.exit(1, f"{options.results} holds no records; run tests/benchmarks/accuracy.py first\n")
    options.out.write_text(
        picture([r for r in found if r["source"] == found[-1]["source"]]), encoding="utf-8"
    )


if __name__ == "__main__":
    main()
