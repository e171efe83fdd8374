"""The parameters of a model all at once, against each by itself."""

from __future__ import annotations

import numpy as np
import pytest

from service.dynamics.driven_model import Model
from service.dynamics.driven_parameters import Parameter, Scales
from service.dynamics.effects.driven_library import DRIVEN


@pytest.mark.filterwarnings("error")
def test_all_values_of_a_model_are_those_of_its_parameters() -> None:
    effects = tuple(kind(("X1",)) for name, kind in DRIVEN.items() if name != "gantry_coupling")
    model = Model(("X1",), 2, effects, "whole_move", ("constant",))
    shared = np.random.default_rng(5).normal(0.0, 3.0, (4, len(model.parameters)))
    values = model.values(shared)
    assert list(values) == [p.name for p in model.parameters]
    for k, p in enumerate(model.parameters):
        np.testing.assert_allclose(values[p.name], p.value(shared[:, k]), rtol=1e-14, err_msg=p.name)


@pytest.mark.filterwarnings("error")
def test_a_coordinate_ends_where_its_value_does() -> None:
    parameters = (
        Parameter("grows", "1", 2.0, 0.5, high=8.0),
        Parameter("grows_between", "1", 2.0, 0.5, low=1.0, high=4.0),
        Parameter("moves", "m", 0.0, 1e-4, logarithmic=False, low=0.0, high=3e-4),
        Parameter("moves_anywhere", "m", 1.0, 0.1, logarithmic=False),
    )
    ends = Scales.of(parameters).ends
    ratio = np.log(2.0) / 0.5
    np.testing.assert_allclose(ends, [(-np.inf, 2 * ratio), (-ratio, ratio), (0.0, 3.0), (-np.inf, np.inf)])
    beyond = Scales.of(parameters).values(np.array([[9.0, -9.0, 9.0, 9.0]]))
    np.testing.assert_allclose(beyond, [[8.0, 1.0, 3e-4, 1.9]])
