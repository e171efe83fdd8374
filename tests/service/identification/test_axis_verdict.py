"""When effects that were found may be named."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from service.identification import axis_common, axis_verdict, moves_motors
from service.identification.selection import Selection
from tests.service.identification.a_selection import numbers, trial

pytestmark = pytest.mark.usefixtures("silent_motors")


@pytest.mark.parametrize(
    ("before", "after", "effects", "finding"),
    [
        ((1.2, 1.5), (1.2, 1.5), (), "none"),
        ((1.4, 1.5), (1.4, 1.5), (), "unknown"),
        ((9.0, 9.0), (9.0, 9.0), (), "unknown"),
        ((1.1, 70.0), (1.1, 70.0), (), "unknown"),
        ((9.0, 12.0), (1.1, 1.3), ("stribeck_friction",), "effect"),
        ((9.0, 12.0), (1.1, 1.3), ("stribeck_friction", "sensor_latency"), "effect"),
        ((40.0, 40.0), (3.0, 3.9), ("hung_mass_mode",), "effect"),
        ((40.0, 40.0), (2.5, 6.0), ("hung_mass_mode",), "unknown"),
        ((40.0, 40.0), (1.8, 3.0), ("gearbox_clearance",), "unknown"),
        ((9.0, 12.0), (1.1, 1.3), ("gearbox_clearance",), "effect"),
        ((1.0, 11.0), (1.0, 4.6), ("stribeck_friction",), "unknown"),
        ((1.4, 2.0), (1.3, 1.7), ("sensor_latency",), "unknown"),
        ((1.4, 2.0), (1.3, 1.3), ("sensor_latency",), "effect"),
        ((1.5, 2.5), (1.35, 1.65), ("sensor_latency",), "unknown"),
        ((1.5, 2.5), (1.2, 1.65), ("sensor_latency",), "effect"),
        ((40.0, 40.0), (3.0, 6.0), ("sensor_latency", "sensor_gain", "gearbox_clearance"), "unknown"),
        ((9.0, 9.0), (5.0, 5.0), ("sensor_gain",), "unknown"),
        ((2.9, 2.1), (2.6, 1.3), ("machine_body_mode",), "unknown"),
        ((66.0, 66.0), (15.0, 18.0), ("sensor_gain",), "unknown"),
    ],
)
def test_effects_are_named_when_they_leave_next_to_nothing(
    monkeypatch: pytest.MonkeyPatch,
    before: tuple[float, float],
    after: tuple[float, float],
    effects: tuple[str, ...],
    finding: str,
) -> None:
    values = iter([(50e-6, 1e-7), (40e-6, 1e-7)])
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: next(values))
    monkeypatch.setattr(axis_common, "deviations", numbers)
    selection = Selection(trial(*before), trial(*after), effects, (), ())
    found, named = axis_verdict.finding_of(selection)
    assert (found, named) == (finding, effects if finding == "effect" else ())


@pytest.mark.parametrize(
    ("left", "others", "found"),
    [
        (1.5, ((50.9e-6, 1e-7), (33e-6, 1.7e-5)), "none"),
        (1.7, ((50.9e-6, 1e-7),), "unknown"),
        (1.5, ((50.9e-6, 1e-7), (52.5e-6, 1e-7)), "unknown"),
        (1.5, (), "unknown"),
        (1.2, ((52.5e-6, 1e-7),), "none"),
    ],
)
def test_impurities_are_no_finding_where_nothing_in_their_place_changes_the_backlash(
    monkeypatch: pytest.MonkeyPatch, left: float, others: tuple[tuple[float, float], ...], found: str
) -> None:
    """A ripple, a bend and cogging together left 1.46, and no effect alone explained them. A second gap knows nothing
    of how it is divided; what is farther from the moves than the declared model says nothing."""
    tried = [trial(left - 0.1, 2.0) for _ in others] + [trial(9.0, 9.0)]
    before = trial(left, 2.5)
    for one, both in zip([before, *tried], [(50e-6, 1e-7), *others, (9e-5, 1e-7)], strict=True):
        one.model.fitted.both = both
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda fitted, _axis: fitted.both)
    selection = Selection(before, before, (), (), (), tuple(tried))
    assert axis_verdict.finding_of(selection)[0] == found


@pytest.mark.parametrize(
    ("left", "damped", "found"),
    [
        (1.5, (), "none"),
        (1.5, ("X1.gear_damping_ratio",), "unknown"),
        (1.2, ("X1.gear_damping_ratio",), "none"),
    ],
)
def test_a_chain_damped_as_none_is_is_no_impurity(
    monkeypatch: pytest.MonkeyPatch, left: float, damped: tuple[str, ...], found: str
) -> None:
    """A drive's torque that slips left 1.3 of the noise with a gear that is damped as none is."""
    before, other = trial(left, 1.6), trial(left - 0.1, 1.6)
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: (50e-6, 1e-7))
    monkeypatch.setattr(axis_verdict, "overdamped", lambda _fitted: damped)
    assert axis_verdict.finding_of(Selection(before, before, (), (), (), (other,)))[0] == found


