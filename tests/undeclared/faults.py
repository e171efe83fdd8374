"""Recordings that must be refused: what is wrong with the cable, the sensor or the move, never with the gap."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.random import Generator

from tests.undeclared.draw import Machine
from tests.undeclared.machine import Steps
from tests.undeclared.sensors import ACCELERATION_LSB, STANDARD_GRAVITY, Channel

Channels = dict[str, dict[str, Channel]]
Fault = Callable[[Generator, Channels], Channels]


def _change(channels: Channels, name: str, by: Callable[[Channel], Channel]) -> Channels:
    return {axis: by_name | {name: by(by_name[name])} for axis, by_name in channels.items()}


def blocked(rng: Generator, channels: Channels) -> Channels:
    """The accelerometer is stuck at one value, or says nothing but its own noise."""
    noise = float(rng.choice([0.0, 0.0, 0.02]))

    def stuck(channel: Channel) -> Channel:
        t, _ = channel
        values = 0.01 + noise * rng.standard_normal(t.size)
        return t, np.round(values / ACCELERATION_LSB) * ACCELERATION_LSB

    return _change(channels, "acceleration", stuck)


def swapped(rng: Generator, channels: Channels) -> Channels:
    """The two accelerometers of a gantry are plugged in crosswise."""
    left, right = channels
    return {
        left: channels[left] | {"acceleration": channels[right]["acceleration"]},
        right: channels[right] | {"acceleration": channels[left]["acceleration"]},
    }


def wrong_sign(rng: Generator, channels: Channels) -> Channels:
    """The accelerometer is screwed on the other way round."""
    return _change(channels, "acceleration", lambda c: (c[0], -c[1]))


def rpm(rng: Generator, channels: Channels) -> Channels:
    """The motor speed is in revolutions per minute."""
    return _change(channels, "motor_speed", lambda c: (c[0], c[1] * 30 / np.pi))


def in_g(rng: Generator, channels: Channels) -> Channels:
    """The acceleration is in units of standard gravity."""
    return _change(channels, "acceleration", lambda c: (c[0], c[1] / STANDARD_GRAVITY))


def lost(rng: Generator, channels: Channels) -> Channels:
    """Five per cent of the accelerometer's samples are gone."""

    def thin(channel: Channel) -> Channel:
        keep = rng.uniform(size=channel[0].size) >= 0.05
        return channel[0][keep], channel[1][keep]

    return _change(channels, "acceleration", thin)


def as_it_is(rng: Generator, channels: Channels) -> Channels:
    """Leave the channels alone: the fault is in the move."""
    return channels


FAULTS: dict[str, Fault] = {
    "blocked": blocked,
    "swapped": swapped,
    "wrong_sign": wrong_sign,
    "rpm": rpm,
    "g": in_g,
    "lost": lost,
    "too_slow": as_it_is,
    "too_short": as_it_is,
}


def weak_moves(name: str, m: Machine, steps: Steps) -> Steps:
    """Return moves in which the flanks never part: braking asks less than the carriage's friction gives by itself.

    The top acceleration of a step is (32·L)^(1/3)·j^(2/3)/4; half of fc/m_load is asked.
    """
    if name not in ("too_slow", "too_short"):
        return steps
    length = steps.length if name == "too_slow" else 3e-4
    wanted = 0.5 * m["fc"] / m["m_load"]
    return Steps(
        length=length,
        jerk=float((4 * wanted / (32 * length) ** (1 / 3)) ** 1.5),
        count=steps.count,
        rest=steps.rest,
    )
