"""The event-driven propagation against closed forms: oscillation, friction, sticking, impact, gap, energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from service.dynamics.axis import axis_mechanism
from service.dynamics.forces import Contact, flank_force
from service.dynamics.gantry import gantry_mechanism
from service.dynamics.mechanism import Mechanism, free_bodies
from service.dynamics.modes import Key
from service.dynamics.parameters import AxisParameters, Friction, GantryParameters
from service.dynamics.propagation import Propagator

FloatArray = NDArray[np.float64]

DT = 1.25e-4
TICK = DT / 2**14  # to which an event is located


def bodies(*masses: float) -> Mechanism:
    return free_bodies(tuple("abc"[: len(masses)]), np.array(masses))


def started(m: Mechanism, q: list[float], v: list[float]) -> Propagator:
    propagator = Propagator(m, DT)
    propagator.place(np.array(q), np.array(v))
    return propagator


def run(propagator: Propagator, n: int) -> tuple[FloatArray, FloatArray]:
    """Positions and speeds, (n, bodies), at the ends of n sub-steps."""
    q, v = [], []
    for _ in range(n):
        propagator.step()
        q.append(propagator.w[propagator.layout.q].copy())
        v.append(propagator.w[propagator.layout.v].copy())
    return np.array(q), np.array(v)


def colliding(d: float, k: float = 2e8, b: float = 50e-6) -> Mechanism:
    """Two free bodies of 3 and 400 kg with a gap between them."""
    pair = bodies(3.0, 400.0)
    return pair.with_contact(Contact("gap", pair.row("a", "b"), k, d, b / 2, -b / 2))


def test_damped_free_oscillation_follows_its_closed_form() -> None:
    m, k, d, x0 = 5.0, 2e7, 800.0, 1e-4
    body = bodies(m)
    n = 2000
    q, _ = run(started(body.with_element(body.row("a"), k, d), [x0], [0.0]), n)
    t = DT * np.arange(1, n + 1)
    delta = d / (2 * m)
    omega = np.sqrt(k / m - delta**2)
    x = x0 * np.exp(-delta * t) * (np.cos(omega * t) + delta / omega * np.sin(omega * t))
    np.testing.assert_allclose(q[:, 0], x, atol=1e-10 * x0)


def test_coulomb_friction_takes_the_same_from_each_swing_and_holds_in_the_end() -> None:
    """Each half swing loses 2 F_c/k; the body stays where the spring is weaker than the friction."""
    m, k, F_c = 5.0, 2e6, 30.0
    loss = 2 * F_c / k
    x0 = 5.3 * loss
    body = bodies(m)
    oscillator = body.with_element(body.row("a"), k).with_sliding("a", body.row("a"), F_c)
    half = np.pi * np.sqrt(m / k)
    n = int(8 * half / DT)
    q, v = run(started(oscillator, [x0], [0.0]), n)
    t = DT * np.arange(1, n + 1)
    swings = np.minimum((t / half).astype(int), 5)
    centre = np.where(swings % 2 == 0, 1, -1) * F_c / k
    amplitude = x0 - F_c / k - swings * loss
    x = centre + amplitude * np.where(swings % 2 == 0, 1, -1) * np.cos(np.pi * (t / half - swings))
    moving = t < 5 * half
    np.testing.assert_allclose(q[moving, 0], x[moving], atol=1e-9)
    np.testing.assert_array_equal(v[~moving, 0][1:], 0.0)
    assert q[-1, 0] == pytest.approx(-(x0 - 5 * loss), abs=1e-9)


def test_a_sliding_body_stops_where_its_energy_is_spent_and_never_creeps() -> None:
    m, F_c, v0 = 400.0, 120.0, 0.05
    body = bodies(m)
    q, v = run(started(body.with_sliding("a", body.row("a"), F_c), [0.0], [v0]), 3000)
    assert q[-1, 0] == pytest.approx(m * v0**2 / (2 * F_c), rel=1e-9)
    stop = m * v0 / F_c
    standing = DT * np.arange(1, 3001) > stop + DT
    assert np.ptp(q[standing]) == 0.0
    assert np.all(v[standing] == 0.0)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_force_below_the_level_moves_nothing_and_one_above_moves_by_the_difference(
    direction: float,
) -> None:
    m, F_c = 400.0, 120.0
    body = bodies(m)
    propagator = Propagator(body.with_sliding("a", body.row("a"), F_c), DT)
    propagator.w[propagator.layout.F] = 0.9999 * F_c * direction
    q, _ = run(propagator, 800)
    assert np.all(q == 0.0)
    propagator.w[propagator.layout.F] = 1.5 * F_c * direction
    q, _ = run(propagator, 800)
    assert q[-1, 0] == pytest.approx(direction * 0.5 * F_c / m * (800 * DT) ** 2 / 2, rel=1e-6)


def test_levels_of_the_two_directions_are_kept_apart() -> None:
    body = bodies(1.0)
    propagator = Propagator(body.with_sliding("a", body.row("a"), 10.0), DT)
    propagator.w[propagator.layout.down] = 4.0
    propagator.w[propagator.layout.F] = 8.0
    assert np.all(run(propagator, 10)[0] == 0.0)
    propagator.w[propagator.layout.F] = -8.0
    q, _ = run(propagator, 80)
    assert q[-1, 0] == pytest.approx(-4.0 * (80 * DT) ** 2 / 2, rel=1e-5)  # it starts within a tick


def test_undamped_impact_keeps_momentum_and_energy_and_lasts_half_a_period() -> None:
    m1, m2, k, b, v0 = 3.0, 400.0, 2e8, 50e-6, 0.013
    propagator = started(colliding(d=0.0), [0.0, 0.0], [v0, 0.0])
    _, v = run(propagator, 200)
    touch, part, *_ = propagator.changes
    reduced = m1 * m2 / (m1 + m2)
    assert touch.time == pytest.approx(b / 2 / v0, abs=TICK)
    assert (touch.before, touch.after, part.before, part.after) == (0, 1, 1, 0)
    assert part.time - touch.time == pytest.approx(np.pi * np.sqrt(reduced / k), abs=2 * TICK)
    after = v[int(part.time / DT) + 1]
    assert after[0] == pytest.approx(v0 * (m1 - m2) / (m1 + m2), rel=1e-6)
    assert after[1] == pytest.approx(v0 * 2 * m1 / (m1 + m2), rel=1e-6)


@pytest.mark.parametrize("zeta", [0.05, 0.2, 0.5, 0.8])
def test_damped_impact_has_the_known_coefficient_of_restitution(zeta: float) -> None:
    """The flanks part when k·x + d·ẋ = 0, at the phase π − 2 asin ζ: no adhesion."""
    m1, m2, k, v0 = 3.0, 400.0, 2e8, 0.013
    reduced = m1 * m2 / (m1 + m2)
    omega = np.sqrt(k / reduced)
    propagator = started(colliding(d=2 * zeta * omega * reduced), [0.0, 0.0], [v0, 0.0])
    _, v = run(propagator, 200)
    touch, part, *_ = propagator.changes
    phase, root = np.pi - 2 * np.arcsin(zeta), np.sqrt(1 - zeta**2)
    assert part.time - touch.time == pytest.approx(phase / (omega * root), abs=2 * TICK)
    restitution = -np.exp(-zeta / root * phase) * (np.cos(phase) - zeta / root * np.sin(phase))
    after = v[int(part.time / DT) + 1]
    assert (after[1] - after[0]) / v0 == pytest.approx(restitution, rel=1e-4)


def test_in_the_gap_the_load_obeys_equation_8() -> None:
    """M·ẍ = −F_fric: with friction a parabola, whatever the pinion does."""
    M, F_c, v0 = 400.0, 120.0, 0.09
    pair = colliding(d=2e4, b=1e-3)
    propagator = started(pair.with_sliding("b", pair.row("b"), F_c), [0.0, 0.0], [v0, v0])
    propagator.w[propagator.layout.F] = [-3.0 * 2.0, 0.0]
    q, v = run(propagator, 100)
    assert not propagator.changes
    t = DT * np.arange(1, 101)
    np.testing.assert_allclose(q[:, 1], v0 * t - F_c / M * t**2 / 2, rtol=1e-12)
    np.testing.assert_allclose(v[:, 1], v0 - F_c / M * t, rtol=1e-12)


@pytest.mark.parametrize("b", [10e-6, 50e-6, 100e-6, 200e-6])
def test_idealised_gap_time(b: float) -> None:
    """A pinion that brakes with jerk j crosses the gap in (6 b/j)^(1/3) when the load keeps its speed."""
    j, m1, v0 = 200.0, 3.0, 0.0928
    propagator = started(colliding(d=2e4, b=b), [b / 2, 0.0], [v0, v0])
    while not propagator.changes:
        propagator.w[propagator.layout.F] = [-m1 * j * (propagator.time + DT / 2), 0.0]
        propagator.step()
    (touch,) = propagator.changes
    assert touch.after == -1
    # A force held at its middle value is j·DT³/12 of way ahead in each sub-step: T·j·DT²/12 at the relative speed
    # j·T²/2 in all.
    T = (6 * b / j) ** (1 / 3)
    assert touch.time == pytest.approx(T, abs=1.1 * DT**2 / (6 * T))


def test_work_of_the_motor_is_found_again_in_motion_springs_and_heat() -> None:
    """Energy balance of a whole axis, through sticking, sliding, release and impact, to the sums' own error."""
    p = AxisParameters(b=60e-6)
    m = axis_mechanism("X1", p)
    dt = 5e-6
    propagator = Propagator(m, dt)
    layout, contact = propagator.layout, m.contacts[0]
    rows, torque = [], []
    for n in range(16000):
        propagator.w[layout.command] = 8.0 * np.sin(2 * np.pi * 14.0 * n * dt)
        propagator.step()
        rows.append(propagator.w.copy())
        torque.append(propagator.w[layout.T][0])
    w = np.array(rows)
    q, v = w[:, layout.q], w[:, layout.v]
    x_rp, v_rp = q @ contact.row, v @ contact.row
    power_in = np.array(torque) / p.transmission * v[:, 0]
    coulomb = sum(s.level * np.abs(v @ s.row) for s in m.slidings)
    viscous = sum(s.viscous * (v @ s.row) ** 2 for s in m.slidings) + np.einsum("ni,ij,nj->n", v, m.D, v)
    into_contact = flank_force(contact, x_rp, v_rp) * v_rp
    balance = np.cumsum(power_in - coulomb - viscous - into_contact) * dt
    stored = (v**2 @ m.M + np.einsum("ni,ij,nj->n", q, m.K, q)) / 2
    assert {(c.before, c.after) for c in propagator.changes} == {(0, 1), (1, 0), (0, -1), (-1, 0)}
    assert stored.max() > 1.0
    np.testing.assert_allclose(stored, balance, atol=2e-3 * stored.max())


