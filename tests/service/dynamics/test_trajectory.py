"""The jerk-limited step: against its closed forms, its own derivatives, and an independent trajectory library."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest
from ruckig import InputParameter, Ruckig, Trajectory

from service.dynamics.trajectory import JerkLimitedStep, jerk_limited_step

FREE = 1e3  # a limit that no step below reaches

# length, jerk, a_lim, v_lim: jerk only; a_lim reached; v_lim reached; both; a_lim touched exactly; long travel
SHAPES = [
    (4e-3, 200.0, FREE, FREE),
    (4e-3, 200.0, 2.0, FREE),
    (4e-3, 200.0, FREE, 0.03),
    (4e-3, 200.0, 2.0, 0.03),
    (2 * 200.0 * 0.02**3, 200.0, 200.0 * 0.02, FREE),
    (1.5, 50.0, 5.0, 2.0),
]


def test_the_papers_step_has_the_known_figures() -> None:
    """Four equal segments of cbrt(SL/(2 j)) each; 200 m/s³ where the paper prints m/s⁴."""
    step = jerk_limited_step(4e-3, 200.0, FREE, FREE)
    T = (4e-3 / 400.0) ** (1 / 3)
    assert step.duration == pytest.approx(4 * T, rel=1e-12)
    assert step.duration == pytest.approx(86.2e-3, abs=0.05e-3)
    assert step.a_max == pytest.approx(4.31, abs=0.005)
    assert step.v_max == pytest.approx(92.8e-3, abs=0.05e-3)
    assert step.t0 == pytest.approx(2 * T, rel=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_ruckig_finds_the_same_motion(shape: tuple[float, float, float, float]) -> None:
    length, jerk, a_lim, v_lim = shape
    step = jerk_limited_step(*shape)
    wanted = InputParameter(1)
    wanted.target_position = [length]
    wanted.max_velocity, wanted.max_acceleration, wanted.max_jerk = [v_lim], [a_lim], [jerk]
    theirs = Trajectory(1)
    Ruckig(1).calculate(wanted, theirs)
    assert step.duration == pytest.approx(theirs.duration, rel=1e-9)
    t = np.linspace(0, theirs.duration, 501)
    x, v, a = np.array([theirs.at_time(float(ti)) for ti in t])[:, :, 0].T
    np.testing.assert_allclose(step.position(t), x, atol=1e-9 * length)
    np.testing.assert_allclose(step.speed(t), v, atol=1e-8 * step.v_max)
    np.testing.assert_allclose(step.acceleration(t), a, atol=1e-6 * step.a_max)


@pytest.mark.parametrize("shape", SHAPES)
def test_each_curve_is_the_derivative_of_the_one_before(shape: tuple[float, float, float, float]) -> None:
    """Trapezoids over a grid that holds the corners are exact for the speed, and nearly so for the position."""
    step = jerk_limited_step(*shape)
    corners = np.concatenate([[0.0], np.cumsum(step.segments)])
    t = np.unique(np.concatenate([np.linspace(a, b, 2001) for a, b in pairwise(corners)]))
    gain = np.diff(t) * (step.acceleration(t)[1:] + step.acceleration(t)[:-1]) / 2
    np.testing.assert_allclose(np.diff(step.speed(t)), gain, atol=1e-12)
    way = np.diff(t) * (step.speed(t)[1:] + step.speed(t)[:-1]) / 2
    assert way.sum() == pytest.approx(step.length, rel=1e-6)


@pytest.mark.parametrize("shape", SHAPES)
def test_limits_hold_and_one_of_them_is_used_at_every_time(shape: tuple[float, float, float, float]) -> None:
    """The quickest motion never idles: at each time jerk, acceleration or speed is at its limit."""
    _, jerk, a_lim, v_lim = shape
    step = jerk_limited_step(*shape)
    t = np.linspace(0, step.duration, 9999)
    v, a = step.speed(t), step.acceleration(t)
    j = np.gradient(a, t)
    tight = 1 + 1e-9
    assert np.all(v <= v_lim * tight)
    assert np.all(np.abs(a) <= a_lim * tight)
    assert np.all(np.abs(j) <= jerk * (1 + 1e-6))
    idle = (v < v_lim * 0.9999) & (np.abs(a) < a_lim * 0.9999) & (np.abs(j) < jerk * 0.9999)
    assert np.count_nonzero(idle) <= 14  # the difference quotient straddles seven corners
    assert step.v_max == pytest.approx(v.max(), rel=1e-6)
    assert step.a_max == pytest.approx(a.max(), rel=1e-3)


def test_acceleration_changes_sign_once_at_t0() -> None:
    step = jerk_limited_step(4e-3, 200.0, FREE, FREE)
    t = np.linspace(1e-6, step.duration - 1e-6, 10001)
    a = step.acceleration(t)
    assert np.all(a[t < step.t0 - 1e-9] > 0)
    assert np.all(a[t > step.t0 + 1e-9] < 0)


def test_before_and_after_the_step_all_is_at_rest() -> None:
    step = jerk_limited_step(4e-3, 200.0, FREE, FREE)
    outside = np.array([-1.0, -1e-9, step.duration, step.duration + 1e-9, 5.0])
    np.testing.assert_array_equal(step.position(outside), [0, 0, 4e-3, 4e-3, 4e-3])
    np.testing.assert_array_equal(step.speed(outside), np.zeros(5))
    np.testing.assert_array_equal(step.acceleration(outside), np.zeros(5))


def test_scalars_and_arrays_of_any_shape() -> None:
    step = jerk_limited_step(4e-3, 200.0, FREE, FREE)
    assert float(step.position(step.t0)) == pytest.approx(2e-3, rel=1e-12)
    assert step.position(np.zeros((2, 3))).shape == (2, 3)


@pytest.mark.parametrize(
    ("name", "bad"), list(product(["length", "jerk", "a_lim", "v_lim"], [0.0, -1.0, np.nan, np.inf]))
)
def test_values_that_are_no_positive_number_are_named(name: str, bad: float) -> None:
    values = {"length": 4e-3, "jerk": 200.0, "a_lim": 10.0, "v_lim": 1.0} | {name: bad}
    with pytest.raises(ValueError, match=f"^{name} of a jerk-limited step must be a positive number"):
        jerk_limited_step(**values)


def test_a_step_is_a_value() -> None:
    assert jerk_limited_step(4e-3, 200.0, 10.0, 1.0) == jerk_limited_step(4e-3, 200.0, 10.0, 1.0)
    assert isinstance(hash(jerk_limited_step(4e-3, 200.0, 10.0, 1.0)), int)
    assert JerkLimitedStep(1.0, 1.0, 1.0, 0.0, 0.0).duration == 4.0
