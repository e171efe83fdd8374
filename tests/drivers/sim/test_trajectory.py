"""The drive's trajectory generator against its limits and against arithmetic of its own."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.sim.trajectory import point_to_point, stop_ramp

positive = st.floats(0.1, 1e3)


@given(
    start=st.floats(-100, 100),
    distance=st.floats(1e-4, 1e3) | st.floats(-1e3, -1e-4),
    speed=positive,
    acceleration=positive,
    deceleration=positive,
    jerk=st.floats(1, 1e6) | st.just(inf),
)
def test_keeps_limits_and_arrives(start, distance, speed, acceleration, deceleration, jerk):
    profile = point_to_point(start, start + distance, speed, acceleration, deceleration, jerk)
    t = np.linspace(0, profile.duration, 2001)
    x, v, a = profile.at(t)
    sign = np.sign(distance)
    scale = abs(start) + abs(distance)
    assert np.all(sign * v <= speed * (1 + 1e-9)) and np.all(sign * v >= -1e-6 * speed)
    assert np.all(sign * a <= acceleration * (1 + 1e-9)) and np.all(sign * a >= -deceleration * (1 + 1e-9))
    assert x[0] == pytest.approx(start, abs=1e-9 * scale) and x[-1] == start + distance
    assert abs(x[-2] - x[-1]) <= 1.01 * speed * t[1] + 1e-9 * scale, "jumps to its end"
    if jerk < inf:
        assert np.max(np.abs(np.diff(a))) <= 1.01 * jerk * t[1] + 1e-9 * max(acceleration, deceleration)


@given(distance=st.floats(0.01, 100), speed=positive, acceleration=positive, jerk=st.floats(10, 1e5))
def test_signals_are_each_others_derivatives(distance, speed, acceleration, jerk):
    profile = point_to_point(0.0, distance, speed, acceleration, acceleration, jerk)
    t = np.linspace(0, profile.duration, 20001)
    x, v, a = profile.at(t)
    step = t[1]
    assert np.allclose(np.cumsum((v[1:] + v[:-1]) * step / 2), x[1:], atol=2 * step * speed)
    assert np.allclose(np.cumsum((a[1:] + a[:-1]) * step / 2), v[1:], atol=2 * step * acceleration)


def test_the_papers_step_lasts_86_ms():
    """SL = 4 mm at j = 200 m/s³: four equal phases of (SL / 2j)^(1/3), a_max 4.31 m/s², v_max 92.8 mm/s."""
    profile = point_to_point(0.0, 0.004, 10.0, 100.0, 100.0, 200.0)
    x, v, a = profile.at(np.linspace(0, profile.duration, 40001))
    assert profile.duration == pytest.approx(4 * (0.004 / 400) ** (1 / 3), rel=1e-9)
    assert profile.duration == pytest.approx(0.0862, abs=5e-5)
    assert np.max(a) == pytest.approx(4.31, abs=0.005) and np.max(v) == pytest.approx(0.0928, abs=5e-5)
    assert x[20000] == pytest.approx(0.002, rel=1e-9)


def test_long_move_has_seven_phases():
    """v 1, a 2, j 10 over 3 m: each ramp v/a + a/j = 0.7 s over 0.35 m, 2.3 s at full speed."""
    profile = point_to_point(0.0, 3.0, 1.0, 2.0, 2.0, 10.0)
    assert profile.duration == pytest.approx(0.7 + 2.3 + 0.7)
    assert profile.at(np.array([0.35]))[2][0] == pytest.approx(2.0)


def test_unequal_ramps_without_jerk_limit():
    """Up at 4, down at 1 over 10 m without speed limit: peak v = sqrt(2·10 / (1/4 + 1/1)) = 4 m/s, 1 s and 4 s."""
    profile = point_to_point(0.0, 10.0, 100.0, 4.0, 1.0)
    assert profile.duration == pytest.approx(5.0)
    assert profile.at(np.array([1.0]))[1][0] == pytest.approx(4.0)


def test_no_distance_takes_no_time():
    profile = point_to_point(2.0, 2.0, 1.0, 1.0, 1.0, 1.0)
    assert profile.duration == 0.0
    assert profile.at(np.array([0.0, 1.0]))[0].tolist() == [2.0, 2.0]


@pytest.mark.parametrize("speed", [3.0, -3.0])
def test_stop_ramp_brakes_at_constant_deceleration(speed):
    """From 3 rad/s at 6 rad/s²: half a second, 0.75 rad."""
    profile = stop_ramp(1.0, speed, 6.0)
    assert profile.duration == pytest.approx(0.5)
    assert profile.end == pytest.approx(1.0 + np.sign(speed) * 0.75)
    x, v, a = profile.at(np.array([0.25]))
    assert v[0] == pytest.approx(speed / 2) and a[0] == pytest.approx(-6.0 * np.sign(speed))
    assert x[0] == pytest.approx(1.0 + np.sign(speed) * 0.5625)
