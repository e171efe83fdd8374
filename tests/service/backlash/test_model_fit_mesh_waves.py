"""The covariance of a mesh's waves: against drawn waves that another routine takes apart, and its limits."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Legendre

from service.backlash.model_fit_impurities import BOWS, MESH
from service.backlash.model_fit_mesh_waves import band, of_waves
from service.recording import FloatArray

WIDTHS = MESH * np.minimum(1.0, 2.0 / np.arange(1, BOWS + 1))
"""Of the prior of every polynomial [m]."""


def drawn(length: float, shortest: float, longest: float, count: int) -> FloatArray:
    """Coefficients (count, BOWS) of drawn waves of RMS MESH over a stroke, each its own least squares of degree 12."""
    rng = np.random.default_rng(4)
    place, out = np.linspace(-1.0, 1.0, 400), []
    for _ in range(count):
        wave = np.exp(rng.uniform(np.log(shortest), np.log(longest)))
        phase = np.pi * length * place / wave + rng.uniform(0.0, 2.0 * np.pi)
        out.append(Legendre.fit(place, np.sqrt(2.0) * MESH * np.sin(phase), 12).coef[1 : BOWS + 1])
    return np.array(out) / WIDTHS


@pytest.mark.parametrize("edges", [(4.5e-3, 7e-3), (11e-3, 20e-3)])
def test_covariance_of_a_band_is_that_of_drawn_waves(edges: tuple[float, float]) -> None:
    coefficients = drawn(5e-3, *edges, count=4000)
    expected = coefficients.T @ coefficients / len(coefficients)
    assert band(5e-3, *edges) == pytest.approx(expected, abs=0.05 * float(np.max(expected)))


def test_a_wave_far_longer_than_the_stroke_is_a_slope() -> None:
    sizes = np.sqrt(np.diag(band(2e-3, 0.05, 0.1))) * WIDTHS
    assert np.all(sizes[1:] < 0.05 * sizes[0])


def test_the_first_kind_is_the_prior_of_the_fit() -> None:
    kinds = of_waves(5e-3)
    assert kinds[0] == pytest.approx(np.eye(BOWS))
    assert all(np.all(np.linalg.eigvalsh(kind) > 0.0) for kind in kinds)
