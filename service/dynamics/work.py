"""How much is simulated of a search, and how far it may go.

Where a library does not hold what is missing, a search for it has no natural end. What it may take is counted in what
is simulated, not in time: a recording is explained alike on every machine, and every time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

T = TypeVar("T")


class Spent(Exception):
    """What an attempt may take is used up."""


@dataclass
class Work:
    """What has been simulated, what may be at present, and how many attempts were given up for that."""

    whole: float
    done: float = 0.0
    limit: float = np.inf
    given_up: int = 0


_WORK: ContextVar[Work | None] = ContextVar("work", default=None)


@contextmanager
def counted(whole: float) -> Iterator[Work]:
    """Counts what is simulated within, and limits its attempts to shares of this `whole`."""
    work = Work(whole)
    token = _WORK.set(work)
    try:
        yield work
    finally:
        _WORK.reset(token)


def count(amount: float) -> None:
    """Counts what is simulated next; raises `Spent` where it is beyond the present limit."""
    work = _WORK.get()
    if work is None:
        return
    if work.done > work.limit:
        raise Spent
    work.done += amount


def up_to(share: float, attempt: Callable[[], T], otherwise: T) -> T:
    """What an attempt returns, or `otherwise` where it is given up: where all that is simulated is such a share of the
    whole, or as much as an attempt may take within which it is made. Without a count it may take what it takes."""
    work = _WORK.get()
    if work is None:
        return attempt()
    outer = work.limit
    work.limit = min(outer, share * work.whole)
    try:
        return attempt()
    except Spent:
        work.given_up += 1
        return otherwise
    finally:
        work.limit = outer


def given_up() -> int:
    """How many attempts were given up so far."""
    work = _WORK.get()
    return work.given_up if work else 0