def test_events_do_not_depend_on_the_sub_step() -> None:
    """A motor torque that is switched on and off at multiples of 1 ms gives the same crossing for every dt."""
    m = axis_mechanism("X1", AxisParameters(b=80e-6))
    times = []
    for dt in (2.5e-4, 1.25e-4, 2e-5):
        propagator = Propagator(m, dt)
        for n in range(round(0.05 / dt)):
            propagator.w[propagator.layout.command] = 5.0 if n * dt < 0.02 - dt / 2 else -5.0
            propagator.step()
        times.append([change.time for change in propagator.changes])
    np.testing.assert_allclose(times[0], times[2], atol=1e-7)
    np.testing.assert_allclose(times[1], times[2], atol=1e-7)


def test_a_mechanism_takes_over_where_another_stood() -> None:
    body = bodies(400.0)
    before = started(body.with_sliding("a", body.row("a"), 120.0), [0.7], [0.0])
    more = body.with_sliding("a", body.row("a"), 120.0).with_body("b", 10.0)
    more = more.with_element(more.row("b", "a"), k=1e5, d=10.0)
    after = Propagator(more, DT)
    after.take_over(before)
    q, _ = run(after, 100)
    np.testing.assert_allclose(q, 0.7, rtol=1e-12)


def test_friction_at_every_body_is_as_given_at_its_shaft() -> None:
    """A torque just below what motor, gearbox and pinion hold together moves the motor by the wind-up only."""
    p = replace(
        AxisParameters(), friction_mot=Friction(0.2), friction_g=Friction(0.3), friction_p=Friction(0.5)
    )
    holding = 0.2 + 0.3 + 0.5 / p.i
    for torque, moves in ((0.99 * holding, False), (1.01 * holding, True)):
        propagator = Propagator(axis_mechanism("X1", p), DT)
        for n in range(8000):
            propagator.w[propagator.layout.command] = torque * min(1.0, n / 6000)
            propagator.step()
        pinion = propagator.w[propagator.layout.q][2]
        assert bool(pinion > 1e-9) == moves


