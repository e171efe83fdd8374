"""The generator against mechanics worked out by hand, against itself at half the step, and against its seed."""

from __future__ import annotations

import ast
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.undeclared import draw, sensors
from tests.undeclared.effects import CLEAN, LIBRARY, OUTSIDE, named
from tests.undeclared.faults import weak_moves
from tests.undeclared.generate import Campaign, cases, generate
from tests.undeclared.machine import TICK, Array, Lanes, Plant, Steps, Traces, setpoint, simulate

ONE = Steps(length=4e-3, jerk=200.0, count=1, rest=0.02)


def machines(count: int, seed: int = 7) -> list[draw.Machine]:
    rng = np.random.default_rng(seed)
    return [draw.axis(rng) for _ in range(count)]


def release_and_impact(traces: Traces, lane: int, m: Mapping[str, float]) -> tuple[float, float]:
    """Return the times [s] between which the flank crosses the gap while the axis brakes (first step, forwards)."""
    flank = traces.flank[:, lane]
    upper, lower = m["backlash"] * (1 - m["flank"]), -m["backlash"] * m["flank"]
    times = np.arange(flank.size) * TICK
    touching = np.flatnonzero(traces.load_speed[:, lane] >= traces.load_speed[:, lane].max() - 1e-12)[0]
    impact = touching + np.flatnonzero(flank[touching:] <= lower)[0]
    release = np.flatnonzero(flank[:impact] >= upper)[-1]
    edges = []
    for k, level in ((release, upper), (impact - 1, lower)):
        share = (flank[k] - level) / (flank[k] - flank[k + 1])
        edges.append(times[k] + share * TICK)
    return edges[0], edges[1]


def test_setpoint_is_the_step_that_was_asked_for() -> None:
    steps = Steps(length=4e-3, jerk=200.0, count=2)
    times = np.linspace(0.0, steps.end, 200_001)
    x, v, a = setpoint(steps, times)
    T = (32 * 4e-3 / 200.0) ** (1 / 3)
    assert steps.period == pytest.approx(0.0862, abs=4e-4)
    assert a.max() == pytest.approx(200.0 * T / 4, rel=1e-3)
    assert v.max() == pytest.approx(0.0928, abs=1e-4)
    assert np.interp(steps.starts[0] + T + 0.01, times, x) == pytest.approx(4e-3)
    assert x[-1] == pytest.approx(0.0, abs=1e-12)
    assert np.abs(np.gradient(x, times) - v).max() < 1e-4
    assert np.abs(np.gradient(v, times) - a).max() < 1e-2
    jerk = np.gradient(a, times)
    assert np.abs(jerk).max() < 201.0


def test_half_the_step_gives_the_same_recording() -> None:
    lanes = machines(5) + draw.gantry(np.random.default_rng(3))
    moves = [ONE] * len(lanes)
    coarse, fine = simulate(lanes, moves), simulate(lanes, moves, substeps=20)
    difference = np.diff(coarse.load_speed[::2] - fine.load_speed[::2], axis=0) / (2 * TICK)
    assert np.sqrt(np.mean(difference**2, axis=0)).max() < 1e-3
    for lane, m in enumerate(lanes[:5]):
        before, after = release_and_impact(coarse, lane, m), release_and_impact(fine, lane, m)
        assert np.abs(np.subtract(before, after)).max() < 2e-6


def test_in_the_gap_the_carriage_feels_nothing_but_its_friction() -> None:
    """Eq. (8), and the flank travels exactly the gap between release and impact."""
    lanes = [m | {"backlash": 1.2e-4} for m in machines(3)]
    traces = simulate(lanes, [ONE] * 3)
    times = np.arange(len(traces.flank)) * TICK
    for lane, m in enumerate(lanes):
        t1, t2 = release_and_impact(traces, lane, m)
        assert 0.002 < t2 - t1 < 0.05
        inside = (times > t1 + TICK) & (times < t2 - TICK)
        v = traces.load_speed[:, lane]
        slope = np.gradient(v, TICK)[inside][1:-1]
        friction = (m["fc"] + m["fv"] * v[inside][1:-1]) / m["m_load"]
        assert np.abs(slope + friction).max() < 2e-2 * friction.max()
        travel = np.ptp(np.interp([t1, t2], times, traces.flank[:, lane]))
        assert travel == pytest.approx(1.2e-4, rel=0.01)


