"""Other sharings of a drive, what they keep of it; and what is not fitted to all steps."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.backlash import model_fit_stages
from service.backlash.model_fit_stages import SHARINGS, Effort, refined, shared_out
from service.dynamics.driven_model import Model
from service.recording import FloatArray

LINKS = ("gear", "pinion", "contact")


def laws(model: Model, shared: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Stiffness and damping of each link, mass of each lump."""
    value = {p.name: float(p.value(u)) for p, u in zip(model.parameters, shared, strict=True)}
    k = np.array([value[f"X1.{link}_stiffness"] for link in LINKS])
    d = 2.0 * np.array([value[f"X1.{link}_damping_ratio"] for link in LINKS]) * np.sqrt(k)
    return k, d, np.array([value[f"X1.{link}_mass"] for link in LINKS[:-1]])


@pytest.mark.parametrize("way", SHARINGS)
def test_a_drive_shared_out_differently_is_as_soft_as_heavy_and_as_damped(way: Any) -> None:
    """In series and slowly pressed: compliance Σ 1/k, and Σ d/k² of what is lost in it."""
    model = Model(("X1",), 2)
    given = np.random.default_rng(3).normal(0.0, 0.7, len(model.parameters))
    k, d, mass = laws(model, given)
    other = shared_out(model, given, *way)
    k_new, d_new, mass_new = laws(model, other)
    assert np.sum(1.0 / k_new) == pytest.approx(np.sum(1.0 / k))
    assert np.sum(d_new / k_new**2) == pytest.approx(np.sum(d / k**2))
    assert np.sum(mass_new) == pytest.approx(np.sum(mass))
    soft, heavy = way
    assert (1.0 / k_new) / np.sum(1.0 / k_new) == pytest.approx(soft)
    assert mass_new / np.sum(mass_new) == pytest.approx(heavy)
    assert np.ptp(d_new / k_new) == pytest.approx(0.0, abs=1e-9 * np.max(d_new / k_new))


@pytest.mark.parametrize(("misfit", "all_steps"), [(15.0, True), (17.0, False)])
def test_what_few_steps_show_to_be_another_machine_is_not_fitted_to_all(
    monkeypatch: pytest.MonkeyPatch, misfit: float, all_steps: bool
) -> None:
    at = SimpleNamespace(shared=np.zeros(1), local=np.zeros((1, 1, 1)))
    begin = cast(Any, SimpleNamespace(problem=None, fit=SimpleNamespace(misfit=misfit, point=at)))
    last = cast(Any, SimpleNamespace(fit=SimpleNamespace(misfit=1.0, cost=1.0)))
    monkeypatch.setattr(
        model_fit_stages, "with_impurities", lambda problem, point, fine=False: (problem, point)
    )
    monkeypatch.setattr(model_fit_stages, "differently_shared", lambda *_: begin)
    monkeypatch.setattr(model_fit_stages, "repeated", lambda *_: at.local)
    monkeypatch.setattr(model_fit_stages, "over_all_steps", lambda *_: [last])
    measured = cast(Any, SimpleNamespace(axes=("X1",)))
    found = refined(measured, cast(Any, None), [begin], Effort(in_vain=16.0))
    assert found.best is (last if all_steps else begin)
