"""The closed form, on a load whose motion is written down by hand: no simulator, no stored output."""

from __future__ import annotations

import numpy as np
import pytest

from service.backlash.contact_regression import contact_regression
from service.backlash.results import Reason
from service.recording import AxisDescription, FloatArray, Move, Recording, Trace

TRANSMISSION = 0.003
DURATION = 0.088
PAUSE = 0.3


def bump(t: FloatArray, start: float, length: float) -> FloatArray:
    """C∞-like step from 0 to 1 over `length` [s]: smoothstep of degree 7."""
    x = np.clip((t - start) / length, 0.0, 1.0)
    return x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)


def motion(t: FloatArray, moves: tuple[Move, ...], b: float, c: float) -> tuple[FloatArray, FloatArray]:
    """Motor and load position (n,) [m] at the output: the load moves smoothly, the motor is ahead by
    ± b/2 + c·a, and inside the gap the difference runs smoothly from one flank to the other."""
    load, flank = np.zeros_like(t), np.full_like(t, -b / 2.0)
    for move in moves:
        load += move.direction * move.length * bump(t, move.start, move.duration)
        to = move.direction * b
        flank += to * bump(t, move.start, 0.015) - to * bump(t, move.start + 0.5 * move.duration, 0.012)
    a = np.gradient(np.gradient(load, t), t)
    return load + flank + c * a, load


def recording(b: float, c: float = 4e-6, noise: float = 0.03, sign: float = 1.0) -> Recording:
    """Ten steps of one direction-alternating run, 1 kHz speed, 4 kHz acceleration."""
    moves = tuple(
        Move(0.35 + k * (DURATION + PAUSE), 1 if k % 2 == 0 else -1, 0.0042, 200.0, DURATION)
        for k in range(10)
    )
    fine = np.arange(0.0, moves[-1].end + 0.3, 1.25e-4)
    motor, load = motion(fine, moves, b, c)
    rng = np.random.default_rng(5)
    acceleration = np.gradient(np.gradient(load, fine), fine)[::2]
    acceleration = sign * acceleration + rng.normal(0.0, noise, len(acceleration))
    speed = (np.gradient(motor, fine) / TRANSMISSION)[::8]
    traces = {
        ("X1", "motor_speed"): Trace(fine[::8], speed),
        ("X1", "acceleration"): Trace(fine[::2], acceleration),
    }
    return Recording("written down", (AxisDescription("X1", TRANSMISSION),), traces, moves)


@pytest.mark.parametrize("b", [20e-6, 60e-6, 150e-6])
def test_finds_the_gap_between_the_flanks(b: float) -> None:
    result = contact_regression(recording(b), "X1")
    assert result.verdict == "ok"
    assert result.backlash == pytest.approx(b, abs=max(1.5e-6, 0.04 * b))


def test_wind_up_is_not_taken_for_backlash() -> None:
    """A drive three times softer moves D by 3·c·a, some 36 µm from peak to peak; b must not follow."""
    stiff, soft = (contact_regression(recording(60e-6, c), "X1").backlash for c in (2e-6, 6e-6))
    assert stiff is not None
    assert soft == pytest.approx(stiff, abs=1e-6)


def test_interval_covers_and_is_of_use() -> None:
    result = contact_regression(recording(60e-6, noise=0.05), "X1")
    assert result.interval_95 is not None
    low, high = result.interval_95
    assert low < 60e-6 < high
    assert high - low < 30e-6


def test_every_move_has_a_result_in_order() -> None:
    result = contact_regression(recording(60e-6), "X1")
    assert [step.index for step in result.steps] == list(range(10))
    assert {step.direction for step in result.steps} == {1, -1}
    for step in result.steps:
        if step.verdict == "ok":
            assert step.t1 is not None
            assert step.t2 is not None
            assert step.t1 < step.t2


def test_no_gap_is_refused() -> None:
    result = contact_regression(recording(0.0), "X1")
    assert result.verdict == "refused"
    assert result.backlash is None


def test_a_sensor_mounted_backwards_gives_no_value() -> None:
    assert contact_regression(recording(60e-6, sign=-1.0), "X1").verdict == "refused"


def test_missing_channel_is_named() -> None:
    whole = recording(60e-6)
    traces = {key: trace for key, trace in whole.traces.items() if key[1] != "acceleration"}
    lacking = Recording(whole.machine, whole.axes, traces, whole.moves)
    result = contact_regression(lacking, "X1")
    assert result.reason is Reason.CHANNEL_MISSING
    assert result.detail is not None
    assert "acceleration" in result.detail


def test_no_moves_is_named() -> None:
    whole = recording(60e-6)
    assert contact_regression(Recording("m", whole.axes, whole.traces), "X1").reason is Reason.NO_MOVES


def test_an_axis_of_a_gantry_is_left_to_the_joint_fit() -> None:
    whole = recording(60e-6)
    coupled = Recording(whole.machine, whole.axes, whole.traces, whole.moves, (("X1", "X2"),))
    result = contact_regression(coupled, "X1")
    assert result.verdict == "refused"
    assert result.reason is Reason.INTERVAL_TOO_WIDE