def test_without_friction_the_motors_impulse_is_the_momentum() -> None:
    frictionless = dict.fromkeys([f"f{k}{b}" for k in "cv" for b in ("", "_motor", "_gear", "_pinion")], 0.0)
    pair = [m | frictionless for m in draw.gantry(np.random.default_rng(11))]
    plant = Plant(Lanes(pair), TICK / 10)
    force = np.array([900.0, 700.0])
    for k in range(200):
        plant.advance(10, k * TICK, force)
    speed = plant.v + 0.5 * plant.h * plant.a
    assert np.sum(plant.mass * speed) == pytest.approx(1600.0 * 200 * TICK, rel=1e-3)


def test_coasting_axis_stops_where_coulomb_friction_says() -> None:
    """All friction Coulomb: ½ m v² = F x, for the chain as one body."""
    (m,) = machines(1)
    m = m | {f"fv{b}": 0.0 for b in ("", "_motor", "_gear", "_pinion")} | {"backlash": 0.0, "v_smooth": 1e-4}
    plant = Plant(Lanes([m]), TICK / 10)
    plant.v[:] = 0.05
    total = sum(m[k] for k in ("m_motor", "m_gear", "m_pinion", "m_load"))
    friction = sum(m[k] for k in ("fc_motor", "fc_gear", "fc_pinion", "fc"))
    for k in range(int(1.3 * 0.05 * total / friction / TICK)):
        plant.advance(10, k * TICK, np.zeros(1))
    assert np.abs(plant.v).max() < 1e-4
    assert np.mean(plant.x[:, 0] * plant.mass[:, 0]) * 4 / total == pytest.approx(
        0.5 * total * 0.05**2 / friction, rel=0.01
    )


def test_a_flank_pushes_and_never_pulls() -> None:
    (m,) = machines(1)
    plant = Plant(Lanes([m] * 4), TICK / 10)
    half = m["backlash"] / 2
    s = np.array([half + 1e-6, half + 1e-9, 0.0, -half - 1e-6])
    force = plant._flank(s, np.array([0.0, -0.5, 0.1, 0.0]))
    assert force == pytest.approx([m["kp"] * 1e-6, 0.0, 0.0, -m["kp"] * 1e-6])


def test_terms_of_one_lane_leave_the_others_alone() -> None:
    """Every planted effect in a lane of its own beside a clean machine: only that one moves as if alone."""
    rng = np.random.default_rng(5)
    (clean,) = machines(1, seed=8)
    names = [n for n in {**LIBRARY, **OUTSIDE} if named(n)(np.random.default_rng(1), clean)[0]]
    lanes = [clean] + [clean | named(n)(rng, clean)[0] | {"t_change": 0.01} for n in names]
    short = Steps(length=1e-3, jerk=200.0, count=1, rest=0.02)
    together, alone = simulate(lanes, [short] * len(lanes), 4), simulate([clean], [short], 4)
    assert np.abs(together.load_speed[:, 0] - alone.load_speed[:, 0]).max() < 1e-9
    changed = np.abs(together.load_speed - alone.load_speed).max(axis=0)
    quiet = [n for n, c in zip(names, changed[1:], strict=True) if c < 1e-5]
    assert not quiet


def ramp(acceleration: float, seconds: float = 1.0) -> Traces:
    """Traces of one lane that speeds up by a constant jerk to `acceleration` [m/s²] at the end."""
    t = np.arange(round(seconds / TICK) + 1) * TICK
    speed = (0.5 * acceleration * t**2 / seconds)[:, None]
    return Traces(0 * speed, speed, 0 * speed, 0 * speed, speed, 0 * speed)


QUIET = {"speed_hz": 1000.0, "acceleration_hz": 2000.0, "noise": 0.0, "speed_noise": 0.0, "torque_noise": 0.0}


def accelerometer(**change: float) -> tuple[Array, Array]:
    rng = np.random.default_rng(0)
    return sensors.record(rng, ramp(4.0), 0, 1.0, {"transmission": 0.003}, QUIET | change)["acceleration"]


def test_a_sample_is_the_mean_about_its_stamp() -> None:
    t, a = accelerometer()
    assert np.abs(a - 4.0 * t)[2:-2].max() <= sensors.ACCELERATION_LSB
    t, a = accelerometer(latency=0.01)
    assert np.abs(a - 4.0 * (t - 0.01))[50:-2].max() <= sensors.ACCELERATION_LSB
    t, a = accelerometer(gain=0.1, bias=0.2)
    assert np.abs(a - 4.4 * t - 0.2)[2:-2].max() <= sensors.ACCELERATION_LSB
    t, a = accelerometer(bent_even=0.02, bent_odd=-0.003)
    assert np.abs(a - 4.0 * t - 0.02 * (4 * t) ** 2 + 0.003 * (4 * t) ** 3)[2:-2].max() < 3e-3
    t, a = accelerometer(jump=2e-3, jump_seed=3.0)
    late = t - a / 4.0
    assert 0.0 < np.median(late[20:1700]) < 2e-3 and np.ptp(late[20:1700]) < 1e-3
    assert abs(np.median(late[1820:]) - np.median(late[20:1700])) > 1e-4


