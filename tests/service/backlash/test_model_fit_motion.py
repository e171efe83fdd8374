"""The curves by which a gantry's motors follow the forces."""

from __future__ import annotations

import numpy as np
import pytest

from service.backlash.model_fit_motion import curves
from service.dynamics.driven import ends


@pytest.mark.parametrize(("samples", "h"), [(230, 2.5e-4), (120, 5e-4), (97, 3.1e-4)])
def test_curves_are_independent_and_each_is_one_motion(samples: int, h: float) -> None:
    speeds, motions = curves(samples, h)
    assert np.allclose(speeds.T @ speeds, np.eye(speeds.shape[1]), atol=1e-10)
    assert np.allclose(motions[..., 1], speeds[:-1].T, atol=1e-10)
    assert np.allclose(motions[:, 0, 0], 0.0), "the position at the first point is known"
    reached = ends(motions, h)
    assert np.allclose(reached[:, :-1, 1], motions[:, 1:, 1], atol=1e-9)
    assert np.allclose(reached[:, :-1, 0], motions[:, 1:, 0], atol=3e-6)


def test_curves_reach_what_the_samples_resolve() -> None:
    """A swing of 350 Hz is among them, one of 1 kHz is left to the recoil."""
    speeds, _ = curves(240, 2.5e-4)
    t = 2.5e-4 * np.arange(241)
    kept = [float(np.sum((speeds.T @ np.sin(2.0 * np.pi * hz * t)) ** 2)) / 120.5 for hz in (350.0, 1000.0)]
    assert kept[0] > 0.9
    assert kept[1] < 0.2
