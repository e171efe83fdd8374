"""The plan stays within the axis' travel, alternates, and ends where it began."""

from __future__ import annotations

from pathlib import Path

import pytest

from service.config import Settings, load_settings
from service.motion.plan import NotPermitted, Plan, plan_map, plan_steps

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
    with pytest.raises(NotPermitted, match="too near an end"):
        plan_steps(axes, settings.excitation, {"X1": 0.001, "X2": 2.9999})


def at_places(settings: Settings, positions: dict[str, float], *places: float) -> Plan:
    axes = [settings.axis_named(name) for name in positions]
    return plan_map(axes, settings.excitation, settings.travel, positions, places)


def test_a_map_steps_around_each_place_and_ends_where_it_began(settings: Settings) -> None:
    plan = at_places(settings, {"Y": 0.1}, -0.5, 0.3)
    at, middles = 0.1, []
    for visit in plan.visits:
        at += visit.travel.distance if visit.travel else 0.0
        for step in visit.steps:
            middles.append(at + step.direction * step.length / 2)
            at += step.direction * step.length
    assert middles == pytest.approx([-0.5] * 10 + [0.3] * 10)
    assert plan.way_back is not None
    assert at + plan.way_back.distance == pytest.approx(0.1)


def test_an_odd_number_of_steps_comes_back_too(settings: Settings) -> None:
    odd = settings.excitation.model_copy(update={"steps": 5})
    plan = plan_map([settings.axis_named("Y")], odd, settings.travel, {"Y": 0.1}, (-0.5, 0.3))
    steps = sum(step.direction * step.length for step in plan.steps)
    ways = [visit.travel.distance for visit in plan.visits if visit.travel is not None]
    assert plan.way_back is not None
    assert steps + sum(ways) + plan.way_back.distance == pytest.approx(0.0)
    assert ways[1] == pytest.approx(0.8 - 0.004)


def test_steps_that_begin_backwards_lie_around_the_same_place(settings: Settings) -> None:
    plan = plan_map([settings.axis_named("Y")], settings.excitation, settings.travel, {"Y": 0.1}, (0.3,), -1)
    (visit,) = plan.visits
    assert visit.travel is not None
    assert visit.steps[0].direction == -1
    assert 0.1 + visit.travel.distance - 0.002 == pytest.approx(0.3)


def test_no_travel_where_the_axis_stands_at_the_place_already(settings: Settings) -> None:
    plan = at_places(settings, {"Y": 0.298}, 0.3)
    assert [visit.travel for visit in plan.visits] == [None]
    assert plan.way_back is None


def test_a_travel_is_never_faster_than_the_slowest_axis(settings: Settings) -> None:
    slow = {"velocity_limit_m_s": 0.12, "acceleration_limit_m_s2": 0.5}
    axes = [settings.axis_named("X1"), settings.axis_named("X2").model_copy(update=slow)]
    stand = {"X1": 1.0, "X2": 1.0}
    (visit,) = plan_map(axes, settings.excitation, settings.travel, stand, (2.0,)).visits
    assert visit.travel is not None
    assert visit.travel.v_max <= 0.12
    assert visit.travel.a_max <= 0.5
    # trapezoid of the limits: way / v plus v / a, and the rounding of its corners by the jerk, a / j
    assert visit.travel.duration == pytest.approx(0.998 / 0.12 + 0.12 / 0.5 + 0.5 / 20)


@pytest.mark.parametrize(
    ("positions", "says"),
    [
        ({"Y": 0.76}, "lost its reference"),
        ({"X1": 1.0, "X2": 1.5}, "0.5000 m apart on one bridge"),
        ({"X1": 1.0, "X2": 1.0015}, "further from the end"),
    ],
)
def test_what_cannot_be_travelled_is_refused_before_anything_moves(
    settings: Settings, positions: dict[str, float], says: str
) -> None:
    place = 0.3 if "Y" in positions else 2.998
    with pytest.raises(NotPermitted, match=says):
        at_places(settings, positions, place)
