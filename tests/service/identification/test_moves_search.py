"""Where candidates are started."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from service.dynamics.driven_model import Model
from service.identification import moves_search
from service.identification.moves_search import alike, softer_contact


def test_shaft_and_contact_are_exchanged_only_where_the_contact_is_the_stiffer() -> None:
    model = Model(("X1",), 2)
    stiff = {"X1.pinion_stiffness": 7e5, "X1.contact_stiffness": 2e6, "X1.coulomb": 0.3}
    soft = {"X1.pinion_stiffness": 2e6, "X1.contact_stiffness": 7e5, "X1.coulomb": 0.3}
    assert softer_contact(stiff, model) == soft
    assert softer_contact(soft, model) is None


def test_every_move_begins_like_the_best_described_one_of_its_direction(monkeypatch: Any) -> None:
    monkeypatch.setattr(moves_search, "costs_of_moves", lambda *_: np.array([9.0, 2.0, 1.0, 5.0]))
    few = SimpleNamespace(s=np.array([-1.0, 1.0, -1.0, 1.0]))
    local = np.array([[0.1], [0.2], [0.3], [0.4]])
    found = SimpleNamespace(moves=(few,), at=SimpleNamespace(local=(local,)))
    every = SimpleNamespace(s=np.array([1.0, -1.0, 1.0]))
    (own,) = alike(cast(Any, (every,)), cast(Any, found))
    assert own[:, 0].tolist() == [0.2, 0.3, 0.2]
