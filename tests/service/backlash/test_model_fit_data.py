"""What of a recording the fit compares: as much of every step as its motors make of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PPoly

from service.backlash.model_fit_data import END_FRACTION, LATEST, ending
from service.recording import AxisDescription, Move, Recording

T = 0.09
MOVES = (Move(0.3, 1, 4e-3, 200.0, T), Move(0.3 + 4 * T, -1, 4e-3, 200.0, T))
RECORDING = Recording("drawn", (AxisDescription("X1", 0.003),), {}, MOVES, ())


def late(delay: float, longer: float = 1.0) -> PPoly:
    """A motor's position whose steps come `delay` durations late and last `longer` times as long."""
    t = np.arange(0.0, 1.2, 1e-4)
    v = np.zeros_like(t)
    for move in MOVES:
        share = np.clip(((t - move.start) / T - delay) / longer, 0.0, 1.0)
        v += move.direction * np.sin(np.pi * share) ** 2
    return CubicSpline(t, v).antiderivative()


def test_a_motor_that_follows_is_looked_at_as_long_as_it_is_commanded() -> None:
    assert ending(RECORDING, 0, [late(0.0)]) == END_FRACTION


@pytest.mark.parametrize("index", [0, 1])
def test_a_motor_that_lags_is_looked_at_until_it_hardly_moves(index: int) -> None:
    # sin² falls to 0.15 at a share of 0.873
    assert ending(RECORDING, index, [late(0.0), late(0.2, 1.3)]) == pytest.approx(0.2 + 1.3 * 0.873, abs=0.02)


def test_the_next_move_is_no_part_of_this_one() -> None:
    assert ending(RECORDING, 0, [late(0.9, 3.0)]) <= LATEST
