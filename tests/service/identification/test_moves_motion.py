"""The motion that the motors' moves are given by a fit."""

from __future__ import annotations

import numpy as np

from service.backlash.moves_fit import Fitted
from service.backlash.moves_refined import reconstructed
from service.recording import FloatArray


def test_moves_that_were_made_alike_have_one_motion(found: Fitted) -> None:
    """And only these: the first of a recording has its own."""
    (moves,) = reconstructed(found)
    assert sum(map(len, moves.alike)) >= 6

    def speed(k: int) -> FloatArray:
        return np.asarray(moves.motion[k][0](np.linspace(0.0, 0.08, 50) + moves.recording.moves[k].start, 1))

    for group in moves.alike:
        for k in group:
            np.testing.assert_allclose(speed(k), speed(group[0]), atol=1e-9)
    first = next(group for group in moves.alike if moves.s[group[0]] == moves.s[0])
    assert np.max(np.abs(speed(0) - speed(first[0]))) > 1e-6
