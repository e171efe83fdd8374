"""Places and directions: each place is an experiment by itself, and what parts of a run say is their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from service.backlash.estimate import immediate
from service.backlash.meaning import at_each_place, experiments
from service.backlash.results import AxisResult, Reason, StepResult
from service.recording import Move, Recording
from tests.service.backlash.ideal import Run, recording

SOUND = Run(noise=0.01)


def at(places: Sequence[float]) -> Recording:
    """A sound run whose moves were made around these places [m], in turn of equal shares."""
    source = recording(SOUND)
    each = len(source.moves) // len(places)

    def placed(k: int, move: Move) -> Move:
        return replace(move, position=places[k // each] - 0.5 * move.direction * move.length)

    return replace(source, moves=tuple(placed(k, move) for k, move in enumerate(source.moves)))


def told(values: Sequence[float | None]) -> list[AxisResult]:
    """A method's answers for place after place [m]; None is a refusal."""
    return [
        AxisResult("X1", "refused", "m", Reason.MISFIT, "no")
        if b is None
        else AxisResult(
            "X1",
            "ok",
            "m",
            backlash=b,
            interval_95=(b - 1e-6, b + 1e-6),
            steps=(StepResult(0, 1, "ok", backlash=b),),
        )
        for b in values
    ]


def test_steps_to_and_fro_are_one_place() -> None:
    (only,) = experiments(at([0.5]))
    assert only.position == pytest.approx(0.5)
    assert len(only.recording.moves) == 10


def test_each_place_is_cut_out_with_its_own_moves() -> None:
    first, second = experiments(at([0.5, 1.2]))
    assert (first.position, second.position) == (pytest.approx(0.5), pytest.approx(1.2))
    assert (first.first, second.first) == (0, 5)
    assert second.recording.traces["X1", "motor_speed"].time[0] > first.recording.moves[-1].end


def test_without_places_the_run_is_whole() -> None:
    (only,) = experiments(recording(SOUND))
    assert only.position is None


def test_the_value_is_the_mean_and_the_map_says_each() -> None:
    answers = iter(told([50e-6, 70e-6]))
    (result,) = at_each_place(at([0.5, 1.2]), lambda part: (next(answers),))
    assert result.backlash == pytest.approx(60e-6)
    assert [place.backlash for place in result.by_place] == [50e-6, 70e-6]
    assert [step.index for step in result.steps] == [0, 5]


def test_a_place_that_is_refused_refuses_the_mean_but_not_the_map() -> None:
    answers = iter(told([50e-6, None]))
    (result,) = at_each_place(at([0.5, 1.2]), lambda part: (next(answers),))
    assert (result.verdict, result.reason, result.backlash) == ("refused", Reason.MISFIT, None)
    assert [place.verdict for place in result.by_place] == ["ok", "refused"]


def test_the_directions_of_a_real_run_say_the_same_gap() -> None:
    (result,) = immediate(recording(SOUND))
    assert [part.steps for part in result.by_direction] == [5, 5]
    for part in result.by_direction:
        assert part.interval_95[0] < SOUND.b < part.interval_95[1]
