"""Every effect on the driven model against a general integrator of equations written down once more, rest to rest."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from service.dynamics.driven import simulate
from service.dynamics.driven_model import Model
from service.dynamics.driven_motion import coefficients, plain_motion
from service.dynamics.effects.driven_library import DRIVEN
from service.dynamics.effects.driven_ripple import DrivenRipple
from service.dynamics.effects.driven_sensors import low_passed
from service.dynamics.effects.driven_transmission import BENDS, FINE, damping, stiffening
from service.recording import FloatArray, Trace

H, K, BEGIN = 2.5e-4, 340, -0.002
CHAIN = {
    "backlash": 60e-6,
    "contact_stiffness": 3e5,
    "contact_damping_ratio": 0.06,
    "coulomb": 0.4,
    "viscous": 0.8,
    "turnover_speed": 4e-4,
    "turnover_spread": 2.5,
    "drive_stiffness": 9e5,
    "drive_damping_ratio": 0.05,
    "drive_mass": 0.1,
}
SPEED = Trace(
    np.arange(-0.02, 0.12, 1e-3),
    0.1 * np.sin(np.pi * np.clip(np.arange(-0.02, 0.12, 1e-3), 0, 0.085) / 0.085) ** 2,
)
PLANTED = {
    "sensor_latency": {"X1.latency": 0.0013},
    "sensor_gain": {"X1.gain_error": -0.1},
    "sensor_bias": {"X1.bias_drift": 0.7},
    "sensor_filter": {"X1.filter_delay": 0.002, "X1.filter_damping": 0.6},
    "speed_filter": {"X1.filter_time": 0.001},
    "constant_force": {"X1.constant_force": 0.3},
    "position_dependent_force": {"X1.spring_rate": 150.0, "X1.spring_preload": 0.1},
    "asymmetric_friction": {"X1.coulomb_asymmetry": 0.2, "X1.viscous_asymmetry": 2.0},
    "stribeck_friction": {
        "X1.breakaway": 0.5,
        "X1.stribeck_speed": 0.01,
        "X1.stribeck_exponent": 1.3,
        "X1.stribeck_tail": 0.6,
    },
    "curved_friction": {"X1.curved_level": 0.5, "X1.curved_power": 2.0},
    "gearbox_clearance": {"X1.clearance": 3e-5, "X1.pinion_friction": 0.15, "X1.pinion_viscous": 1.0},
    "position_dependent_backlash": {"X1.gap_slope": 0.008, "X1.gap_bow": 9.0, "X1.gap_period": 9e-3},
    "preload_flank": {"X1.preload_stiffness": 2e4, "X1.preload_damping_ratio": 0.05},
    "contact_nonlinearity": {"X1.bend": 0.4},
    "transmission_ripple": {"X1.ripple_amplitude": 4e-6, "X1.ripple_phase": 1.0, "X1.ripple_period": 3e-3},
    "hung_mass_mode": {"X1.hung_ratio": 0.2, "X1.hung_frequency": 30.0, "X1.hung_damping": 0.03},
    "machine_body_mode": {
        "body_ratio": 0.2,
        "body_frequency": 15.0,
        "body_damping": 0.03,
        "body_drive_ratio": 0.05,
    },
}


@dataclass
class Plain:
    """The machine, one force after the other; `e` holds what is planted, without the axis' name. A mesh's error is that
    where the motor is, or the pinion."""

    e: dict[str, float]
    at_pinion: bool = False
    v: dict[str, float] = field(default_factory=lambda: dict(CHAIN))

    def __post_init__(self) -> None:
        self.course = plain_motion(SPEED, 1.0)

    def get(self, name: str) -> float:
        return self.e.get(name, 0.0)

    def motor(self, t: float) -> tuple[float, float]:
        t -= self.get("latency")
        x, v, a = (float(self.course(t, k)) for k in range(3))
        x, v = x + self.get("filter_time") * v, v + self.get("filter_time") * a
        return x, v

    def ripple(self, xm: float, vm: float) -> tuple[float, float]:
        """How much farther a pinion with such teeth pushes, and the rate of it."""
        size, kappa = self.get("ripple_amplitude"), 2 * np.pi / self.e.get("ripple_period", 1.0)
        angle = kappa * xm + self.get("ripple_phase")
        begun = kappa * self.motor(BEGIN)[0] + self.get("ripple_phase")
        return size * float(np.sin(angle) - np.sin(begun)), size * kappa * float(np.cos(angle)) * vm

    def friction(self, slip: float) -> float:
        up = self.v["coulomb"] + self.get("coulomb_asymmetry") + self.get("breakaway")
        down = self.v["coulomb"] - self.get("coulomb_asymmetry") + self.get("breakaway")
        x, mean = slip / self.v["turnover_speed"], 0.5 * (up + down)
        knee = ((0.30, 1 / self.v["turnover_spread"]), (0.45, 1.0), (0.25, self.v["turnover_spread"]))
        held = sum(share * float(np.clip(mean * x / at, -down, up)) for share, at in knee)
        more = self.v["viscous"] * slip + self.get("viscous_asymmetry") * abs(slip)
        of_speed = abs(slip / self.e.get("stribeck_speed", 1.0)) ** self.e.get("stribeck_exponent", 2.0)
        tail = self.e.get("stribeck_tail", 1.0)
        fade = (1.0 + tail * of_speed) ** (-1.0 / tail) - 1.0
        more += self.get("breakaway") * float(fade) * float(np.sign(slip))
        grown = (abs(slip) / 0.1) ** self.e.get("curved_power", 1.0)
        return held + more + self.get("curved_level") * float(np.sign(slip)) * grown

    def drive(self, stretch: float, rate: float) -> float:
        k = self.v["drive_stiffness"]
        d = 2 * self.v["drive_damping_ratio"] * np.sqrt(k)
        if not self.get("clearance"):
            return k * stretch + d * rate
        return one_sided(stretch, rate, 0.5 * self.e["clearance"], k, d)

    def gap(self, x: float) -> tuple[float, float]:
        """Half of its width at a place, and how the width changes there."""
        kappa = 2 * np.pi / self.e.get("gap_period", 1.0)
        phase = float(np.arctan2(-self.get("gap_bow"), self.get("gap_slope") * kappa))
        size = float(np.hypot(self.get("gap_slope") / kappa, self.get("gap_bow") / kappa**2))
        wave = size * float(np.sin(kappa * x + phase) - np.sin(phase))
        return 0.5 * (self.v["backlash"] + wave), size * kappa * float(np.cos(kappa * x + phase))

    def contact(self, s: float, r: float, x: float, v: float) -> float:
        """The depth's rate counts, so a gap that widens under way damps too. It is as wide as where the load is."""
        half, steep = self.gap(x)
        k = self.v["contact_stiffness"]
        rate = r - float(np.sign(s)) * 0.5 * steep * v
        d = 2 * self.v["contact_damping_ratio"] * np.sqrt(k)
        if not self.get("bend"):
            return one_sided(s, rate, half, k, d)
        if "damping_bend" in self.e:
            return smooth_flank(s, rate, half, (k, self.e["bend"]), (d, self.e["damping_bend"]))
        return bent_flank(s, rate, half, k, d, self.e["bend"])

    def preload(self, s: float, r: float) -> float:
        k = self.get("preload_stiffness")
        return k * s + 2 * self.get("preload_damping_ratio") * float(np.sqrt(k)) * r

    def rates(self, t: float, z: FloatArray) -> list[float]:
        xp, vp, x, v, xh, vh, xb, vb, read, rising = z
        xm, vm = self.motor(t)
        error, rate = self.ripple(xp, vp) if self.at_pinion else self.ripple(xm, vm)
        drive = self.drive(xm - xp, vm - vp)
        contact = self.contact(xp - x + xb + error, vp - v + vb + rate, x, v)
        contact += self.preload(xp - x, vp - v)
        rub = self.friction(v - vb)
        a = contact - rub + self.get("constant_force")
        a += self.get("spring_preload") - self.get("spring_rate") * (x - self.get("spring_zero"))
        w, wb = 2 * np.pi * self.get("hung_frequency"), 2 * np.pi * self.get("body_frequency")
        pull = w**2 * (xh - x) + 2 * self.get("hung_damping") * w * (vh - v)
        a += self.get("hung_ratio") * pull
        body = -self.get("body_drive_ratio") * float(self.course(t, 2))
        body += self.get("body_ratio") * (rub - contact) - wb**2 * xb - 2 * self.get("body_damping") * wb * vb
        held = self.get("pinion_friction") * float(np.clip(vp / 5e-4, -1.0, 1.0))
        held += self.get("pinion_viscous") * vp
        mesh = (drive - contact - held) / self.v["drive_mass"]
        return [vp, mesh, v, a, vh, -pull, vb, body, rising, self.following(v, read, rising)]

    def following(self, v: float, read: float, rising: float) -> float:
        """How the sensor's own low-pass moves what it reads of a speed."""
        if not self.get("filter_delay"):
            return 0.0
        omega = 2.0 * self.e["filter_damping"] / self.e["filter_delay"]
        return omega**2 * (v - read) - 2.0 * self.e["filter_damping"] * omega * rising

    def acceleration(self, rest: tuple[float, float]) -> FloatArray:
        """(K,) as the sensor reads it, the load lying in the gap at first, as far from its driving flank as if
        that were as declared; `rest` is the hung mass' displacement and speed then."""
        xm = at = self.motor(BEGIN)[0]
        for _ in range(5):
            at = xm - 15e-6 - (self.gap(at)[0] - 0.5 * self.v["backlash"])
        z = np.array([xm, 0.0, at, 0.0, at + rest[0], rest[1], *np.zeros(4)])
        grid = BEGIN + H * np.arange(K + 1)
        states = solve_ivp(
            self.rates, (grid[0], grid[-1]), z, t_eval=grid, max_step=4e-5, rtol=1e-7, atol=1e-11
        ).y
        v = states[8] if self.get("filter_delay") else states[3]
        drift = self.get("bias_drift") * (2.0 + H * (np.arange(K) + 0.5))
        return np.asarray((1.0 + self.get("gain_error")) * np.diff(v) / H + drift)


