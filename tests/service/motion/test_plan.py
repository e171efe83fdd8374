"""The plan stays within the axis' travel, alternates, and ends where it began."""

from __future__ import annotations

from pathlib import Path

import pytest

from service.config import Settings, load_settings
from service.motion.plan import NotPermitted, plan_steps

EXAMPLE = Path(__file__).parents[3] / "deploy" / "flankwatch.toml"


@pytest.fixture
def settings() -> Settings:
    return load_settings(EXAMPLE)


def test_ten_steps_alternate_and_end_where_they_began(settings: Settings) -> None:
    axes = (settings.axis_named("X1"), settings.axis_named("X2"))
    plan = plan_steps(axes, settings.excitation, {"X1": 1.0, "X2": 1.0})
    assert [step.direction for step in plan.steps] == [1, -1] * 5
    assert sum(step.direction * step.length for step in plan.steps) == pytest.approx(0)
    assert plan.duration == pytest.approx(4 * (0.004 / (2 * 200)) ** (1 / 3))


def test_at_the_upper_end_the_first_step_goes_back(settings: Settings) -> None:
    plan = plan_steps((settings.axis_named("Y"),), settings.excitation, {"Y": 0.7499})
    assert plan.steps[0].direction == -1


def test_an_axis_outside_its_travel_does_not_move(settings: Settings) -> None:
    with pytest.raises(NotPermitted, match=r"Y stands at 760\.00 mm"):
        plan_steps((settings.axis_named("Y"),), settings.excitation, {"Y": 0.76})


def test_a_gantry_needs_room_on_both_sides_at_once(settings: Settings) -> None:
    axes = (settings.axis_named("X1"), settings.axis_named("X2"))
    with pytest.raises(NotPermitted, match="end stop"):
        plan_steps(axes, settings.excitation, {"X1": 0.001, "X2": 2.9999})
