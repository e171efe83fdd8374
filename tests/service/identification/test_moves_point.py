"""Which coordinates a fit of moves has, and how far they go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from service.backlash.moves_begun import shared_at
from service.backlash.moves_fit import Fitted, fit
from service.backlash.moves_point import Point, every, found_again, limits, stopped, within
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_guide import DrivenConstantForce, DrivenStribeckFriction
from service.dynamics.effects.driven_library import DRIVEN


def test_no_fit_leaves_the_values_that_its_numbers_have(found: Fitted) -> None:
    k = [p.name for p in found.model.parameters].index("X1.smear")
    shared = found.at.shared.copy()
    shared[k] = -3.0
    begun = Point(shared, found.at.local)
    assert within(found.model, begun).shared[k] == limits(found.model)[k, 0] == 0.0
    fitted = fit(found.moves, found.model, begun, 4)
    assert fitted.at.shared[k] >= 0.0
    gradient = np.zeros(len(shared) + 1)
    gradient[k] = 1.0
    free = every(found.model)
    assert stopped(found.model, within(found.model, begun), free, gradient)[k]
    assert not stopped(found.model, within(found.model, begun), free, -gradient)[k]


def test_only_zeros_are_found_again() -> None:
    model = Model(
        ("X1",), 2, tuple(kind(("X1",)) for kind in DRIVEN.values() if kind.name != "gantry_coupling")
    )
    names = {model.parameters[k].name for k in found_again(model)}
    assert names == {"X1.ripple_phase"}
    assert len(every(model)) == len(model.parameters)


def test_an_amount_has_no_limit_that_a_machine_may_reach(found: Fitted) -> None:
    """Five metres per second squared of breakaway, or a vertical axis' weight; a chain stays within its prior."""
    for kind, name, value in (
        (DrivenStribeckFriction, "breakaway", 5.0),
        (DrivenConstantForce, "constant_force", 9.81),
    ):
        effect = kind(("X1",))
        model = replace(found.model, effects=(*found.model.effects, effect))
        shared = shared_at(model, {f"X1.{name}": value, "X1.gear_mass": 1e6})
        numbers = model.numbers(within(model, Point(shared, ())).shared)
        assert numbers[f"X1.{name}"] == pytest.approx(value)
        gear = next(p for p in model.parameters if p.name == "X1.gear_mass")
        assert numbers["X1.gear_mass"] == pytest.approx(float(gear.value(5.0)))
