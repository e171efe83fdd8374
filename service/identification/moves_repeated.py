"""What repeated moves say of a model without being asked for any: the pure error of observations that are alike.

What a machine lacks in its model, whether of friction, of flanks or of a sensor, follows the motion of its motor: moves
of one set-point from one place leave the same residual, however wrong the model. What differs between them comes from
elsewhere: a clock that jitters, a mount that works loose, a machine next to it, a load that was changed. No effect of
motion explains more than what repeats (the lack-of-fit test by replicates; Draper and Smith, Applied Regression
Analysis, 3rd ed. 1998, ch. 2).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from service.backlash.alike_moves import ALIKE, alike, groups
from service.backlash.moves import Moves
from service.backlash.moves_fit import Fitted
from service.backlash.moves_predicted import predict
from service.identification.selection import LEFT, PART, gone
from service.recording import FloatArray

AT_ONCE = 2e-3
"""By how much [s] the times differ between the beginnings of two moves that are as long apart (chosen: a drive's cycle;
what swings on from move to move does so at some ten hertz)."""


class PureError(NamedTuple):
    """RMS, over what is expected, of the residuals of moves that are alike: of all, and about the mean of their group;
    none where no moves are."""

    together: float
    apart: float

    @property
    def beyond_any_effect(self) -> bool:
        """Whether more of it differs from move to move than what effects may leave, and so large a part of what is
        missing that no effect of motion explains enough of the rest."""
        return self.apart > LEFT and not gone(self.together, self.apart, PART)


def pure_error(found: Fitted) -> PureError:
    """How a fit's residuals in its moves differ between those that are alike in all recordings; where what differs dies
    away from move to move, as a swing does that some of them leave to the next, between the last two."""
    squares, apart, count, free = 0.0, 0.0, 0, 0
    laid = list[FloatArray]()
    for moves, own in zip(found.moves, found.at.local, strict=True):
        said = predict(moves, found.model, found.at.shared[None], own[None]).acceleration()[0]
        over = (moves.measured - said) / moves.noise[:, None] / moves.expected
        laid += [
            laid_over(moves, over[:, axis], group, axis)
            for group in repeated(moves)
            for axis in range(len(moves.axes))
        ]
    if all(map(settles, laid)):
        laid = [of_group[-2:] for of_group in laid]
    for of_group in laid:
        squares += float(np.sum(of_group**2))
        apart += float(np.sum((of_group - of_group.mean(axis=0)) ** 2))
        count += of_group.size
        free += of_group.size - of_group.shape[1]
    return PureError(np.sqrt(squares / max(count, 1)), np.sqrt(apart / max(free, 1)))


def settles(of_group: FloatArray) -> bool:
    """Whether moves (moves, times) differ less and less from the one before: what swings on through several of them,
    from when the first of a recording was made, dies away."""
    steps = np.sqrt(np.mean(np.diff(of_group, axis=0) ** 2, axis=1))
    return len(steps) > 1 and bool(np.all(steps[1:] < steps[:-1]))


def repeated(moves: Moves) -> Iterator[list[int]]:
    """Two and more moves of one set-point that begin at one place, as long after a move that was alike, too: what that
    left to swing on is alike; as the last of them, for the first may still come from elsewhere. The first of a
    recording is none of them."""
    place = np.stack([course(moves.start) for course in moves.plain], axis=1)
    made = moves.made
    pause = np.diff([move.start for move in made], prepend=np.nan)

    def as_made(k: int, last: int) -> bool:
        there = np.max(np.abs(place[k] - place[last])) <= ALIKE * made[k].length
        then = abs(pause[k] - pause[last]) <= AT_ONCE and alike(made[k - 1], made[last - 1])
        return bool(there and then and np.all(np.sum(moves.used[k], axis=1) > 1))

    for group in groups(made):
        same = [k for k in group if k > 0 and as_made(k, group[-1])]
        if len(same) > 1:
            yield same


def laid_over(moves: Moves, over: FloatArray, group: list[int], axis: int) -> FloatArray:
    """The residuals (T, K) of a group of moves at the same times of each after it was begun: (moves, times)."""
    used = [moves.used[k, axis] for k in group]
    since = [moves.grids[k].time[:-1][u] - moves.made[k].start for k, u in zip(group, used, strict=True)]
    begin, end = max(times[0] for times in since), min(times[-1] for times in since)
    period = float(np.median(np.diff(since[0])))
    at = np.arange(begin, end, period)
    return np.stack(
        [np.interp(at, times, over[k][u]) for k, times, u in zip(group, since, used, strict=True)]
    )
