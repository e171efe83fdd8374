"""The holding brake of the simulated motor, by CiA 402: applied in every state without torque, never a gap before."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pytest

from drivers.sim.machine import SimulatedMachine
from tests.drivers.sim.rig import (
    DRIVE,
    STEP_COUNTS,
    Bench,
    Rigid,
    Scripted,
    channel,
    of,
    raw_master,
    sdo_write,
    statusword,
)  # fmt: skip

CLOSING = 40


@pytest.fixture
def bench() -> Iterator[Bench]:
    opened = Bench(drives=(replace(DRIVE, brake_s=CLOSING * 1e-3),))
    yield opened
    opened.close()


def held(bench: Bench) -> tuple[bool, bool]:
    """Whether the motor has torque, and whether its brake grips, in the last block."""
    assert isinstance(bench.physics, Rigid)
    last = bench.physics.history["X1"][-1]
    return last.enabled, last.braked


def state(bench: Bench, ticks: int) -> int:
    return statusword(of(bench.step(ticks), 0x185)[-1]) & 0x6F


def test_it_grips_until_the_drive_is_enabled(bench: Bench) -> None:
    bench.step(10)
    assert held(bench) == (False, True)
    bench.enable()
    assert held(bench) == (True, False)


@pytest.mark.parametrize(("controlword", "left_for"), [(0x07, 0x23), (0x06, 0x21)])
def test_disabled_at_rest_the_torque_stays_until_it_grips(
    bench: Bench, controlword: int, left_for: int
) -> None:
    bench.enable()
    bench.command(controlword)
    assert state(bench, CLOSING - 10) == 0x27
    assert held(bench) == (True, False)
    assert state(bench, 20) == left_for
    assert held(bench) == (False, True)


def test_without_voltage_nothing_holds_while_it_closes(bench: Bench) -> None:
    bench.enable()
    bench.command(0x00)
    assert state(bench, CLOSING - 10) & 0x4F == 0x40
    assert held(bench) == (False, False)
    bench.step(20)
    assert held(bench) == (False, True)


def test_a_quick_stop_ends_with_the_brake_and_then_without_torque(bench: Bench) -> None:
    bench.enable()
    bench.command(0x1F, STEP_COUNTS)
    bench.step(45)
    bench.command(0x02)
    assert state(bench, 25) == 0x07
    assert held(bench)[0]
    assert state(bench, 60) & 0x4F == 0x40
    assert held(bench) == (False, True)


def test_enabled_again_while_it_closes_it_opens(bench: Bench) -> None:
    bench.enable()
    bench.command(0x07)
    bench.step(CLOSING // 2)
    bench.command(0x0F)
    assert state(bench, 2 * CLOSING) == 0x27
    assert held(bench) == (True, False)


def test_a_drive_answers_though_its_axis_rolls_away() -> None:
    """On a slope without a brake the axis never comes to rest: the machine must not wait for it in silence."""
    name = channel()
    machine = SimulatedMachine([name], [replace(DRIVE, bus=name)], [], Scripted(motor_speed=50.0), seed=1)
    with raw_master(machine, name) as master:
        for _ in range(3):
            master.send(sdo_write(0x1017, 0, 100, 2))
            assert master.wait(lambda frame: frame[1] == 0x585, timeout=10.0)[2][0] == 0x60
