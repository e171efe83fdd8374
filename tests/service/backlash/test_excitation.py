"""The proposed step: section III's conditions, the information in it, and the limit that is in the way of any."""

from __future__ import annotations

from dataclasses import replace

import pytest

from service.backlash.excitation import (
    KEPT_FREE,
    PERIODS,
    Limits,
    NoStep,
    Proposal,
    Sensing,
    Systematic,
    propose,
)

LIMITS = Limits(v=1.5, a=10.0, jerk=500.0, travel=0.05)
SENSING = Sensing(noise=0.05)
EXACT = Systematic(0.0, 0.0)


def proposed(limits: Limits = LIMITS, sensing: Sensing = SENSING, b: float = 50e-6) -> Proposal:
    found = propose(limits, sensing, b, EXACT, wanted=1e-9)
    assert isinstance(found, Proposal), found
    return found


@pytest.mark.parametrize("b", [15e-6, 150e-6])
def test_the_step_keeps_the_conditions_of_section_iii(b: float) -> None:
    found = proposed(b=b)
    assert found.v_max <= KEPT_FREE * LIMITS.v
    assert found.a_max <= KEPT_FREE * LIMITS.a
    assert found.length <= LIMITS.travel
    assert found.jerk <= LIMITS.jerk
    assert found.gap_time >= PERIODS / SENSING.speed_rate


def test_ten_times_the_noise_is_ten_times_the_interval() -> None:
    quiet, loud = proposed(), proposed(sensing=replace(SENSING, noise=0.5))
    assert 5.0 < loud.noise_alone / quiet.noise_alone < 12.0


def test_a_tight_limit_costs_information() -> None:
    assert proposed(replace(LIMITS, a=3.0, travel=0.003)).noise_alone > proposed().noise_alone


def test_what_the_structure_is_worth_is_added() -> None:
    found = propose(LIMITS, SENSING, 50e-6, Systematic(1e-6, 0.0), wanted=1e-9)
    assert isinstance(found, Proposal)
    assert found.half_width == pytest.approx((found.noise_alone**2 + (1.96e-6) ** 2) ** 0.5)


@pytest.mark.parametrize(
    ("limits", "sensing", "b", "limit"),
    [
        (replace(LIMITS, v=0.001), SENSING, 50e-6, "velocity"),
        (replace(LIMITS, a=0.05), SENSING, 50e-6, "acceleration"),
        (replace(LIMITS, travel=1e-4), SENSING, 50e-6, "travel"),
        (replace(LIMITS, a=0.7), SENSING, 3e-3, "crossing"),
        (LIMITS, replace(SENSING, speed_rate=150.0), 10e-6, "sampling"),
        (LIMITS, replace(SENSING, noise=50.0), 10e-6, "noise"),
    ],
)
def test_the_limit_in_the_way_is_named(limits: Limits, sensing: Sensing, b: float, limit: str) -> None:
    found = propose(limits, sensing, b, EXACT, wanted=1e-9)
    assert isinstance(found, NoStep)
    assert found.limit == limit
