"""The picture of a step is well-formed SVG that shows what it says."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree

from service.backlash.figure import BOTTOM, HEIGHT, step_picture
from service.backlash.paper import paper
from service.recording import Recording
from tests.service.backlash.ideal import Run, recording

SVG = "{http://www.w3.org/2000/svg}"


def drawn(source: Recording, index: int, marked: bool) -> ElementTree.Element:
    return parsed(step_picture(source, "X1", index, paper(source, "X1") if marked else None))


def parsed(picture: str | None) -> ElementTree.Element:
    assert picture is not None
    return ElementTree.fromstring(picture)


def texts(root: ElementTree.Element) -> str:
    return " ".join("".join(node.itertext()) for node in root.iter(f"{SVG}text"))


def test_curves_units_and_value_are_shown() -> None:
    root = drawn(recording(Run()), 3, marked=True)
    assert len(root.findall(f"{SVG}polyline")) == 2
    for word in ("motor", "load", "ms", "m/s²", "µm", "t1", "t2", "backward"):
        assert word in texts(root)


def test_the_pass_is_drawn_where_it_is() -> None:
    """Ticks give the scale: the band's left edge lies at half of the move, where the ideal flanks part."""
    run = Run()
    source = recording(run)
    root = drawn(source, 0, marked=True)
    below = [node for node in root.iter(f"{SVG}text") if node.attrib["y"] == f"{HEIGHT - BOTTOM + 18:.1f}"]
    ticks = {node.text: float(node.attrib["x"]) for node in below}
    band = root.find(f"{SVG}rect")
    assert band is not None
    shown = (float(band.attrib["x"]) - ticks["0"]) / (ticks["40"] - ticks["0"]) * 40.0
    assert abs(shown - 1e3 * source.moves[0].duration / 2) < 1.0


def test_without_a_result_nothing_is_marked() -> None:
    assert drawn(recording(Run()), 0, marked=False).find(f"{SVG}rect") is None


def test_a_channel_that_is_missing_is_said() -> None:
    source = recording(Run())
    blind = replace(source, traces={("X1", "motor_speed"): source.traces["X1", "motor_speed"]})
    assert "not recorded" in texts(parsed(step_picture(blind, "X1", 0)))


def test_names_cannot_break_the_markup() -> None:
    source = recording(Run(), axis="X<1>&")
    parsed(step_picture(source, "X<1>&", 0))


def test_a_step_that_is_not_there_has_no_picture() -> None:
    assert step_picture(recording(Run(count=3)), "X1", 3) is None
