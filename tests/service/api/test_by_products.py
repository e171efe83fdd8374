"""Stiffness, friction and skew as a maintenance planner reads them: names, units of the workshop, trends."""

from __future__ import annotations

import pytest

from service.api.by_products import SHOWN
from service.api.ports import Masses
from tests.service.api.house import House, run_products


@pytest.fixture
def wearing(house: House) -> House:
    """Thirty days in which the contact of Y grows softer by 0.5 % of its middle a day."""
    for day in range(30):
        run_products(house.repository, day, 7e5 * (1.0 - 0.005 * (day - 25)))
    return house


def test_a_contact_that_grows_softer_is_told_in_percent_a_month(wearing: House) -> None:
    """The level is the median of the last nine, that of day 25; 0.5 % of it a day are 15 % in 30 days."""
    found = {one["name"]: one for one in wearing.get("/api/v1/axes/Y/by-products")["items"]}
    stiffness = found["contact_stiffness"]
    assert stiffness["level"] == pytest.approx(7e5)
    assert stiffness["slope_per_day"] == pytest.approx(-0.005 * 7e5)
    low, high = stiffness["slope_interval_95_per_day"]
    assert low <= stiffness["slope_per_day"] <= high < 0
    assert stiffness["shown"]["unit"] == "N/µm per kg"
    assert stiffness["shown"]["level"] == pytest.approx(0.7)
    assert stiffness["shown"]["trend_in_words"] == "falling 15 % a month"
    assert "worn" in stiffness["says"]
    assert found["coulomb_friction"]["shown"]["trend_in_words"] == "steady"
    assert found["skew"]["shown"]["unit"] == "µs"


def test_with_the_moved_mass_stiffness_and_friction_are_absolute(wearing: House) -> None:
    wearing.client = wearing.rebuild(moved_masses={"Y": Masses(240.0)})
    found = {one["name"]: one["shown"] for one in wearing.get("/api/v1/axes/Y/by-products")["items"]}
    assert (found["contact_stiffness"]["unit"], found["coulomb_friction"]["unit"]) == ("N/µm", "N")
    assert found["contact_stiffness"]["level"] == pytest.approx(0.7 * 240)
    assert found["coulomb_friction"]["level"] == pytest.approx(240, rel=0.02)


def test_a_few_runs_have_no_trend_yet_and_say_so(house: House) -> None:
    run_products(house.repository, 0, 7e5)
    (stiffness, *_) = house.get("/api/v1/axes/Y/by-products")["items"]
    assert (stiffness["slope_per_day"], stiffness["slope_interval_95_per_day"]) == (None, None)
    assert "too few runs" in stiffness["shown"]["trend_in_words"]


def test_prometheus_gets_the_latest_with_its_unit(wearing: House) -> None:
    text = wearing.client.get("/metrics").text
    (line,) = [one for one in text.splitlines() if 'name="contact_stiffness"' in one]
    assert line.startswith(
        'flankwatch_by_product{axis="Y",group="Y",name="contact_stiffness",unit="N/(m kg)"}'
    )
    assert float(line.rsplit(" ", 1)[1]) == pytest.approx(7e5 * (1 - 0.005 * 4))


def test_a_run_shows_what_it_found_in_the_same_units(house: House) -> None:
    house.client = house.rebuild(moved_masses={"Y": Masses(240.0)})
    run_id = run_products(house.repository, 0, 7e5)
    (result,) = house.get(f"/api/v1/runs/{run_id}")["results"]
    assert (result["by_products"][0]["name"], result["by_products"][0]["unit"]) == (
        "contact_stiffness", "N/(m kg)",
    )  # fmt: skip
    assert result["by_products"][0]["shown"] == {
        "unit": "N/µm", "value": pytest.approx(168.0), "std": pytest.approx(2.4),
    }  # fmt: skip


def test_a_bridge_is_as_stiff_seen_from_both_sides() -> None:
    """Its stiffness is found per kilogram of the gantry's first axis, whichever side it is shown with."""
    bridge = SHOWN["bridge_stiffness"]
    assert bridge.scale(Masses(300.0, 330.0)) == (pytest.approx(330e-6), "N/µm")
    assert bridge.scale(Masses(300.0)) == (1e-6, "N/µm per kg")