def one_sided(s: float, r: float, half: float, k: float, d: float) -> float:
    """A flank, eqs. (5)-(7), that never pulls."""
    beyond = s - float(np.clip(s, -half, half))
    force = k * beyond + d * r * (beyond != 0.0)
    return force if force * beyond > 0.0 else 0.0


def smooth_flank(
    s: float, r: float, half: float, stiff: tuple[float, float], damped: tuple[float, float]
) -> float:
    """Force and damper grow with powers of the depth from what they are under 4 m/s²."""
    (k, bend), (d, grown) = stiff, damped
    deep = max(abs(s) - half, 0.0)
    x = deep * k / 4.0
    push = k * deep * x**bend + d * x**grown * r * float(np.sign(s)) * (deep > 0.0)
    return max(push, 0.0) * float(np.sign(s))


def bent_flank(s: float, r: float, half: float, k: float, d: float, bend: float) -> float:
    """The pieces that are reached, as long as they push together."""
    deep, rate, force = abs(s) - half, r * float(np.sign(s)), 0.0
    for at, stiff, damped in zip(BENDS, *shares(bend), strict=False):
        if deep > at * 4.0 / k:
            force += stiff * k * (deep - at * 4.0 / k) + damped * d * rate
    return max(force, 0.0) * float(np.sign(s))