@pytest.mark.parametrize(
    ("motors", "others", "found"),
    [
        ((9.7, 6.0), 2.7, "unknown"),
        ((7.0, 8.2), 2.7, "unknown"),
        ((7.0, 8.2), 1.2, "effect"),
        ((19.5, 2.8), 2.7, "effect"),
        ((2.1, 1.9), 2.7, "effect"),
        ((38.6, 17.9), 2.7, "effect"),
    ],
    ids=["hardly less", "no less", "others described", "gone", "not plainly", "most of it gone"],
)
def test_an_effect_that_the_motors_speak_against_is_not_named(
    monkeypatch: pytest.MonkeyPatch, motors: tuple[float, float], others: float, found: str
) -> None:
    """A guide that warms looked like a hung mass in the moves that were fitted, a sensor's curve like its gain."""
    without, with_it = trial(3.6, 9.0), trial(1.1, others)
    b = {id(without.model.fitted): (50e-6, 1e-7), id(with_it.model.fitted): (40e-6, 1e-7)}
    left = dict(zip(b, motors, strict=True))
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda fitted, _axis: b[id(fitted)])
    monkeypatch.setattr(moves_motors, "left_by_motors", lambda fitted: np.array([0.2, left[id(fitted)]]))
    selection = Selection(without, with_it, ("sensor_gain",), (), ())
    assert axis_verdict.finding_of(selection)[0] == found


@pytest.mark.parametrize(("limits", "found"), [((), "effect"), (("preload_damping_ratio",), "unknown")])
def test_an_effect_that_becomes_none_when_its_fit_is_ended_is_not_named(
    monkeypatch: pytest.MonkeyPatch, limits: tuple[str, ...], found: str
) -> None:
    values = iter([(50e-6, 1e-7), (40e-6, 1e-7)])
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: next(values))
    after = replace(trial(1.0, 1.02), at_limits=limits)
    selection = Selection(trial(2.0, 3.3), after, ("preload_flank",), (), ())
    assert axis_verdict.finding_of(selection)[0] == found


@pytest.mark.parametrize(
    ("limits", "left", "b", "found"),
    [
        (("preload_damping_ratio",), (1.0, 1.04), 53e-6, "unknown"),
        ((), (1.0, 1.04), 53e-6, "none"),
        (("preload_damping_ratio",), (1.0, 1.04), 50.9e-6, "none"),
        (("preload_damping_ratio",), (1.0, 1.5), 53e-6, "none"),
    ],
    ids=["imitated", "a gain that was none", "no other backlash", "a part"],
)
def test_what_only_a_law_explains_that_no_such_effect_has_is_unknown(
    monkeypatch: pytest.MonkeyPatch, limits: tuple[str, ...], left: tuple[float, float], b: float, found: str
) -> None:
    """A film of grease braked the load in its gap, which hardly showed in the moves that were fitted."""
    before, tried = trial(1.25, 3.4), replace(trial(*left), at_limits=limits)
    before.model.fitted.both, tried.model.fitted.both = (50e-6, 1e-7), (b, 1e-7)
    tried.model.fitted.model.effects = (SimpleNamespace(name="preload_flank"),)
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda fitted, _axis: fitted.both)
    selection = Selection(before, before, (), (), (), (tried,))
    assert axis_verdict.finding_of(selection)[0] == found


