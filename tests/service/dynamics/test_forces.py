"""The force laws as formulas: eqs. (5)-(7), and what they are not."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from service.dynamics.forces import Contact, Sliding, elongation, flank_force, sliding_friction

GAP = Contact("X1", np.array([1.0, -1.0]), k=2e8, d=2e4, UL=20e-6, LL=-30e-6)


def test_elongation_is_the_dead_zone_of_equation_6() -> None:
    x_rp = np.array([-40e-6, -30e-6, -1e-6, 0.0, 20e-6, 25e-6])
    np.testing.assert_allclose(elongation(x_rp, GAP.UL, GAP.LL), [-10e-6, 0, 0, 0, 0, 5e-6], atol=1e-18)


def test_flank_force_on_both_flanks_and_in_the_gap() -> None:
    x_rp = np.array([25e-6, 25e-6, 0.0, -40e-6, -40e-6])
    v_rp = np.array([0.0, 0.01, 5.0, 0.0, -0.01])
    np.testing.assert_allclose(flank_force(GAP, x_rp, v_rp), [1000, 1200, 0, -2000, -2200], rtol=1e-9)


@given(x_rp=st.floats(-1e-4, 1e-4), v_rp=st.floats(-1.0, 1.0))
def test_flanks_push_and_never_pull(x_rp: float, v_rp: float) -> None:
    force = float(flank_force(GAP, x_rp, v_rp))
    assert force * float(elongation(x_rp, GAP.UL, GAP.LL)) >= 0


def test_friction_opposes_motion() -> None:
    guide = Sliding("carriage", np.array([0.0, 1.0]), level=100.0, viscous=300.0)
    np.testing.assert_allclose(sliding_friction(guide, [-0.1, 0.0, 0.1]), [-130, 0, 130])
