"""The entry of the analysis: one result per axis of a recording, by the best method whose verdict is ok."""

from __future__ import annotations

from service.backlash.paper import paper
from service.backlash.results import AxisResult
from service.recording import Recording


def estimate(recording: Recording) -> tuple[AxisResult, ...]:
    """Backlash of every axis of a recording, in the order of its description; a value or a named refusal."""
    return tuple(paper(recording, axis.name) for axis in recording.axes)