@pytest.mark.parametrize("errors", [((1.1, 1.8), (1.3, 1.7)), ((1.5, 2.2), (1.0, 2.6))])
def test_what_the_motors_witness_is_a_finding_however_little_the_accelerometer_tells(
    errors: tuple[tuple[float, float], tuple[float, float]],
) -> None:
    before, after = (trial(*both) for both in errors)
    name = ("gearbox_clearance",)
    assert axis_verdict.finding_of(Selection(before, after, name, (), (), witnessed=name)) == ("effect", name)


@pytest.mark.parametrize(
    ("held_out", "motors", "found"),
    [(3.7, 10.8, "unknown"), (3.7, 1.8, "none"), (1.9, 10.8, "none")],
    ids=["foretells badly and is contradicted", "numbers are not known", "a motor that cogs"],
)
def test_a_model_that_foretells_badly_and_that_the_motors_contradict_plainly_is_not_sound(
    monkeypatch: pytest.MonkeyPatch, held_out: float, motors: float, found: str
) -> None:
    """A gap that is two described what it was fitted to, and its backlash was a fifth too large."""
    monkeypatch.setattr(axis_verdict, "left_by_motors", lambda _fitted: np.array([motors]))
    model = trial(1.2, held_out)
    assert axis_verdict.finding_of(Selection(model, model, (), (), ())) == (found, ())


@pytest.mark.parametrize(
    ("after", "limits", "motors", "found"),
    [
        ((1.0, 1.0), (), 1.4, "none"),
        ((1.0, 1.0), (), 3.2, "unknown"),
        ((1.0, 1.3), (), 1.4, "unknown"),
        ((1.0, 1.0), ("X1.ripple_period",), 1.4, "unknown"),
    ],
    ids=["sound", "contradicted, too", "leaves something", "no such mesh"],
)
def test_what_every_sound_machine_has_may_be_what_the_motors_contradict_a_model_without_it_for(
    monkeypatch: pytest.MonkeyPatch,
    after: tuple[float, float],
    limits: tuple[str, ...],
    motors: float,
    found: str,
) -> None:
    """A mesh error and a bent contact: the motors left 3.2 without them."""
    before, both = trial(1.17, 2.7), replace(trial(*after), at_limits=limits)
    left = {id(before.model.fitted): 3.2, id(both.model.fitted): motors}
    monkeypatch.setattr(axis_verdict, "left_by_motors", lambda fitted: np.array([left[id(fitted)]]))
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda _fitted, _axis: (57e-6, 1e-7))
    monkeypatch.setattr(axis_common, "deviations", numbers)
    selection = Selection(before, both, ("contact_nonlinearity", "transmission_ripple"), (), ())
    assert axis_verdict.finding_of(selection) == (found, ())


def test_where_the_motors_hint_at_something_that_no_effect_explains_a_sound_model_is_unknown() -> None:
    sound = Selection(trial(1.1, 1.2), trial(1.1, 1.2), (), (), ())
    assert axis_verdict.finding_of(sound)[0] == "none"
    assert axis_verdict.finding_of(replace(sound, hinted=True))[0] == "unknown"


