"""What of the moves a fit of a part of them may see."""

from __future__ import annotations

from service.backlash.moves import moves_of
from service.backlash.moves_parts import early_part
from service.recording import Recording


def test_the_early_part_is_early(captures: tuple[Recording, Recording]) -> None:
    moves = moves_of(captures[0], ("X1",))
    part = early_part(moves, 0.45)
    for grid in part.grids:
        move = captures[0].moves[grid.index]
        assert grid.time[1:][grid.used[0]].max() <= move.start + 0.45 * move.duration
