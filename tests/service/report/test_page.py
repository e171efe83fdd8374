"""The page about a finding: whole in itself, and it says what was found."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import pytest

from service.captures.report import predicted_traces
from service.report.page import report_page
from service.report.words import effect_words, finding_in_words, named
from tests.service.runs.bench import explained, recording


def page(note: str | None) -> str:
    train, judge = recording(note, seed=1), recording(note, seed=2)
    found = explained([train], judge, lambda _: None, {})
    return report_page(
        "Model check", ["Judged on <run 2>."], found.as_json(), predicted_traces(found.predictions()), judge
    )


@pytest.mark.parametrize("effect", ["sensor_latency", "transmission_ripple", None])
def test_the_page_needs_nothing_from_elsewhere(effect: str | None) -> None:
    written = page(effect)
    assert not re.search(r"<script|https?://|src=|@import|url\(", written)
    pictures = re.findall(r"<svg.*?</svg>", written, re.DOTALL)
    assert len(pictures) == 3
    for picture in pictures:
        assert len(ET.fromstring(picture).findall(".//polyline")) >= 2
    assert "&lt;run 2&gt;" in written


def test_the_page_tells_the_error_before_and_after() -> None:
    written = page("sensor_latency")
    assert "80.00 µm" in written
    assert "57.00 µm" in written
    assert re.search(r"expected if the model is right</td><td[^>]*>0.0321</td>", written)
    assert effect_words("sensor_latency").check in written
    assert "What was tried" in written


def test_a_residual_along_the_travel_is_drawn_over_it() -> None:
    assert "along the travel" in page("transmission_ripple")
    assert "Spectrum" in page("sensor_latency")


def test_findings_in_words() -> None:
    found = explained([recording("sensor_latency")], recording("sensor_latency", seed=2), lambda _: None, {})
    axis = found.as_json()["axes"][0]
    assert finding_in_words(axis).startswith("The model lacks a time lag")
    assert "look alike" in finding_in_words(
        axis | {"indistinguishable": [["sensor_latency", "speed_filter"]]}
    )
    for times, said in ((1.1, "Nothing is missing"), (3.0, "Nothing that matters")):
        left = axis["before"] | {"validation_rms": times * axis["noise_rms"]}
        assert finding_in_words(axis | {"finding": "none", "before": left}).startswith(said)
    assert " 3.0 times the sensor's noise" in finding_in_words(axis | {"finding": "none", "before": left})
    assert "no effect that Flankwatch knows" in finding_in_words(axis | {"finding": "unknown"})
    revised = axis | {"accepted": ["hung_mass_mode"]}
    assert finding_in_words(revised).startswith(
        "The accepted model (with an elastically hung mass on the carriage) lacks a time lag"
    )
    assert "explains the run" in finding_in_words(revised | {"finding": "none"})
    assert "missing in the accepted model" in finding_in_words(revised | {"finding": "unknown"})
    absent = axis | {"finding": "none", "absent": ["hung_mass_mode"]}
    assert "shows nothing of what was accepted" in finding_in_words(absent)
    assert named(["a_b", "c_d", "e_f"]) == "a b, c d and e f"