@cache
def shares(bend: float) -> tuple[tuple[float, ...], ...]:
    """Of the pieces in stiffness and damping; the law that they stand for has a test of its own."""
    found = np.array([bend])
    return tuple(stiffening(found)[0]), tuple(damping(found)[0])


def driven(
    names: tuple[str, ...],
    planted: dict[str, float],
    rest: tuple[float, float] = (0.0, 0.0),
    refined: bool = False,
) -> FloatArray:
    plain = (DRIVEN[name](("X1",)) for name in names)
    effects = tuple(effect.refined if refined else effect for effect in plain)
    model = Model(("X1",), 1, effects, "whole_move", ("constant", "skew"))
    v = {f"X1.{n}": np.array([x]) for n, x in CHAIN.items()} | {n: np.array([x]) for n, x in planted.items()}
    course, late = plain_motion(SPEED, 1.0), float(model.complete(v)["X1.skew"][0])
    c = coefficients(course, BEGIN + late, H, K)[None, None, :, None]
    place = c[0, 0, 0, 0, 0]
    load = np.array([place - 15e-6, 0.0]).reshape(1, 1, 1, 2)
    nuisance = np.zeros((1, 1, len(model.nuisance)))
    if "hung_mass_mode" in names:
        nuisance[..., :2] = rest
    return np.asarray(
        simulate(model, v, c, np.ones(1), load, H, nuisance, np.array([2.0])).acceleration[0, 0, 0]
    )


