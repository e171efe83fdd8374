"""What a search may simulate: attempts are given up at their share, and what must be done is done."""

from __future__ import annotations

import pytest

from service.dynamics.work import count, counted, given_up, up_to


def simulating(amounts: list[float], done: list[float]) -> str:
    for amount in amounts:
        count(amount)
        done.append(amount)
    return "found"


def test_without_a_count_nothing_is_limited() -> None:
    done: list[float] = []
    assert up_to(0.0, lambda: simulating([1e12, 1e12], done), "given up") == "found"
    assert (done, given_up()) == ([1e12, 1e12], 0)


def test_an_attempt_is_given_up_beyond_its_share_of_the_whole() -> None:
    done: list[float] = []
    with counted(100.0) as work:
        count(20.0)
        assert up_to(0.5, lambda: simulating([20.0, 10.0], done), "given up") == "found"
        assert up_to(0.5, lambda: simulating([20.0, 10.0], done), "given up") == "given up"
        assert (work.given_up, given_up()) == (1, 1)
        count(1000.0)  # what must be done is not limited
        assert up_to(1.0, lambda: simulating([1.0], done), "given up") == "given up"
    assert done == [20.0, 10.0, 20.0]
    assert given_up() == 0


def test_an_attempt_within_another_takes_no_more_than_that_may() -> None:
    done: list[float] = []

    def outer() -> str:
        inner = up_to(1.0, lambda: simulating([30.0, 30.0, 30.0], done), "inner given up")
        done.append(0.0)
        count(1.0)
        return inner

    with counted(100.0):
        assert up_to(0.4, outer, "outer given up") == "outer given up"
        assert done == [30.0, 30.0, 0.0]
        assert up_to(1.0, lambda: simulating([5.0], done), "given up") == "found"


def test_an_error_is_no_end_of_an_attempt() -> None:
    def failing() -> str:
        raise ValueError("no moves")

    with counted(100.0), pytest.raises(ValueError, match="no moves"):
        up_to(0.5, failing, "given up")