def test_a_low_pass_follows_a_ramp_late() -> None:
    """By 2·zeta/omega."""
    t, a = accelerometer(slow_hz=50.0, slow_zeta=0.7)
    late = 2 * 0.7 / (2 * np.pi * 50.0)
    assert np.abs(a - 4.0 * (t - late))[200:-2].max() < 5e-3


def test_lost_frames_leave_their_stamps_out() -> None:
    whole = accelerometer()[0].size
    t, _ = accelerometer(lost=0.05, lost_by=3.0)
    assert 0.02 < 1 - t.size / whole < 0.09
    holes = np.round(np.diff(t)[np.diff(t) > 6e-4] * 2000) - 1
    assert np.all(holes % 3 == 0)


def test_weak_moves_never_part_the_flanks() -> None:
    for name in ("too_slow", "too_short"):
        (case,) = cases(Campaign(f"fault-{name}", 1, 4), 0)
        (m,) = case.machines
        steps = weak_moves(name, m, Steps(length=case.steps.length, jerk=case.steps.jerk, count=1, rest=0.02))
        traces = simulate([m], [steps], 4)
        times = np.arange(len(traces.flank)) * TICK
        moving = (times > steps.starts[0] + 0.5 * steps.period) & (times < steps.starts[0] + steps.period)
        assert traces.flank[moving, 0].min() > -m["backlash"] * m["flank"] + 0.3 * m["backlash"]


def test_the_same_seed_gives_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.undeclared.draw.Steps", lambda length, jerk: Steps(length, jerk, 1, 0.02))
    for seed, folder in ((5, "a"), (5, "b"), (6, "c")):
        generate(Campaign("gantry", 1, seed), tmp_path / folder)
    written = [(tmp_path / folder / "gantry-000.parquet").read_bytes() for folder in "abc"]
    assert written[0] == written[1] != written[2]
    table = pq.read_table(tmp_path / "a" / "gantry-000.parquet")
    about = json.loads(table.schema.metadata[b"capture"])
    assert table.schema.names == ["time_s", "axis", "channel", "value"]
    assert about["gantry"] == [["X1", "X2"]] and len(about["moves"]) == 1
    truth = json.loads((tmp_path / "a" / "gantry-000-truth.json").read_text())
    assert truth["moves_that_cross"] == {"X1": 1, "X2": 1}
    assert set(truth["backlash_m"]) == {"X1", "X2"} and truth["effect"] == "none"


def test_pairs_have_good_sensors_unless_any_are_asked_for() -> None:
    def drawn(any_sensors: bool) -> list[dict[str, float]]:
        campaign = Campaign("none", 12, 3, pairs=True, any_sensors=any_sensors)
        return [dict(case.sensor) for index in range(12) for case in cases(campaign, index)]

    assert {s["speed_hz"] for s in drawn(False)} == {1000.0} and not any(s["lost"] for s in drawn(False))
    assert {s["speed_hz"] for s in drawn(True)} == {500.0, 1000.0} and any(s["lost"] for s in drawn(True))


def test_nothing_is_shared_with_the_product() -> None:
    """No import of the code under test: an error there must not cancel itself here."""
    for path in Path(__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not [n for n in names if n.split(".")[0] in ("service", "drivers")], path


def test_every_effect_of_the_issue_is_there() -> None:
    assert set(LIBRARY) | {"gantry_coupling"} >= {
        *(
            "gantry_coupling",
            "machine_body_mode",
            "hung_mass_mode",
            "stribeck_friction",
            "asymmetric_friction",
        ),
        *("constant_force", "position_dependent_force", "gearbox_clearance", "position_dependent_backlash"),
        *("sensor_latency", "sensor_gain", "sensor_bias", "speed_filter", "contact_nonlinearity"),
        "transmission_ripple",
    }
    assert len(OUTSIDE) >= 5
    assert not set(OUTSIDE) & (set(LIBRARY) | set(CLEAN))
