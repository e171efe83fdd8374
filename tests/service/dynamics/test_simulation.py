"""simulate and Plant: blocks, coasting, determinism, coupling, truth and speed."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.sim.physics import Physics, Setpoint
from service.dynamics.effects.carriage import ConstantForce
from service.dynamics.effects.effect import Measured
from service.dynamics.parameters import AxisParameters, Friction, GantryParameters, Machine
from service.dynamics.propagation import ContactChange
from service.dynamics.simulation import DT, Plant, gap_crossings, nominal_motion, simulate, ten_steps

FloatArray = NDArray[np.float64]


@dataclass
class Asked:
    """A set-point as a simulated drive gives it."""

    position: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    enabled: bool = True
    braked: bool = False


def asked(axis: AxisParameters, t: FloatArray, count: int = 2, enabled: bool = True) -> Asked:
    r = 1 / axis.transmission
    return Asked(*(value * r for value in nominal_motion(t, ten_steps(rest=0.05, count=count))), enabled)


def channels(measured: Measured) -> FloatArray:
    return np.array([getattr(measured, field.name) for field in fields(Measured)])


def gantry() -> Machine:
    axes = {"X1": AxisParameters(M=300.0, b=40e-6), "X2": AxisParameters(M=350.0, b=110e-6, UL=30e-6)}
    return Machine(axes, (GantryParameters("X1", "X2", offset=10e-6),))


def test_ten_steps_go_to_and_fro_and_rest_in_between() -> None:
    moves = ten_steps()
    assert [m.direction for m in moves] == [1, -1] * 5
    assert all(b.start - a.end == pytest.approx(0.35) for a, b in pairwise(moves))
    x, v, _ = nominal_motion(np.array([m.end for m in moves]), moves)
    np.testing.assert_allclose(x, [4e-3, 0.0] * 5, atol=1e-15)
    np.testing.assert_allclose(v, 0.0, atol=1e-15)


def test_the_axis_follows_the_steps_and_settles_despite_friction() -> None:
    p = AxisParameters()
    run = simulate(p, ten_steps())
    m = run.axes["X1"].measured
    for k, move in enumerate(run.moves):
        rest = (run.time > move.end + 0.25) & (run.time < move.end + 0.34)
        target = 4e-3 if k % 2 == 0 else 0.0
        assert np.abs(m.motor_position[rest] * p.transmission - target).max() < 2e-6
        assert np.abs(m.motor_speed[rest]).max() * p.transmission < 1e-4
        assert np.all(m.load_speed[rest] == 0.0)
    assert np.abs(m.motor_speed).max() * p.transmission == pytest.approx(92.8e-3, rel=0.05)


@pytest.mark.parametrize("b", [10e-6, 50e-6, 200e-6])
def test_each_move_crosses_the_gap_once_and_the_flanks_really_are_b_apart(b: float) -> None:
    """Between t1 and t2 the motor goes b further than the load, but for the wind-up that friction leaves."""
    p = AxisParameters(b=b)
    run = simulate(p, ten_steps(count=4))
    m = run.axes["X1"].measured
    relative = m.motor_position * p.transmission - m.load_position
    for move in run.moves:
        crossing = run.axes["X1"].diagnostic_crossing(move)
        assert crossing is not None
        assert crossing.before == move.direction
        assert move.start + move.duration / 2 < crossing.t1 < crossing.t2 < move.end
        change = np.interp([crossing.t1, crossing.t2], run.time, relative) @ [1, -1] * move.direction
        windup = 60.0 / 7e7 + 13e-3 * DT  # shafts' friction over the chain's stiffness; the grid
        braking = 2.5 * 30.0 / 7e7  # gearbox and pinion brake with the motor
        assert change == pytest.approx(b, abs=windup + braking)


def test_without_a_gap_nothing_is_crossed() -> None:
    run = simulate(AxisParameters(b=0.0), ten_steps(count=2))
    longest = max((c.t2 - c.t1 for c in run.axes["X1"].crossings), default=0.0)
    assert longest < 1e-3


def test_blocks_of_any_length_give_the_same_bytes() -> None:
    machine = Machine({**gantry().axes, "Y": AxisParameters()}, gantry().gantries)
    n = 8 * 280
    t = DT * np.arange(1, n + 1)
    whole = Plant(machine).advance(n * DT, [asked(p, t) for p in machine.axes.values()])
    plant = Plant(machine)
    parts = []
    for start in range(0, n, 8):
        block = t[start : start + 8]
        parts.append(plant.advance(8 * DT, [asked(p, block) for p in machine.axes.values()]))
    for k in range(3):
        joined = np.concatenate([channels(part[k]) for part in parts], axis=1)
        assert joined.tobytes() == channels(whole[k]).tobytes()


def test_two_runs_are_equal_byte_for_byte() -> None:
    first, second = (simulate(gantry(), ten_steps(count=2)) for _ in range(2))
    for name in ("X1", "X2"):
        one, other = first.axes[name], second.axes[name]
        assert channels(one.measured).tobytes() == channels(other.measured).tobytes()
        assert one.crossings == other.crossings


def test_an_axis_beside_a_gantry_moves_as_if_it_were_alone() -> None:
    y = AxisParameters(b=70e-6)
    together = simulate(Machine({**gantry().axes, "Y": y}, gantry().gantries), ten_steps(count=1))
    alone = simulate(Machine({"Y": y}), ten_steps(count=1))
    assert channels(together.axes["Y"].measured).tobytes() == channels(alone.axes["Y"].measured).tobytes()
    assert list(together.axes) == ["X1", "X2", "Y"]


def test_a_soft_bridge_leaves_the_axes_alone_and_a_stiff_one_ties_the_carriages() -> None:
    axes = gantry().axes
    moves = ten_steps(count=1)
    alone = simulate(axes["X1"], moves).axes["X1"].measured

    def coupled(k: float) -> list[Measured]:
        run = simulate(Machine(axes, (GantryParameters("X1", "X2", k=k, d=0.0),)), moves)
        return [run.axes[name].measured for name in ("X1", "X2")]

    soft, _ = coupled(1e-3)
    np.testing.assert_allclose(soft.load_position, alone.load_position, atol=1e-9)
    first, second = coupled(5e9)
    assert np.abs(first.load_position - second.load_position).max() < 2e-6
    assert np.abs(alone.load_position - first.load_position).max() > 5e-6


def test_exchanging_the_two_axes_of_a_gantry_exchanges_their_motion() -> None:
    axes = gantry().axes
    there = simulate(Machine(axes, (GantryParameters("X1", "X2", offset=10e-6),)), ten_steps(count=1))
    back = simulate(Machine(axes, (GantryParameters("X2", "X1", offset=-10e-6),)), ten_steps(count=1))
    for name in axes:
        np.testing.assert_allclose(
            there.axes[name].measured.load_speed, back.axes[name].measured.load_speed, atol=1e-9
        )


def test_a_disabled_axis_coasts_to_a_stop_and_an_enabled_one_picks_it_up() -> None:
    p = AxisParameters()
    plant = Plant(p)
    n = round(0.09 / DT)
    t = DT * np.arange(1, n + 1)
    (moving,) = plant.advance(n * DT, [asked(p, t)])
    assert moving.motor_speed[-1] * p.transmission > 0.05
    nothing = np.zeros(round(0.4 / DT))
    (coasting,) = plant.advance(0.4, [Asked(nothing, nothing, nothing, enabled=False)])
    late = DT * np.arange(1, len(nothing) + 1) > 10 * p.ppi.current_loop_time
    assert np.abs(coasting.motor_torque[late]).max() < 1e-3
    assert np.all(coasting.load_speed[-10:] == 0.0)
    assert np.all(coasting.motor_speed[-10:] == 0.0)
    way = coasting.load_position[-1] - moving.load_position[-1]
    energy = p.inertia / p.transmission**2 * moving.load_speed[-1] ** 2 / 2
    assert 0.3 * energy / 300.0 < way < energy / 120.0
    here = np.full(80, coasting.motor_position[-1])
    (held,) = plant.advance(80 * DT, [Asked(here, nothing[:80], nothing[:80])])
    assert np.abs(held.motor_position - here).max() < 1e-9


def test_a_weight_is_held_by_the_drive_and_falls_when_it_is_disabled() -> None:
    p = AxisParameters()
    plant = Plant(p, {"X1": [ConstantForce(-2000.0)]})
    still = np.zeros(8000)
    (held,) = plant.advance(1.0, [Asked(still, still, still)])
    assert abs(held.motor_position[-1] * p.transmission) < 1e-6
    assert held.motor_torque[-1] == pytest.approx(2000.0 * p.transmission, abs=0.6)
    (falling,) = plant.advance(0.1, [Asked(still[:800], still[:800], still[:800], enabled=False)])
    assert falling.load_speed[-1] < -0.05
    (caught,) = plant.advance(1.0, [Asked(still, still, still, enabled=False, braked=True)])
    assert abs(caught.load_speed[-1]) < 1e-6, "20 N m of brake hold 2000 N at 3 mm/rad, which are 6 N m"


def test_the_plant_is_what_the_simulated_machine_asks_for() -> None:
    """Every axis of a gantry and a single one in one machine, one of them disabled, under the drivers' set-points."""
    machine = Machine({**gantry().axes, "Y": AxisParameters()}, gantry().gantries)
    physics: Physics = Plant(machine)
    zero, one = np.zeros(8), np.full(8, 0.1)
    asked_for = [
        Setpoint(True, zero, zero, zero),
        Setpoint(True, one, zero, zero),
        Setpoint(False, one, zero, zero),
    ]
    blocks = physics.advance(1e-3, asked_for)
    assert list(physics.axes) == ["X1", "X2", "Y"]
    assert physics.dt == pytest.approx(1e-3 / 8)
    for block in blocks:
        for channel in ("motor_position", "motor_speed", "motor_torque", "load_acceleration"):
            values = getattr(block, channel)
            assert values.shape == (8,)
            assert values.dtype == np.float64
    assert blocks[1].motor_torque[-1] > 0.5
    assert np.all(blocks[2].motor_torque == 0.0)


