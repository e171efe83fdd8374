"""Parts of the moves of a recording: the beginning of each, a few of them, or all without what their motors say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from service.backlash.moves import Moves


def early_part(moves: Moves, share: float) -> Moves:
    """The same moves cut off after the first `share` of each."""
    ends = [move.start + share * move.duration for move in moves.made]
    K = max(int(np.sum(grid.time[1:] <= end)) for grid, end in zip(moves.grids, ends, strict=True))
    grids = tuple(
        replace(grid, measured=grid.measured[:, :K], used=(grid.used & (grid.time[1:] <= end))[:, :K])
        for grid, end in zip(moves.grids, ends, strict=True)
    )
    return replace(
        moves,
        grids=grids,
        expected=moves.expected[..., :K],
        force_off=None if moves.force_off is None else moves.force_off[..., : K + 1],
        judged=None if moves.judged is None else moves.judged[..., :K],
        echoes=(),
        reference=None,
        wander=None,
        white=False,
        motors=(),
    )


def few_of(moves: Moves, count: int) -> slice:
    """Which moves `some_of` keeps."""
    return slice(1, 1 + count) if len(moves.grids) > count else slice(None)


def some_of(moves: Moves, count: int) -> Moves:
    """The first few moves after the first one, in which the pinion may rest anywhere."""
    return _kept(moves, few_of(moves, count))


def first_of(moves: Moves) -> Moves:
    """The first move alone."""
    return _kept(moves, slice(0, 1))


def _kept(moves: Moves, kept: slice) -> Moves:
    return replace(
        moves,
        grids=moves.grids[kept],
        motion=moves.motion[kept],
        bias=moves.bias[kept],
        expected=moves.expected[kept],
        force_off=None if moves.force_off is None else moves.force_off[:, kept],
        judged=None if moves.judged is None else moves.judged[kept],
        echoes=moves.echoes[kept],
        reference=None if moves.reference is None else moves.reference[kept],
        swings=None if moves.swings is None else moves.swings.of(kept),
        heard={name: value[kept] for name, value in moves.heard.items()},
        wander=None,
        white=False,
        motors=moves.motors[kept],
    )


def unasked(moves: Moves) -> Moves:
    """The moves without what their motors say."""
    return replace(moves, motors=()) if moves.motors else moves
