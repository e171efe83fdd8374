"""The page about one explanation: what was found, how the error changed, what it means and what to do.

One HTML document that needs nothing else: its style is in it, its pictures are drawn into it, it has no script.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from service.recording import Recording
from service.report.pictures import Predictions, pictures, told
from service.report.words import effect_words, finding_in_words, named

Finding = Mapping[str, Any]
"""An element of ``axes`` in the JSON of an explanation."""

STYLE = """
:root { color-scheme: light dark; --ground: #fff; --text: #14202b; --soft: #4b5b69; --rule: #cdd6de;
  --measured: #6b7c8b; --before: #b3261e; --after: #0b5c8a; --box: #eef3f7; }
@media (prefers-color-scheme: dark) { :root { --ground: #10161b; --text: #e8eef3; --soft: #a6b5c2; --rule: #34424e;
  --measured: #95a6b4; --before: #ff9d94; --after: #6dbcec; --box: #1a232b; } }
body { background: var(--ground); color: var(--text); font: 16px/1.5 system-ui, sans-serif; max-width: 920px;
  margin: 0 auto; padding: 16px; }
h1 { font-size: 1.5rem; margin: 0; } h2 { font-size: 1.25rem; margin: 28px 0 8px; } h3 { font-size: 1.05rem; }
.soft { color: var(--soft); } .says { font-size: 1.1rem; background: var(--box); padding: 12px 14px;
  border-left: 5px solid var(--after); border-radius: 6px; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: 8px 0; }
th, td { text-align: left; padding: 4px 16px 4px 0; border-bottom: 1px solid var(--rule); vertical-align: top; }
td.n, th.n { text-align: right; white-space: nowrap; } .scroll { overflow-x: auto; }
svg { width: 100%; height: auto; display: block; margin: 6px 0 14px; } svg text { fill: var(--soft);
  font: 13px system-ui, sans-serif; } svg .grid { stroke: var(--rule); stroke-width: 1; }
svg polyline { fill: none; stroke-width: 1.7; stroke-linejoin: round; } svg line { stroke-width: 3; }
svg .grid { stroke-width: 1; } svg .measured { stroke: var(--measured); } svg .before { stroke: var(--before);
  stroke-dasharray: 6 3; } svg .after { stroke: var(--after); }
@media print { body { max-width: none; } }
"""


def report_page(
    title: str, about: Sequence[str], found: Mapping[str, Any], predictions: Predictions, recording: Recording
) -> str:
    """Write the page of an explanation.

    Parameters
    ----------
    about : sentences that say which recordings this rests on
    found : the explanation's JSON
    predictions : of the judging recording; an axis without them is told without pictures
    recording : the judging recording
    """
    body = [f"<h1>{escape(title)}</h1>", *(f'<p class="soft">{escape(line)}</p>' for line in about)]
    for axis in found["axes"]:
        body += _axis(axis, predictions, recording)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head>\n<body>\n"
        + "\n".join(part for part in body if part)
        + "\n</body></html>\n"
    )


def _axis(axis: Finding, predictions: Predictions, recording: Recording) -> list[str]:
    shown = told(recording, predictions, axis["axis"], axis["channel"])
    drawn = [] if shown is None else pictures(recording, shown, axis["axis"], tuple(axis["effects"]))
    return [
        f"<h2>Axis {escape(axis['axis'])}</h2>",
        f'<p class="says">{escape(finding_in_words(axis))}</p>',
        *_meanings(axis),
        "<h3>The error before and after</h3>",
        _before_and_after(axis),
        *_separating(axis),
        "<h3>Measured and predicted, in a run that was not fitted</h3>" if drawn else "",
        *drawn,
        *_ranking(axis),
        *_parameters(axis),
        *_evidence(axis),
    ]


def _meanings(axis: Finding) -> list[str]:
    parts = []
    for effect in dict.fromkeys(
        [*axis["effects"], *(e for group in axis["indistinguishable"] for e in group)]
    ):
        words = effect_words(effect)
        name = f"{words.name[:1].upper()}{words.name[1:]}"
        parts.append(
            f"<p><strong>{escape(name)}</strong> ({escape(effect)}). {escape(words.means)} {escape(words.check)}</p>"
        )
    return parts


def _before_and_after(axis: Finding) -> str:
    before, after, noise = axis["before"], axis["after"], axis["noise_rms"]
    rows = [
        ("Backlash", *(_micrometres(one["backlash_m"]) for one in (before, after))),
        ("its 95 % interval", *(_interval(one["interval_95_m"]) for one in (before, after))),
        (
            "Error on the run that was not fitted (RMS)",
            *(_number(one["validation_rms"]) for one in (before, after)),
        ),
        (
            "the same over the sensor's noise",
            *(_ratio(one["validation_rms"], noise) for one in (before, after)),
        ),
        ("expected if the model is right", *(_number(one.get("expected_rms")) for one in (before, after))),
        ("the same over the signal", *(_percent(one.get("normalised_rms")) for one in (before, after))),
        ("Error on the run that was fitted (RMS)", *(_number(one["train_rms"]) for one in (before, after))),
        (
            "Pattern left in the error (0 none, 1 all)",
            *(_number(one.get("whiteness")) for one in (before, after)),
        ),
    ]
    return _table(("", "declared model", "with the effect"), rows)


def _separating(axis: Finding) -> list[str]:
    move = axis["separating_move"]
    if move is None:
        return []
    way = "towards larger positions" if move["direction"] > 0 else "towards smaller positions"
    steps = (
        f"{1e3 * move['length_m']:.3g} mm at {move['jerk_m_s3']:.3g} m/s³, first {way}, {move['position']}"
    )
    return [
        "<h3>The move that would tell them apart</h3>",
        f"<p>{escape(named(axis['indistinguishable'][0]) if axis['indistinguishable'] else '')}: "
        f"steps of {escape(steps)}. {escape(move['why'])}. The service can make it on its own axis within its "
        "limits.</p>",
    ]


def _ranking(axis: Finding) -> list[str]:
    if not axis["candidates"]:
        return []
    ranked = sorted(
        axis["candidates"], key=lambda c: (c["validation_rms"] is None, c["validation_rms"] or 0.0)
    )
    rows = [
        (
            ("✓ " if one.get("accepted") else "") + effect_words(one["effect"]).name,
            _number(one["validation_rms"]),
            "–" if one["p_value"] is None else f"{one['p_value']:.1g}",
            one.get("why", ""),
        )
        for one in ranked
    ]
    heads = ("candidate", "error with it (RMS)", "chance of so much by luck", "why it was taken or not")
    return ["<h3>What was tried</h3>", _table(heads, rows, words=3)]


def _parameters(axis: Finding) -> list[str]:
    if not axis["parameters"]:
        return []
    rows = [
        (name.replace("_", " "), _number(one["value"]), _number(one["std"]), one["unit"])
        for name, one in axis["parameters"].items()
    ]
    heads = ("parameter", "value", "standard deviation", "unit")
    return ["<h3>The model's numbers</h3>", _table(heads, rows, words=3)]


def _evidence(axis: Finding) -> list[str]:
    lines = axis.get("evidence") or []
    if not lines:
        return []
    return [
        "<h3>What speaks for it</h3>",
        "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>",
    ]


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]], words: int = 99) -> str:
    """A table whose columns hold numbers from the second one on, and words again from column ``words`` on."""

    def cell(tag: str, k: int, content: str) -> str:
        number = ' class="n"' if 0 < k < words else ""
        return f"<{tag}{number}>{escape(str(content))}</{tag}>"

    head = "".join(cell("th", k, content) for k, content in enumerate(heads))
    body = "".join("<tr>" + "".join(cell("td", k, c) for k, c in enumerate(row)) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"


def _micrometres(value: float | None) -> str:
    return "–" if value is None else f"{1e6 * value:.2f} µm"


def _interval(ends: Sequence[float] | None) -> str:
    if ends is None or any(end is None for end in ends):
        return "–"
    return f"{1e6 * ends[0]:.2f} to {1e6 * ends[1]:.2f} µm"


def _ratio(value: float | None, noise: float | None) -> str:
    return "–" if value is None or not noise else f"{value / noise:.2f}"


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.2f} %"