def test_a_sound_model_of_accepted_effects_may_leave_what_its_laws_leave() -> None:
    selection = Selection(trial(1.4, 2.5), trial(1.4, 2.5), (), (), ())
    assert axis_verdict.finding_of(selection)[0] == "unknown"
    assert axis_verdict.finding_of(selection, sound=axis_verdict.LEFT)[0] == "none"


def test_an_impurity_that_moves_the_backlash_by_next_to_nothing_is_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    values = iter([(50.0e-6, 1e-7), (50.3e-6, 1e-7)])
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: next(values))
    monkeypatch.setattr(axis_common, "deviations", numbers)
    selection = Selection(trial(1.4, 2.5), trial(1.0, 1.1), ("transmission_ripple",), (), ())
    assert axis_verdict.finding_of(selection) == ("none", ())


@pytest.mark.parametrize(
    ("held_out", "left", "found"),
    [(2.5, 1.0, "effect"), (2.5, 1.5, "none"), (1.9, 1.0, "none"), (1.5, 1.0, "none")],
)
def test_an_effect_that_shows_at_another_speed_only_is_a_finding_if_it_explains_all_of_much(
    monkeypatch: pytest.MonkeyPatch, held_out: float, left: float, found: str
) -> None:
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: (50e-6, 1e-7))
    selection = Selection(trial(1.02, held_out), trial(1.0, left), ("curved_friction",), (), ())
    assert axis_verdict.finding_of(selection)[0] == found


@pytest.mark.parametrize(
    ("before", "after", "train", "name", "found"),
    [
        (6.9, 1.4, 0.97, "curved_friction", "effect"),
        (6.9, 1.4, 1.01, "curved_friction", "effect"),
        (6.9, 1.4, 1.03, "curved_friction", "none"),
        (6.9, 1.6, 1.01, "curved_friction", "none"),
        (1.4, 1.0, 1.01, "curved_friction", "none"),
        (6.9, 1.4, 1.01, "transmission_ripple", "none"),
    ],
    ids=[
        "reconciled",
        "hardly anything to explain",
        "less near",
        "not reconciled",
        "no contradiction",
        "every machine has it",
    ],
)
def test_what_no_fitted_sample_shows_is_a_finding_if_the_motors_contradict_the_model_without_it(
    monkeypatch: pytest.MonkeyPatch, before: float, after: float, train: float, name: str, found: str
) -> None:
    """A planted curve left 1.02 in the train moves, 1.54 in the others and 6.9 of the motors' noise; another one 1.024
    in the train moves, and 1.006 when it was found: a share of next to nothing says nothing."""
    without, with_it = trial(1.02, 1.5), trial(train, 1.05)
    motors = {id(without.model.fitted): before, id(with_it.model.fitted): after}
    monkeypatch.setattr(axis_verdict, "left_by_motors", lambda fitted: np.array([0.2, motors[id(fitted)]]))
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: (50e-6, 1e-7))
    monkeypatch.setattr(axis_common, "deviations", numbers)
    assert axis_verdict.finding_of(Selection(without, with_it, (name,), (), ()))[0] == found


@pytest.mark.parametrize(
    ("held_out", "left", "other", "name", "found"),
    [
        (1.8, 0.99, 1.6, "curved_friction", "effect"),
        (1.8, 1.06, 1.6, "curved_friction", "effect"),
        (1.8, 0.99, 1.4, "curved_friction", "none"),
        (1.8, 1.15, 1.6, "curved_friction", "none"),
        (1.25, 0.99, 1.24, "curved_friction", "none"),
        (1.8, 0.99, 1.6, "transmission_ripple", "none"),
    ],
)
def test_what_shows_at_another_speed_only_is_a_finding_if_nothing_else_explains_a_part_of_it(
    monkeypatch: pytest.MonkeyPatch, held_out: float, left: float, other: float, name: str, found: str
) -> None:
    """A planted curve left 1.03 in the train moves and 1.79 in the others; ripples and cogging, which leave as much,
    are explained by half or more by two or three effects."""
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: (50e-6, 1e-7))
    monkeypatch.setattr(axis_common, "deviations", numbers)
    tried = (trial(1.0, left), trial(1.02, other))
    for one, of in zip(tried, (name, "stribeck_friction"), strict=True):
        one.model.fitted.model.effects = (SimpleNamespace(name=of),)
    selection = Selection(trial(1.02, held_out), tried[0], (name,), (), (), tried)
    assert axis_verdict.finding_of(selection)[0] == found