def test_wrong_blocks_and_unknown_axes_are_refused() -> None:
    plant = Plant(AxisParameters())
    still = Asked(*np.zeros((3, 8)))
    with pytest.raises(ValueError, match="1 axes need as many set-points, got 2"):
        plant.advance(8 * DT, [still, still])
    with pytest.raises(ValueError, match="whole number of sub-steps"):
        plant.advance(8.5 * DT, [still])
    with pytest.raises(ValueError, match="whole number of sub-steps"):
        plant.advance(0.0, [still])
    with pytest.raises(ValueError, match=r"effects for \['Z'\], the machine has X1"):
        Plant(AxisParameters(), {"Z": ()})
    with pytest.raises(ValueError, match="at least one move"):
        simulate(AxisParameters(), ())


def test_crossings_are_paired_across_bounces() -> None:
    def change(time: float, before: int, after: int) -> ContactChange:
        return ContactChange(time, "X1", before, after)

    changes = [
        change(0.1, 0, 1),
        change(0.2, 1, 0),
        change(0.3, 0, 1),
        change(0.4, 1, 0),
        change(0.5, 0, -1),
        change(0.6, -1, 0),
        change(0.7, 0, -1),
    ]
    assert gap_crossings(changes) == ((0.4, 0.5, 1),)


def test_a_worn_guide_makes_the_flanks_part_later() -> None:
    """With more friction the carriage brakes itself: the drive must brake harder before the flanks part."""
    delays = []
    for coulomb in (20.0, 120.0, 240.0):
        p = replace(AxisParameters(), friction_mas=Friction(coulomb, 300.0))
        run = simulate(p, ten_steps(count=1))
        crossing = run.axes["X1"].diagnostic_crossing(run.moves[0])
        assert crossing is not None
        delays.append(crossing.t1 - run.moves[0].start)
    assert delays[0] < delays[1] < delays[2]