def check(names: tuple[str, ...], planted: dict[str, float], rest: tuple[float, float] = (0.0, 0.0)) -> None:
    theirs = Plain({n.removeprefix("X1."): x for n, x in planted.items()}).acceleration(rest)
    assert np.abs(theirs).max() > 3.0
    most = 0.02 if "position_dependent_backlash" in names else 0.01
    assert np.sqrt(np.mean((driven(names, planted, rest) - theirs) ** 2)) < most, (
        "the steepness is the mean one"
    )


@pytest.mark.parametrize("name", sorted(PLANTED))
def test_agrees_with_equations_written_once_more(name: str) -> None:
    check((name,), PLANTED[name])


@pytest.mark.parametrize("grown", [0.0, 0.6, 1.6])
def test_the_damper_of_a_bent_contact_grows_as_it_is_said_to(grown: float) -> None:
    """Not at all (Kelvin, Voigt), with the stiffness, with the force (Hunt, Crossley)."""
    planted = {"bend": 0.6, "damping_bend": grown}
    theirs = Plain(planted).acceleration((0.0, 0.0))
    named = {f"X1.{name}": value for name, value in planted.items()}
    ours = driven(("contact_nonlinearity",), named, refined=True)
    rough = driven(("contact_nonlinearity",), {"X1.bend": 0.6})
    errors = [np.sqrt(np.mean((predicted - theirs) ** 2)) for predicted in (ours, rough)]
    assert errors[0] < 0.05 and errors[0] < 0.35 * errors[1], "a damper is as large within a piece"


@pytest.mark.parametrize("bend", [-0.3, 0.1, 0.5, 1.0])
def test_the_pieces_of_a_bent_flank_follow_its_power(bend: float) -> None:
    """More closely than a quiet sensor sees, 0.02 m/s², pressed by up to 8 m/s², and as closely where a flank that
    stiffens is met, which decides about the backlash."""
    x = np.linspace(0.0, 2.0 ** (1.0 / (1.0 + bend)), 500)
    pieces = {at: np.maximum(x[:, None] - np.array(at[:-1]), 0.0) for at in (BENDS, FINE)}
    found = np.array([bend])
    missed = {at: 4.0 * (deep @ stiffening(found, at)[0] - x ** (1.0 + bend)) for at, deep in pieces.items()}
    rms = {at: float(np.sqrt(np.mean(m**2))) for at, m in missed.items()}
    assert rms[BENDS] < 0.055 and rms[FINE] < min(0.012, 0.35 * rms[BENDS])
    assert bend < 0.0 or np.max(np.abs(missed[FINE][x < 0.02])) < 0.02


@pytest.mark.parametrize("damping", [0.3, 0.7, 5.0])
@pytest.mark.parametrize("delay", [1e-3, 1e-8])
def test_a_slow_sensor_passes_a_tone_as_its_transfer_function_says(delay: float, damping: float) -> None:
    """Of seven samples a period; at a delay of next to nothing, where the filter's own poles are far off the grid's."""
    omega, time = 2 * np.pi / 7.0, np.arange(4000.0)
    passed = low_passed(np.sin(omega * time)[None, None], delay / H, damping)[0, 0]
    s = 1j * omega * delay / H
    law = 1.0 / (1.0 + s + (s / (2.0 * damping)) ** 2)
    wanted = np.abs(law) * np.sin(omega * time + np.angle(law))
    assert np.abs(passed - wanted)[3000:].max() < 0.07, "a tone is not straight between its samples"


