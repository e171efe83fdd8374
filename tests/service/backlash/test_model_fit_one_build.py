"""Starts with other drives than the search found: both of one build, or typical ones."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.backlash.model_fit_gantry import SAME, alike, apart
from service.backlash.model_fit_one_build import SOFT, WAYS, of_one_build, other_drives, with_typical_drives
from service.dynamics.driven_model import Model
from service.recording import FloatArray

AXES = ("X1", "X2")


def named(model: Model, shared: FloatArray) -> dict[str, float]:
    return dict(zip((p.name for p in model.parameters), shared.tolist(), strict=True))


def in_units(model: Model, shared: FloatArray) -> dict[str, float]:
    return {p.name: float(p.value(u)) for p, u in zip(model.parameters, shared, strict=True)}


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


@pytest.mark.parametrize("soft", SOFT)
def test_a_typical_drive_has_its_share_of_the_softness_and_the_axis_is_as_soft_as_before(soft: float) -> None:
    model = Model(AXES, 1)
    shared = np.random.default_rng(5).standard_normal(len(model.parameters))
    changed = with_typical_drives(model, shared, soft)
    before, after = in_units(model, shared), in_units(model, changed)
    for axis in AXES:
        compliance = sum(1.0 / before[f"{axis}.{link}_stiffness"] for link in ("drive", "contact"))
        assert 1.0 / after[f"{axis}.drive_stiffness"] == pytest.approx(soft * compliance)
        assert 1.0 / after[f"{axis}.contact_stiffness"] == pytest.approx((1.0 - soft) * compliance)
        typical = in_units(model, np.zeros(len(shared)))
        for name in ("drive_mass", "drive_damping_ratio", "contact_damping_ratio"):
            assert after[f"{axis}.{name}"] == typical[f"{axis}.{name}"]
    drives = ("stiffness", "damping_ratio", "mass")
    assert all(before[name] == after[name] for name in before if not name.endswith(drives))


def test_other_drives_are_all_different_and_leave_gaps_friction_and_bridge() -> None:
    model = Model(AXES, 1)
    shared = np.random.default_rng(7).standard_normal(len(model.parameters))
    tried = other_drives(model, shared)
    assert len({tuple(np.round(chain, 9)) for chain in (shared, *tried)}) == len(tried) + 1
    numbers = ("stiffness", "damping_ratio", "mass")
    drives = [p.name.startswith(AXES) and p.name.endswith(numbers) for p in model.parameters]
    kept = [not own and p.name != "mass_ratio" for own, p in zip(drives, model.parameters, strict=True)]
    assert all(np.array_equal(chain[kept], shared[kept]) for chain in tried)


@pytest.mark.parametrize("misfit", [1.0, 2.9, 1e16])
def test_none_is_tried_where_one_is_near_or_nothing_can_be_simulated(misfit: float) -> None:
    end = cast(Any, SimpleNamespace(fit=SimpleNamespace(misfit=misfit, cost=misfit)))
    assert alike(*cast(Any, (None, [end], (6,), None))) == []


def test_starts_that_ended_alike_count_once() -> None:
    costs = [100.0, 100.0 * SAME, 150.0, 150.1, 400.0]
    starts = [cast(Any, SimpleNamespace(fit=SimpleNamespace(cost=cost))) for cost in costs]
    assert apart(starts) == [starts[0], starts[2], starts[4]]
