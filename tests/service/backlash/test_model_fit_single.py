"""How the stages of a single axis go on from what they found; the fits themselves are stood in for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from service.backlash import model_fit_single as single
from service.backlash.model_fit_stages import Effort, Outcome, Staged


@dataclass(frozen=True)
class Stood:
    """A problem that is nothing."""

    echoes: tuple[int, ...] = ()

    def judged(self) -> Stood:
        return self


def outcome(misfit: float) -> Outcome:
    fit = SimpleNamespace(misfit=misfit, cost=1000.0 * misfit, point=None)
    return Outcome(Stood(), fit)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("few", "whole", "seeds", "refined"),
    [
        ([1.2], [1.1], [1], [1.2]),
        # nowhere near on the few steps: the better start alone is refined
        ([60.0, 1.2], [1.1], [1, 2], [1.2]),
        ([60.0, 80.0], [9.0], [1, 2], [60.0]),
        # far from all steps: only a start that is nearer on the few is worth another fit
        ([8.5, 2.5], [6.6, 3.5], [1, 2], [8.5, 2.5]),
        ([8.5, 2.5], [6.6, 7.5], [1, 2], [8.5, 2.5]),
        ([6.0, 5.5], [8.0], [1, 2], [6.0]),
        ([1.4, 1.04], [1.3, 1.01], [1, 2], [1.4, 1.04]),
    ],
)
def test_a_search_that_came_nowhere_near_is_done_once_more(
    monkeypatch: pytest.MonkeyPatch,
    few: list[float],
    whole: list[float],
    seeds: list[int],
    refined: list[float],
) -> None:
    drawn: list[int] = []
    starts, ends = iter(few), iter(whole)
    begun: list[float] = []

    def searched(measured: object, problem: object, guesses: object, effort: Effort) -> list[Outcome]:
        drawn.append(effort.seed)
        return [outcome(next(starts))]

    def fitted(measured: object, problem: object, first: list[Outcome], effort: Effort) -> Staged:
        begun.append(first[0].fit.misfit)
        end = outcome(next(ends))
        return Staged(end, [end], first)

    monkeypatch.setattr(single, "problem_of", lambda *_: None)
    monkeypatch.setattr(single, "from_starts", searched)
    monkeypatch.setattr(single, "following_force", lambda measured, problem, found: problem)
    monkeypatch.setattr(single, "passes", lambda *_: [])
    monkeypatch.setattr(single, "refined", fitted)
    monkeypatch.setattr(single, "followed", lambda measured, found: found)
    monkeypatch.setattr(single, "expected_misfit", lambda measured, found: 1.1)
    measured = SimpleNamespace(axes=("X1",))
    found = single.single_fit(measured, {}, Effort())  # type: ignore[arg-type]
    assert drawn == seeds
    assert begun == refined
    assert found.best.fit.misfit == min(whole)


@pytest.mark.parametrize(
    ("misfits", "ends"),
    [
        ([1.4], [1.4]),
        ([4.6, 1.02, 1.04], [4.6, 1.02]),
        ([9.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0], [9.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0]),
    ],
)
def test_the_motor_follows_as_long_as_that_is_better(
    monkeypatch: pytest.MonkeyPatch, misfits: list[float], ends: list[float]
) -> None:
    later: Iterator[float] = iter(misfits[1:])
    dearest: list[float] = []

    def fitted(*_: object, **limits: float) -> object:
        dearest.append(limits["dearest"])
        return outcome(next(later)).fit

    monkeypatch.setattr(single, "with_following_motors", lambda measured, problem, found: problem)
    monkeypatch.setattr(single, "expected_misfit", lambda measured, found: 1.0)
    monkeypatch.setattr(single, "fit", fitted)
    first = outcome(misfits[0])
    found = single.followed(None, Staged(first, [first], [first]))  # type: ignore[arg-type]
    assert [end.fit.misfit for end in found.ends] == ends
    assert found.best.fit.misfit == min(ends)
    assert dearest == [1000.0 * misfit for misfit in misfits[:-1]][: len(dearest)]


def test_no_motor_follows_where_the_noise_of_its_speed_is_all_that_is_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(single, "expected_misfit", lambda measured, found: 5.0)
    first = outcome(4.6)
    found = single.followed(None, Staged(first, [first], [first]))  # type: ignore[arg-type]
    assert found.ends == [first]