def test_a_stribeck_tail_has_a_slope_where_there_is_none_yet() -> None:
    """(1 + τx)^(−1/τ) is e^(−x)·(1 + τx²/2) for a small τ. A fit's differences are half a millionth of it; a floor
    below which nothing changed left every step in the hands of the tail's prior."""
    courses = []
    for tail in (0.0, 5e-7, 1e-3):
        named = PLANTED["stribeck_friction"] | {"X1.stribeck_tail": tail, "X1.stribeck_exponent": 2.0}
        courses.append(driven(("stribeck_friction",), named))
    slopes = [(course - courses[0]) / tail for course, tail in zip(courses[1:], (5e-7, 1e-3), strict=True)]
    assert np.abs(slopes[1]).max() > 0.01
    assert np.abs(slopes[0] - slopes[1]).max() < 0.02 * np.abs(slopes[1]).max()


def test_two_effects_together() -> None:
    """The guide stands on the body, so friction that another effect bends must rub against it."""
    check(
        ("stribeck_friction", "machine_body_mode"),
        PLANTED["stribeck_friction"] | PLANTED["machine_body_mode"],
    )


def test_a_steep_error_of_the_mesh_is_that_where_the_pinion_is() -> None:
    """Not where the motor is, as a search may take it: the chain winds up by ten micrometres and more."""
    steep = {"ripple_amplitude": 3e-5, "ripple_phase": 1.0, "ripple_period": 3e-3}
    theirs = Plain(steep, at_pinion=True).acceleration((0.0, 0.0))
    named = {f"X1.{name}": value for name, value in steep.items()}
    ours, rough = (driven(("transmission_ripple",), named, refined=refined) for refined in (True, False))
    assert np.sqrt(np.mean((ours - theirs) ** 2)) < 0.01
    assert np.sqrt(np.mean((rough - theirs) ** 2)) > 0.05


def test_a_gap_that_waves_is_as_wide_as_where_the_load_is() -> None:
    """A search may take the mean steepness where a flank is pushed for that in every place."""
    planted = {"gap_slope": 0.015, "gap_bow": 11.0, "gap_period": 6e-3}
    theirs = Plain(planted).acceleration((0.0, 0.0))
    named = {f"X1.{name}": value for name, value in planted.items()}
    ours, rough = (
        driven(("position_dependent_backlash",), named, refined=refined) for refined in (True, False)
    )
    errors = [np.sqrt(np.mean((predicted - theirs) ** 2)) for predicted in (ours, rough)]
    assert errors[0] < 0.01 and errors[0] < 0.5 * errors[1]


@pytest.mark.parametrize("s", [1.0, -1.0])
@pytest.mark.parametrize("bow", [9.0, -4.0])
def test_a_load_that_rests_at_its_flank_stays_there_however_wide_the_gap_is(bow: float, s: float) -> None:
    """A step that begins where the gap is twice as wide, or half as wide, begins with the flanks touching and the
    springs relaxed."""
    effect = DRIVEN["position_dependent_backlash"](("X1",)).refined
    model = Model(("X1",), 2, (effect,), "whole_move", ("constant", "skew"))
    values = {p.name: np.array([p.typical]) for p in model.parameters}
    gap = {"X1.backlash": 60e-6, "X1.gap_bow": bow, "X1.gap_period": 0.1}
    values |= {name: np.array([x]) for name, x in gap.items()}
    place = 4e-3
    c = np.zeros((1, 1, K, 1, 5))
    c[..., 0] = place
    load = np.array([place - s * 30e-6, 0.0]).reshape(1, 1, 1, 2)
    said = simulate(model, values, c, np.array([s]), load, H)
    kappa = 2 * np.pi / 0.1
    wide = 60e-6 + bow / kappa**2 * (1.0 - np.cos(kappa * place))
    assert said.relative[0, 0, 0, 0] == pytest.approx(0.5 * s * wide, rel=0.02)
    assert np.abs(said.acceleration).max() < 1e-3


