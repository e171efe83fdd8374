"""The fit's nuisance: a mesh error against its own derivatives, a bent flank against its law at rest."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial.legendre import legval

from service.backlash.model_fit_impurities import BentContact, MeshError
from service.dynamics.driven import simulate
from service.dynamics.driven_effect import Case
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_transmission import TYPICAL_PUSH
from service.recording import FloatArray

H = 2.5e-4


def values(model: Model, **given: float) -> dict[str, FloatArray]:
    """One parameter set, typical but for what is given."""
    named = {p.name: p.typical for p in model.parameters} | {f"X1.{k}": v for k, v in given.items()}
    return {name: np.array([value]) for name, value in named.items()}


def pulled(a: float, K: int) -> FloatArray:
    """A motor at constant acceleration from rest, (1, 1, K, 1, 5)."""
    t = H * np.arange(K)
    zero = np.zeros(K)
    return np.stack((0.5 * a * t**2, a * t, zero + a, zero, zero), axis=-1)[None, None, :, None]


def depth_in_balance(a: float, bend: float) -> float:
    """How deep the flanks are pressed [m] under a lasting acceleration."""
    model = Model(("X1",), 1, effects=(BentContact(("X1",)),))
    given = values(model, bend=bend, coulomb=1e-9, viscous=1e-9, contact_damping_ratio=0.3)
    half, k = 0.5 * float(given["X1.backlash"][0]), float(given["X1.contact_stiffness"][0])
    load = np.array([[[[-half - a / k, 0.0]]]])
    answer = simulate(model, given, pulled(a, 2000), np.ones(1), load, H)
    return float(np.mean(answer.relative[0, 0, 0, -200:])) - half


@pytest.mark.parametrize("bend", [-0.1, 0.0, 0.1])
@pytest.mark.parametrize("a", [2.0, 8.0])
def test_a_bent_flank_is_as_deep_as_its_law_says(a: float, bend: float) -> None:
    typical = TYPICAL_PUSH / 4e5
    wanted = typical * (a / TYPICAL_PUSH) ** (1.0 / (1.0 + bend))
    assert depth_in_balance(a, bend) == pytest.approx(wanted, rel=5e-3)


def test_a_mesh_error_moves_by_what_it_is_along_the_stroke() -> None:
    """Its speed and acceleration are the derivatives of its position, which is the polynomials' sum; where one interval
    ends they are what the next one begins with."""
    mesh = MeshError(("X1",), 0.0, 4e-3)
    sizes = [2e-6, -1e-6, 0.5e-6, 0.3e-6, -0.2e-6]
    model = Model(("X1",), 1, effects=(mesh,))
    given = values(model, **{f"mesh_{k}": size for k, size in enumerate(sizes, 1)})
    c = pulled(3.0, 180)
    case = Case(model, given, np.zeros((1, 1, 0)), np.ones(1), np.zeros(1), H)
    error = (mesh.drive(c, case) - c)[0, 0, :, 0]
    x = c[0, 0, :, 0, 0]
    wanted = legval(x / 2e-3 - 1.0, np.append(0.0, sizes))
    assert error[:, 0] == pytest.approx(wanted, abs=1e-12)
    assert error[1:-1, 1] == pytest.approx(np.gradient(wanted, H)[1:-1], abs=1e-3 * np.ptp(error[:, 1]))
    assert error[2:-2, 2] == pytest.approx(
        np.gradient(np.gradient(wanted, H), H)[2:-2], abs=1e-2 * np.ptp(error[:, 2])
    )
    _, v, a, third, fourth = error.T
    assert (v + H * (a + H / 2.0 * (third + H / 3.0 * fourth)))[:-1] == pytest.approx(v[1:], abs=1e-12)
    assert (a + H * (third + H / 2.0 * fourth))[:-1] == pytest.approx(a[1:], abs=1e-9)


def test_nothing_of_either_changes_nothing() -> None:
    pure, impure = (
        Model(("X1",), 2, effects=effects)
        for effects in ((), (MeshError(("X1",), 0.0, 4e-3), BentContact(("X1",))))
    )
    load = np.array([[[[-3e-5, 0.0]]]])
    first, second = (
        simulate(model, values(model), pulled(3.0, 100), np.ones(1), load, H).acceleration
        for model in (pure, impure)
    )
    assert second == pytest.approx(first, abs=1e-9)


def test_what_a_bent_flank_answers_does_not_hang_on_the_grid() -> None:
    """A load that swings free and meets the flank between two grid points, on a grid and on one ten times finer."""
    model = Model(("X1",), 2, effects=(BentContact(("X1",)),))
    given = values(model, bend=0.1)
    load = np.array([[[[0.0, -8e-3]]]])
    coarse = simulate(model, given, still(60), np.ones(1), load, H).acceleration[0, 0, 0]
    fine = simulate(model, given, still(600), np.ones(1), load, 0.1 * H).acceleration[0, 0, 0]
    assert np.max(np.abs(coarse)) > 1.0
    assert coarse == pytest.approx(fine.reshape(60, 10).mean(axis=1), abs=1e-6)


def still(K: int) -> FloatArray:
    """A motor at rest, (1, 1, K, 1, 5)."""
    return np.zeros((1, 1, K, 1, 5))
