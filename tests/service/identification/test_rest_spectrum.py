"""What is heard between moves: a swing that was let go, told from noise and from a drift."""

from __future__ import annotations

import numpy as np
import pytest

from service.identification.rest_spectrum import heard_at_rest, swings_before
from service.recording import AxisDescription, Move, Recording, Trace

RATE, NOISE = 2000.0, 0.03
MOVES = tuple(Move(0.5 * k, 1 if k % 2 else -1, 0.005, 100.0, 0.15) for k in range(1, 11))


def heard(
    seed: int, frequency: float = 0.0, strength: float = 0.0, drift: float = 0.0, impacts: bool = False
) -> float | None:
    """Of a sensor that hears a damped swing of this strength [m/s²] from the end of every move on, and the impacts on
    the flanks at its turns."""
    time = np.arange(0.0, 6.0, 1.0 / RATE)
    value = np.random.default_rng(seed).normal(0.0, NOISE, len(time)) + drift * time
    for move in MOVES:
        since = time - move.end
        swing = np.exp(-0.01 * 2 * np.pi * frequency * since) * np.sin(2 * np.pi * frequency * since)
        value += np.where((since > 0) & (since < 0.35), strength * swing, 0.0)
        if impacts:
            turns = (
                np.sin(2 * np.pi * frequency * (since - 1.0 / RATE)) * np.sin(2 * np.pi * frequency * since)
                < 0
            )
            met = np.where(
                turns & (since > 0) & (since < 0.2), np.sign(np.cos(2 * np.pi * frequency * since)), 0.0
            )
            value += np.convolve(met, np.full(6, 20.0 * strength), mode="same")
        value += np.where((time > move.start) & (time < move.end), 5.0, 0.0)
    trace = Trace(time, value)
    recording = Recording("m", (AxisDescription("X1", 0.004),), {("X1", "acceleration"): trace}, MOVES)
    return heard_at_rest(recording, ("X1",))


@pytest.mark.parametrize("frequency", [9.0, 22.0, 61.0, 140.0])
def test_a_swing_between_the_moves_is_heard_at_its_frequency(frequency: float) -> None:
    found = heard(1, frequency, 0.2)
    assert found == pytest.approx(frequency, rel=0.06)


@pytest.mark.parametrize("seed", range(20))
def test_noise_and_a_drift_are_no_swing(seed: int) -> None:
    assert heard(seed, drift=0.2) is None


@pytest.mark.parametrize("frequency", [13.0, 17.0])
def test_a_swing_is_heard_that_throws_the_load_from_flank_to_flank(frequency: float) -> None:
    """Short impacts twice in a period are in every odd multiple of it up to the highest, and nothing is quiet then."""
    assert heard(1, frequency, 0.2, impacts=True) == pytest.approx(frequency, rel=0.1)


def test_a_body_that_carries_the_axis_is_where_its_swing_before_a_move_has_come_to() -> None:
    """Of two axes that stand on it the mean; nothing before the first move, where there was no rest of a period."""
    frequency, damping, amplitude = 11.0, 0.01, 4e-4
    omega, time = 2.0 * np.pi * frequency, np.arange(MOVES[0].start - 0.05, 6.0, 1.0 / RATE)
    swing = amplitude * np.exp((-damping * omega + 1j * omega) * time)
    rate = (-damping * omega + 1j * omega) * swing
    felt = np.real((-damping * omega + 1j * omega) ** 2 * swing)
    noise = np.random.default_rng(5).normal(0.0, NOISE, (2, len(time)))
    traces = {
        (axis, "acceleration"): Trace(time, felt + n) for axis, n in zip(("X1", "X2"), noise, strict=True)
    }
    recording = Recording("m", (AxisDescription("X1", 0.004), AxisDescription("X2", 0.004)), traces, MOVES)
    starts = np.array([move.start - 0.002 for move in MOVES])
    found = swings_before(recording, ("X1", "X2"), frequency, starts)
    assert np.all(found[0] == 0.0)
    place, speed = (np.interp(starts[1:], time, np.real(of)) for of in (swing, rate))
    size = amplitude * np.exp(-damping * omega * starts[1:])
    np.testing.assert_array_less(np.abs(found[1:, 0] - place), 0.1 * size)
    np.testing.assert_array_less(np.abs(found[1:, 1] - speed), 0.1 * omega * size)