def test_a_force_along_the_travel_may_have_its_zero_elsewhere() -> None:
    name, plain = ("position_dependent_force",), PLANTED["position_dependent_force"]
    planted = plain | {"X1.spring_zero": 1e-3}
    theirs = Plain({n.removeprefix("X1."): x for n, x in planted.items()}).acceleration((0.0, 0.0))
    assert np.sqrt(np.mean((driven(name, planted, refined=True) - theirs) ** 2)) < 0.01
    assert np.sqrt(np.mean((driven(name, plain) - theirs) ** 2)) > 0.05


def test_a_mass_that_still_swings() -> None:
    check(("hung_mass_mode",), PLANTED["hung_mass_mode"], (2e-5, 3e-3))


@pytest.mark.parametrize("name", sorted(PLANTED))
def test_an_effect_of_amount_zero_is_absent(name: str) -> None:
    """Whatever shape it starts from; a link with two flanks differs by its dampers' pull alone."""
    effect = DRIVEN[name](("X1",))
    absent = {p.name: 0.0 for p in effect.parameters if p.typical == 0.0 and not p.logarithmic}
    limit = 0.3 if name == "gearbox_clearance" else 1e-6
    assert np.abs(driven((name,), {**effect.starts[-1], **absent}) - driven((), {})).max() < limit


@pytest.mark.parametrize(("shape", "share"), [(1e-5, 0.1), (4e-5, 0.4), (8.5e-5, 0.85)])
def test_a_second_gap_takes_its_width_off_the_first_and_leaves_some(shape: float, share: float) -> None:
    """A model with one gap takes both for one; a shape is a clearance of 100 µm in all."""
    effect = DRIVEN["gearbox_clearance"](("X1",))
    values = effect.traded({"X1.backlash": 60e-6, "X1.clearance": shape})
    assert values["X1.clearance"] == pytest.approx(share * 60e-6)
    assert values["X1.backlash"] == pytest.approx((1.0 - share) * 60e-6)


def test_a_pinion_between_two_gaps_rests_at_either_side_of_its_own() -> None:
    effect = DRIVEN["gearbox_clearance"](("X1",))
    assert effect.rests({"X1.clearance": 4e-5}) == ({"X1.pinion_rest": 2e-5}, {"X1.pinion_rest": -2e-5})


def test_the_load_lies_as_far_off_as_the_pinion_beside_which_it_rests() -> None:
    effect = DRIVEN["gearbox_clearance"](("X1",))
    model = Model(("X1",), 2, (effect,), "whole_move", ("constant", "skew"))
    x0, load = np.zeros((1, 1, 12)), model.load(0)
    case = cast(Any, SimpleNamespace(model=model, nuisance=np.full((1, 1, 1), 2e-5)))
    effect.begin(x0, case, cast(Any, None))
    assert {k: x for k, x in enumerate(x0[0, 0]) if x} == {load - 2: 2e-5, load: 2e-5}


def test_a_ripple_of_standard_teeth_has_their_pitch() -> None:
    """Module 2: 2·pi mm, to a hundredth; phase and amplitude are free."""
    standard = next(effect for effect in DrivenRipple(("X1",)).standards if effect.module == 2e-3)
    size, phase, period = standard.parameters
    assert (size, phase) == DrivenRipple(("X1",)).parameters[:2]
    assert 6.2e-3 < float(period.value(-3.0)) < 6.2832e-3 < float(period.value(3.0)) < 6.35e-3
    assert [start["X1.ripple_period"] for start in standard.starts] == pytest.approx([6.28319e-3] * 2)
    assert standard.starts[0]["X1.ripple_phase"] != standard.starts[1]["X1.ripple_phase"]
