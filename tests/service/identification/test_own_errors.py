"""What is expected of a model that undoes a filter on the drive's speed, and sharpens that speed's noise with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.backlash.moves import Moves, moves_of
from service.backlash.moves_begun import expecting_its_own, point_at
from service.backlash.moves_fit import Fitted, fit
from service.backlash.moves_parts import early_part, some_of
from service.captures import read_capture
from service.dynamics.driven_model import DrivenEffect, Model
from service.dynamics.effects.driven_sensors import DrivenLatency, DrivenSpeedFilter
from service.identification.held_out import judged_rms
from service.identification.moves_end import with_errors_of_added, with_own_errors


@pytest.fixture(scope="module")
def moves(request: pytest.FixtureRequest) -> Moves:
    shared: Path = request.getfixturevalue("shared_dir")
    return moves_of(read_capture(shared / "captures" / "none-train.parquet"), ("X1",))


def fitted(moves: Moves, effect: DrivenEffect, **values: float) -> Fitted:
    """The model at typical values and these, not fitted."""
    model = Model(("X1",), 1, (effect,), "whole_move", ("constant", "skew"), bridge=False)
    at = point_at(model, {f"X1.{name}": value for name, value in values.items()}, [moves])
    return fit([moves], model, at, 0)


def test_a_filter_that_is_undone_is_expected_to_miss_more_the_slower_it_is(moves: Moves) -> None:
    """Noise n becomes n + τ·ṅ."""

    def excess(tau: float) -> float:
        found = fitted(moves, DrivenSpeedFilter(("X1",)), filter_time=tau)
        return float(np.mean(expecting_its_own(found)[0].expected[moves.used] ** 2))

    assert excess(0.0) < excess(2e-3) < excess(4e-3)


def test_a_delay_sharpens_nothing(moves: Moves) -> None:
    found = fitted(moves, DrivenLatency(("X1",)), latency=-2e-3)
    assert with_own_errors(found) is found


def test_a_filter_lags_by_its_time_and_beside_a_latency_by_none() -> None:
    """Of both together nothing tells which is which, and the force's jumps would be smoothed by a number at random."""
    values = {"X1.filter_time": 1e-3, "Y1.filter_time": 2e-3, "X1.latency": 1e-3, "Y1.latency": 0.0}
    axes = ("X1", "Y1")
    of_filter, of_latency = DrivenSpeedFilter(axes), DrivenLatency(axes)
    assert Model(axes, 1, (of_filter,)).lags(values) == (1e-3, 2e-3)
    assert Model(axes, 1, (of_latency,)).lags(values) == (0.0, 0.0)
    assert Model(axes, 1, (of_latency, of_filter)).lags(values) == (0.0, 0.0)


def test_a_model_with_an_added_effect_expects_what_its_own_machine_misses(moves: Moves) -> None:
    """Once more wherever it stands; the declared one keeps what all are compared by."""
    scene = cast(Any, SimpleNamespace(declared=fitted(moves, DrivenLatency(("X1",))).model))
    declared = fitted(moves, DrivenLatency(("X1",)))
    assert with_errors_of_added(scene, declared) is declared
    both = replace(scene.declared, effects=(*scene.declared.effects, DrivenSpeedFilter(("X1",))))
    at = point_at(both, {"X1.filter_time": 2e-3}, [moves])
    ended = with_errors_of_added(scene, fit([moves], both, at, 0))
    (part,) = ended.moves
    assert part.judged is moves.expected
    assert np.mean(part.expected[part.used] ** 2) > 1.0
    (again,) = with_errors_of_added(scene, ended).moves
    assert again.judged is moves.expected


def test_models_are_compared_by_what_was_expected_before(moves: Moves) -> None:
    """Else one that expects to miss everything would explain everything."""
    found = fitted(moves, DrivenSpeedFilter(("X1",)), filter_time=4e-3)
    sharpened = with_own_errors(found)
    assert with_own_errors(sharpened) is sharpened, "once"
    (part,) = sharpened.moves
    assert part.judged is moves.expected
    over_noise = sharpened.r * part.expected[part.used]
    assert judged_rms(sharpened) == pytest.approx(float(np.sqrt(np.mean(over_noise**2))))
    assert judged_rms(sharpened) > sharpened.rms
    assert judged_rms(found) == found.rms
    for fewer in (some_of(part, 4), early_part(part, 0.45)):
        assert fewer.judged is not None
        assert fewer.judged.shape == fewer.expected.shape