@pytest.mark.parametrize(("seen", "found"), [(("sensor_bias",), "effect"), ((), "none")])
def test_what_was_seen_at_rest_is_named_however_little_it_changes_the_backlash(
    monkeypatch: pytest.MonkeyPatch, seen: tuple[str, ...], found: str
) -> None:
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: (50e-6, 1e-7))
    selection = Selection(trial(1.02, 1.2), trial(0.95, 1.0), ("sensor_bias",), (), ())
    assert axis_verdict.finding_of(selection, seen)[0] == found


@pytest.mark.parametrize(
    ("seen", "after", "found"),
    [
        (("sensor_bias",), (1.35, 4.4), "effect"),
        (("sensor_bias",), (2.1, 4.4), "unknown"),
        (("sensor_bias",), (1.35, 7.0), "unknown"),
        ((), (1.35, 4.4), "unknown"),
    ],
)
def test_what_was_seen_at_rest_and_describes_what_was_fitted_needs_no_well_known_chain(
    monkeypatch: pytest.MonkeyPatch, seen: tuple[str, ...], after: tuple[float, float], found: str
) -> None:
    """A load that bounced thrice as it stopped was met at the wrong time the third time, the zero's course was seen."""
    values = iter([(134.0e-6, 1e-7), (130.0e-6, 1e-7)])
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: next(values))
    selection = Selection(trial(7.9, 9.5), trial(*after), ("sensor_bias",), (), ())
    assert axis_verdict.finding_of(selection, seen)[0] == found


def test_a_residual_that_is_named_by_nothing_is_no_impurity(monkeypatch: pytest.MonkeyPatch) -> None:
    """What moves the backlash by next to nothing has to explain what is missing."""
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: (50e-6, 1e-7))
    selection = Selection(trial(1.5, 2.0), trial(1.4, 1.5), ("sensor_gain",), (), ())
    assert axis_verdict.finding_of(selection) == ("unknown", ())


@pytest.mark.parametrize(
    ("name", "train", "after", "found"),
    [
        ("sensor_bias", 1.4, 1.02, "effect"),
        ("sensor_bias", 1.4, 1.1, "effect"),
        ("sensor_bias", 1.4, 1.2, "none"),
        ("sensor_bias", 1.05, 1.02, "effect"),
        ("sensor_bias", 1.02, 1.02, "none"),
        ("contact_nonlinearity", 1.4, 1.02, "none"),
    ],
)
def test_what_is_in_no_sound_machine_and_explains_what_shows_in_all_moves_is_a_finding(
    monkeypatch: pytest.MonkeyPatch, name: str, train: float, after: float, found: str
) -> None:
    """Also where it does not change the backlash; what shows in the held-out moves only may be numbers, and what
    explains half of it a part of something else."""
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: (50e-6, 1e-7))
    monkeypatch.setattr(axis_common, "deviations", numbers)
    selection = Selection(trial(train, 1.5), trial(1.0, after), (name,), (), ())
    assert axis_verdict.finding_of(selection)[0] == found


@pytest.mark.parametrize(("train", "found"), [(0.96, "effect"), (1.25, "none")])
def test_a_law_that_differs_a_little_is_named_where_much_is_missing_and_what_was_fitted_is_explained(
    monkeypatch: pytest.MonkeyPatch, train: float, found: str
) -> None:
    """Flanks that were damped otherwise where they are pressed hard left 1.65 of 3.9 in moves with more jerk."""
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: (30e-6, 1e-7))
    monkeypatch.setattr(axis_common, "deviations", lambda _f: {"X1.bend": (0.76, 0.02)})
    selection = Selection(trial(1.26, 3.89), trial(train, 1.65), ("contact_nonlinearity",), (), ())
    assert axis_verdict.finding_of(selection)[0] == found


