"""What repeated moves tell of what is missing: whether it follows the motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from service.backlash.moves import Moves
from service.backlash.moves_fit import Fitted
from service.backlash.moves_predicted import predict
from service.identification.moves_repeated import PureError, pure_error, repeated
from service.recording import FloatArray


def leaving(found: Fitted, over: FloatArray) -> Fitted:
    """The fit with moves of which it leaves such residuals (T, K), over what is expected."""
    (moves,), at = found.moves, found.at
    said = predict(moves, found.model, at.shared[None], at.local[0][None]).acceleration()[0]
    felt = said + over[:, None] * moves.noise[:, None] * moves.expected
    grids = [replace(g, measured=np.where(g.used, f, np.nan)) for g, f in zip(moves.grids, felt, strict=True)]
    return replace(found, moves=(replace(moves, grids=tuple(grids)),))


def test_what_repeats_in_alike_moves_is_no_pure_error(found: Fitted) -> None:
    """A half sine through every move, against its direction in half of them: alike in all moves of one direction."""
    (moves,) = found.moves
    course = 5.0 * np.sin(np.pi * np.arange(moves.samples) / moves.samples)
    alike = pure_error(leaving(found, np.where(moves.s > 0, 1.0, -0.3)[:, None] * course))
    assert alike.together > 2.0
    assert alike.apart < 0.05 * alike.together, "times within a sample of one another"
    assert not alike.beyond_any_effect


def test_what_differs_between_alike_moves_is_pure_error(found: Fitted) -> None:
    """Four moves of each direction, all but the first pair, of one constant each; their variance about their mean, with
    one degree of freedom less than there are moves."""
    (moves,) = found.moves
    groups = list(repeated(moves))
    size = np.zeros(len(moves.grids))
    for group in groups:
        size[group] = np.linspace(-3.0, 3.0, len(group))
    alike = pure_error(leaving(found, np.repeat(size[:, None], moves.samples, axis=1)))
    of_all = np.concatenate([size[group] for group in groups])
    apart = np.sum(of_all**2) / sum(len(group) - 1 for group in groups)
    assert alike.together == pytest.approx(np.sqrt(np.mean(of_all**2)), rel=0.01)
    assert alike.apart == pytest.approx(np.sqrt(apart), rel=0.01)
    assert alike.beyond_any_effect


@pytest.mark.parametrize(("kept", "beyond"), [(0.7, False), (1.0 / 0.7, True)], ids=["dies away", "grows"])
def test_what_swings_on_through_several_moves_is_no_pure_error(
    found: Fitted, kept: float, beyond: bool
) -> None:
    """A body that rings at 8 Hz, of a hundredth of critical damping, had left half of its swing when a move was made
    the second time: of a residual that repeats, 17 of 22 differed from move to move, and nothing was searched."""
    (moves,) = found.moves
    k, phase = np.arange(len(moves.grids)), 2.0 * np.pi * np.arange(moves.samples) / moves.samples
    repeats = 10.0 * np.sin(0.5 * phase)
    left = 30.0 * kept ** (k if kept < 1.0 else k - k[-1])
    alike = pure_error(leaving(found, repeats + left[:, None] * np.cos(phase)))
    assert alike.beyond_any_effect == beyond


def test_of_noise_alone_the_pure_error_is_what_is_expected(found: Fitted) -> None:
    """A little less: a residual between two samples is their mean."""
    (moves,) = found.moves
    noise = np.random.default_rng(7).standard_normal((len(moves.grids), moves.samples))
    alike = pure_error(leaving(found, noise))
    assert 0.7 < alike.apart < 1.05
    assert not alike.beyond_any_effect


@pytest.mark.parametrize(
    ("together", "apart", "beyond"),
    [(20.0, 19.0, True), (20.0, 10.0, False), (2.0, 1.7, True), (1.5, 1.5, False), (3.0, 2.0, False)],
)
def test_only_more_than_effects_leave_and_the_larger_part_is_beyond_them(
    together: float, apart: float, beyond: bool
) -> None:
    assert PureError(together, apart).beyond_any_effect == beyond


def elsewhere(moves: Moves, k: int) -> Moves:
    """The move began a fifth of its length further on."""
    at, (plain,) = moves.recording.moves[moves.grids[k].index], moves.plain
    edges = np.array([0.0, at.start - 0.01, at.start + 0.01, plain.x[-1] + 1.0])
    return replace(moves, plain=(PPoly(np.array([[0.0, 0.2 * at.length, 0.0]]), edges),))


def later(moves: Moves, k: int) -> Moves:
    """The move began 5 ms later after the one before."""
    index = moves.grids[k].index
    made = list(moves.recording.moves)
    made[index] = replace(made[index], start=made[index].start + 5e-3)
    return replace(moves, recording=replace(moves.recording, moves=tuple(made)))


def longer(moves: Moves, k: int) -> Moves:
    """The move was a tenth longer."""
    index = moves.grids[k].index
    made = list(moves.recording.moves)
    made[index] = replace(made[index], length=1.1 * made[index].length)
    return replace(moves, recording=replace(moves.recording, moves=tuple(made)))


@pytest.mark.parametrize("otherwise", [elsewhere, later, longer])
def test_only_moves_made_alike_are_compared(found: Fitted, otherwise: Callable[[Moves, int], Moves]) -> None:
    (moves,) = found.moves
    still = replace(moves, plain=(PPoly(np.zeros((1, 1)), np.array([0.0, moves.plain[0].x[-1]])),))
    k = len(moves.grids) - 2
    assert any(k in group for group in repeated(still))
    assert not any(k in group for group in repeated(otherwise(still, k)))


def test_the_first_move_is_like_none(found: Fitted) -> None:
    """Nothing was before it that may have begun to swing."""
    groups = list(repeated(found.moves[0]))
    assert groups
    assert not any(0 in group for group in groups)
