"""Other sharings of a drive: what they keep of it, and what several minima say of the backlash together."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from service.backlash import model_fit_rivals
from service.backlash.model_fit_rivals import weighed
from service.backlash.model_fit_stages import SHARINGS, Staged, shared_out
from service.dynamics.driven_model import Model
from service.recording import FloatArray

LINKS = ("gear", "pinion", "contact")


def staged(
    monkeypatch: pytest.MonkeyPatch, costs: list[float], b: list[float], misfit: float = 1.0
) -> Staged:
    """A best fit and its rivals with these costs and backlashes [m]."""
    values = dict(zip(costs, b, strict=True))
    monkeypatch.setattr(model_fit_rivals, "backlashes", lambda _problem, fit: np.array([values[fit.cost]]))
    ends: list[Any] = [
        SimpleNamespace(problem=None, fit=SimpleNamespace(cost=cost, misfit=misfit)) for cost in costs
    ]
    return Staged(ends[0], ends[:1], [], tuple(ends[1:]))


def test_one_minimum_says_what_it_says(monkeypatch: pytest.MonkeyPatch) -> None:
    assert weighed(staged(monkeypatch, [900.0], [5e-5]), 0) == (0.0, 0.0)


def test_two_that_are_as_likely_are_both_half_right(monkeypatch: pytest.MonkeyPatch) -> None:
    """The mean lies in the middle, and half their distance is a standard deviation."""
    found = weighed(staged(monkeypatch, [900.0, 900.0 + 1e-9], [5e-5, 5.04e-5]), 0)
    assert found.shift == pytest.approx(0.2e-6, rel=1e-6)
    assert np.sqrt(found.variance) == pytest.approx(0.2e-6, rel=1e-6)


def test_a_rival_counts_by_its_likelihood(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three units of cost are a factor of e³; where the residuals are twice as large, of e^(3/4)."""
    for misfit, odds in ((1.0, np.exp(-3.0)), (4.0, np.exp(-0.75))):
        found = weighed(staged(monkeypatch, [900.0, 903.0], [5e-5, 5.1e-5], misfit), 0)
        assert found.shift == pytest.approx(1e-6 * odds / (1.0 + odds))


def test_a_rival_far_above_the_best_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    found = weighed(staged(monkeypatch, [900.0, 960.0], [5e-5, 9e-5]), 0)
    assert abs(found.shift) < 1e-20


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