@pytest.mark.parametrize(
    ("name", "bend", "change", "found"),
    [
        ("contact_nonlinearity", 0.04, 1.5e-6, "none"),
        ("contact_nonlinearity", 0.04, 2.5e-6, "effect"),
        ("contact_nonlinearity", 0.5, 1.5e-6, "effect"),
        ("transmission_ripple", 0.04, 1.5e-6, "effect"),
    ],
)
def test_flanks_as_sound_ones_are_a_finding_only_where_the_backlash_clearly_changes(
    monkeypatch: pytest.MonkeyPatch, name: str, bend: float, change: float, found: str
) -> None:
    """Planted in a sound machine, a bend of 0.039 was found as 0.036, and the backlash 1.2 um nearer."""
    values = {"before": (30e-6, 1e-7), "after": (30e-6 - change, 1e-7)}
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda fitted, _axis: values[fitted.when])
    monkeypatch.setattr(axis_common, "deviations", lambda _f: numbers(_f) | {"X1.bend": (bend, 0.001)})
    before, after = trial(1.1, 1.45), trial(1.0, 1.02)
    for when, one in (("before", before), ("after", after)):
        one.model.fitted.when = when
    assert axis_verdict.finding_of(Selection(before, after, (name,), (), ()))[0] == found


@pytest.mark.parametrize(
    ("after", "finding"), [((1.1, 4.2), "effect"), ((1.7, 4.2), "unknown"), ((1.1, 6.0), "unknown")]
)
def test_an_effect_that_predicts_nearly_all_of_what_nobody_fitted_is_named_whatever_it_leaves(
    monkeypatch: pytest.MonkeyPatch, after: tuple[float, float], finding: str
) -> None:
    """As long as it describes the moves that were fitted."""
    monkeypatch.setattr(axis_verdict, "_matters", lambda _selection: True)
    selection = Selection(trial(9.0, 33.0), trial(*after), ("position_dependent_backlash",), (), ())
    assert axis_verdict.finding_of(selection)[0] == finding


@pytest.mark.parametrize(("offset", "found"), [(0.0, "none"), (100e-6, "unknown")])
def test_a_model_whose_channels_have_to_be_apart_in_time_is_not_sound_however_little_it_leaves(
    monkeypatch: pytest.MonkeyPatch, offset: float, found: str
) -> None:
    """A friction stage that creeps under the force of the step was taken for a clock that is 150 µs late."""
    monkeypatch.setattr(axis_verdict, "apart_in_time", lambda _fitted, _axis: offset)
    assert axis_verdict.finding_of(Selection(trial(1.03, 1.2), trial(1.03, 1.2), (), (), ()))[0] == found


@pytest.mark.parametrize(
    ("other", "held_out", "found"), [(1.74, 1.84, "effect"), (1.3, 1.84, "unknown"), (1.74, 2.0, "unknown")]
)
def test_what_alone_describes_the_moves_that_were_fitted_is_named_if_it_predicts_the_others_no_worse(
    monkeypatch: pytest.MonkeyPatch, other: float, held_out: float, found: str
) -> None:
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: (130e-6, 1e-7))
    monkeypatch.setattr(axis_common, "deviations", numbers)
    tried = []
    for name, train in (("curved_friction", 1.02), ("sensor_gain", other)):
        one = trial(train, held_out)
        one.model.fitted.model.effects = (SimpleNamespace(name=name),)
        tried.append(one)
    selection = Selection(trial(1.76, 1.95), tried[0], ("curved_friction",), (), (), tuple(tried))
    assert axis_verdict.finding_of(selection)[0] == found
