"""Starts in which both drives of a gantry are of one build."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.backlash.model_fit_gantry import alike
from service.backlash.model_fit_one_build import WAYS, of_one_build
from service.dynamics.driven_model import Model
from service.recording import FloatArray

AXES = ("X1", "X2")


def named(model: Model, shared: FloatArray) -> dict[str, float]:
    return dict(zip((p.name for p in model.parameters), shared.tolist(), strict=True))


@pytest.mark.parametrize("lumps", [1, 2])
@pytest.mark.parametrize("way", WAYS)
def test_both_drives_are_the_same_and_what_is_each_sides_own_stays(
    lumps: int, way: tuple[float, float]
) -> None:
    model = Model(AXES, lumps)
    shared = np.random.default_rng(3).standard_normal(len(model.parameters))
    before, after = named(model, shared), named(model, of_one_build(model, shared, way))
    mass = "drive_mass" if lumps == 1 else "gear_mass"
    for name in ("contact_stiffness", "contact_damping_ratio", mass):
        expected = way[0] * before[f"X1.{name}"] + way[1] * before[f"X2.{name}"]
        assert after[f"X1.{name}"] == after[f"X2.{name}"] == pytest.approx(expected)
    assert after["mass_ratio"] == 0.0, "one mass on either side"
    own = ("backlash", "coulomb", "viscous", "constant", "skew")
    for name in ("bridge_stiffness", "bridge_offset", *(f"{axis}.{n}" for axis in AXES for n in own)):
        assert after[name] == before[name]


@pytest.mark.parametrize("misfit", [1.0, 2.9, 1e16])
def test_none_is_tried_where_one_is_near_or_nothing_can_be_simulated(misfit: float) -> None:
    end = cast(Any, SimpleNamespace(fit=SimpleNamespace(misfit=misfit, cost=misfit)))
    assert alike(*cast(Any, (None, [end], (6,), None))) == []