def test_a_condition_that_is_met_to_its_last_digit_costs_no_search_without_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A gantry at rest behind its brakes, a pinion at 5e-16 m/s: eight ticks round otherwise than one by one."""
    second = AxisParameters(b=48e-6, M=300.0, UL=35e-6, friction_mas=Friction(150.0, 380.0))
    axes = (AxisParameters(b=62e-6, M=330.0, UL=20e-6), second)
    resting = Propagator(gantry_mechanism(GantryParameters("X1", "X2", k=1.5e7), *axes), DT)
    held = resting.w[resting.layout.up].copy()
    held[[0, 4]] += 20.0 / 0.003  # the brakes, 20 N m at 3 mm/rad
    resting.w[resting.layout.up] = resting.w[resting.layout.down] = held
    q = [9.0034328508594517e-16, 1.2999999901532272e-07, 1.9428571330105209e-07, -1.8263718012749596e-05]
    q += [-8.9357739734920446e-14, -1.3000008722852475e-07, -1.9428580215705396e-07, -2.5476226014263726e-05]
    v = [0.0, -4.2233965931435650e-16, -4.7640517114903928e-16, 0.0, 0.0, 4.2233908944170646e-16, 0.0, 0.0]
    resting.w[resting.layout.q], resting.w[resting.layout.v] = q, v
    resting._key = Key((0, 0), (0, 0, -1, 0, 0, 0, 0, 0))
    resting.mode = resting._mode(resting._key)
    walks = 0
    walk = Propagator._walk

    def counted(self: Propagator, ticks: int, search: bool) -> int:
        nonlocal walks
        walks += 1
        return walk(self, ticks, search)

    monkeypatch.setattr(Propagator, "_walk", counted)
    for _ in range(20):
        resting.step()
    assert walks < 20 * 64
