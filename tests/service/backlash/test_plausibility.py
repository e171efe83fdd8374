"""What cannot be what was commanded is refused by name: units, signs, sensors, rates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from service.backlash.admission import admit
from service.backlash.paper import paper
from service.backlash.results import AxisResult, Reason
from service.recording import FloatArray, Recording, Trace
from tests.service.backlash.ideal import Run, recording

SOUND = Run(noise=0.02, bias=0.05)


def changed(channel: str, change: Callable[[FloatArray], FloatArray]) -> AxisResult:
    """The result of a sound run with one channel changed."""
    source = recording(SOUND)
    traces = dict(source.traces)
    trace = traces["X1", channel]
    traces["X1", channel] = Trace(trace.time, change(trace.value))
    return paper(replace(source, traces=traces), "X1")


def test_the_sound_run_is_accepted() -> None:
    assert changed("acceleration", lambda value: value).verdict == "ok"


@pytest.mark.parametrize(
    ("channel", "factor", "named"),
    [
        ("motor_speed", 30 / np.pi, "rpm"),
        ("motor_speed", 180 / np.pi, "degrees"),
        ("motor_speed", 0.5 / np.pi, "revolutions"),
        ("acceleration", 1 / 9.80665, "g instead"),
        ("acceleration", 1000.0, "mm/s²"),
        ("acceleration", 0.6, "scale"),
    ],
)
def test_a_wrong_unit_is_named(channel: str, factor: float, named: str) -> None:
    result = changed(channel, lambda value: factor * value)
    assert result.reason is Reason.IMPLAUSIBLE_MAGNITUDE
    assert result.backlash is None
    assert result.detail is not None
    assert named in result.detail


@pytest.mark.parametrize("factor", [0.93, 1.07])
def test_a_sensor_some_percent_off_is_accepted(factor: float) -> None:
    assert changed("acceleration", lambda value: factor * value).verdict == "ok"


@pytest.mark.parametrize("channel", ["motor_speed", "acceleration"])
def test_a_reversed_sign_is_named(channel: str) -> None:
    assert changed(channel, lambda value: -value).reason is Reason.WRONG_SIGN


def test_a_constant_accelerometer_is_flat() -> None:
    assert changed("acceleration", lambda value: np.full(len(value), 0.1)).reason is Reason.SENSOR_FLAT


def test_a_blocked_accelerometer_is_flat() -> None:
    noise = np.random.default_rng(3)
    result = changed("acceleration", lambda value: noise.normal(0.05, 0.02, len(value)))
    assert result.reason is Reason.SENSOR_FLAT


def test_an_accelerometer_that_stops_in_mid_run_is_flat() -> None:
    def stops(value: FloatArray) -> FloatArray:
        at = len(value) // 2
        return np.where(np.arange(len(value)) > at, value[at], value)

    assert changed("acceleration", stops).reason is Reason.SENSOR_FLAT


def test_a_clipped_accelerometer_is_named() -> None:
    assert changed("acceleration", lambda value: np.clip(value, -3.0, 3.0)).reason is Reason.SENSOR_CLIPPED


def test_an_accelerometer_across_the_travel_disagrees() -> None:
    def across(value: FloatArray) -> FloatArray:
        return np.random.default_rng(4).permutation(value)

    assert changed("acceleration", across).reason in (Reason.SIGNALS_DISAGREE, Reason.SENSOR_FLAT)


def test_nan_is_named() -> None:
    def holed(value: FloatArray) -> FloatArray:
        return np.where(np.arange(len(value)) == 1000, np.nan, value)

    assert changed("motor_speed", holed).reason is Reason.NOT_FINITE


def test_a_motor_that_did_not_move_is_named() -> None:
    result = changed("motor_speed", lambda value: np.zeros(len(value)))
    assert result.reason is Reason.TRAJECTORY_NOT_FOLLOWED


def test_a_motor_that_stopped_half_way_is_named() -> None:
    source = recording(SOUND)
    speed = source.traces["X1", "motor_speed"]
    keep = np.ones(len(speed))
    for move in source.moves:
        keep[(speed.time > move.start + 0.6 * move.duration) & (speed.time <= move.end)] = 0.0
    stopped = {**source.traces, ("X1", "motor_speed"): Trace(speed.time, speed.value * keep)}
    assert paper(replace(source, traces=stopped), "X1").reason is Reason.TRAJECTORY_NOT_FOLLOWED


@pytest.mark.parametrize("channel", ["motor_speed", "acceleration"])
def test_a_missing_channel_is_named(channel: str) -> None:
    source = recording(SOUND)
    traces = {key: trace for key, trace in source.traces.items() if key[1] != channel}
    result = paper(replace(source, traces=traces), "X1")
    assert result.reason is Reason.CHANNEL_MISSING
    assert result.detail is not None
    assert channel in result.detail


@pytest.mark.parametrize(("speed_rate", "load_rate"), [(250.0, 4000.0), (1000.0, 250.0)])
def test_a_rate_too_low_is_named(speed_rate: float, load_rate: float) -> None:
    run = replace(SOUND, speed_rate=speed_rate, load_rate=load_rate)
    assert paper(recording(run), "X1").reason is Reason.RATE_TOO_LOW


def with_speed(source: Recording, shape: Callable[[FloatArray], FloatArray]) -> Recording:
    """Motor and load both with the speed ``shape``, over the share of the move, for every move."""
    speed, load = source.traces["X1", "motor_speed"], source.traces["X1", "acceleration"]
    fine = np.arange(0.0, float(speed.time[-1]), 1e-5)
    v = np.zeros(len(fine))
    for move in source.moves:
        share = (fine - move.start) / move.duration
        inside = (share > 0) & (share < 1)
        v[inside] += move.direction * shape(share[inside]) * move.length / move.duration
    traces = {
        ("X1", "motor_speed"): Trace(speed.time, np.interp(speed.time, fine, v) / 0.003),
        ("X1", "acceleration"): Trace(load.time, np.interp(load.time, fine, np.gradient(v, 1e-5))),
    }
    return replace(source, traces=traces)


@pytest.mark.parametrize("overshoot", [-0.25, 0.25])
def test_a_loop_that_rings_or_creeps_is_the_drives_own_affair(overshoot: float) -> None:
    def ringing(share: FloatArray) -> FloatArray:
        near = np.minimum(share, 1 - share)
        nominal = np.where(near < 0.25, 16 * near**2, 2 - 16 * (0.5 - near) ** 2)
        changed = nominal * (1.0 + overshoot * np.sin(np.pi * share) ** 2)
        return np.asarray(changed / np.mean(changed))

    source = recording(SOUND)
    assert admit(with_speed(source, ringing), "X1") is None


def test_a_soft_loop_that_friction_stops_a_third_short_is_the_drives_own_affair() -> None:
    def short(share: FloatArray) -> FloatArray:
        near = np.minimum(share, 1 - share)
        return np.asarray(np.where(near < 0.25, 16 * near**2, 2 - 16 * (0.5 - near) ** 2) * 2.0 / 3.0)

    assert admit(with_speed(recording(SOUND), short), "X1") is None


def test_a_section_of_constant_speed_breaks_the_excitation() -> None:
    def cut_off(share: FloatArray) -> FloatArray:
        return np.minimum.reduce([share, 1 - share, np.full(len(share), 0.25)]) / 0.1875

    assert paper(with_speed(recording(SOUND), cut_off), "X1").reason is Reason.EXCITATION


def test_constant_acceleration_breaks_the_excitation() -> None:
    def triangle(share: FloatArray) -> FloatArray:
        return 4 * np.minimum(share, 1 - share)

    result = paper(with_speed(recording(SOUND), triangle), "X1")
    assert result.reason is Reason.EXCITATION
    assert result.detail is not None
    assert "0x6086" in result.detail
