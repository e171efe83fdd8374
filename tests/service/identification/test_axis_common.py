"""When what was found is no more than every sound machine has."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from service.identification import axis_common, axis_verdict
from service.identification.selection import Selection
from tests.service.identification.a_selection import numbers, trial

pytestmark = pytest.mark.usefixtures("silent_motors")


@pytest.mark.parametrize(
    ("name", "rms", "found"),
    [
        ("transmission_ripple", 0.98, "none"),
        ("transmission_ripple", 1.1, "effect"),
        ("stribeck_friction", 0.98, "effect"),
    ],
)
def test_what_a_mesh_explains_as_well_is_no_finding_where_the_backlash_stays(
    monkeypatch: pytest.MonkeyPatch, name: str, rms: float, found: str
) -> None:
    """An error of the mesh at two places looked like a friction that differs by direction."""
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: (30e-6, 1e-7))
    monkeypatch.setattr(axis_common, "deviations", lambda _fitted: {})
    other = trial(rms, rms)
    other.model.fitted.model.effects = (SimpleNamespace(name=name),)
    selection = Selection(trial(1.4, 1.9), trial(1.0, 1.03), ("asymmetric_friction",), (), (), tried=(other,))
    assert axis_verdict.finding_of(selection)[0] == found


@pytest.mark.parametrize(
    ("rival", "other", "backlash", "found"),
    [
        ("transmission_ripple", "transmission_ripple", 30e-6, "none"),
        ("transmission_ripple", "transmission_ripple", 34e-6, "effect"),
        ("sensor_gain", "sensor_gain", 30e-6, "effect"),
        ("sensor_gain", "transmission_ripple", 30e-6, "effect"),
    ],
    ids=["mesh", "a mesh by which the backlash is another", "not of every machine", "another explains more"],
)
def test_what_nothing_tells_from_a_mesh_is_no_finding_where_the_backlash_stays(
    monkeypatch: pytest.MonkeyPatch, rival: str, other: str, backlash: float, found: str
) -> None:
    """A mesh error and a slightly bent contact were called a curve of friction, or a mesh error."""
    mesh, curve = trial(1.3, 1.4), trial(1.2, 1.3)
    of_mesh = mesh.model.fitted
    monkeypatch.setattr(
        axis_verdict, "backlash_of", lambda fitted, _: (backlash if fitted is of_mesh else 30e-6, 1e-7)
    )
    monkeypatch.setattr(axis_common, "deviations", lambda _fitted: {})
    mesh.model.fitted.model.effects = (SimpleNamespace(name=other),)
    effects, rivals = ("curved_friction",), (("curved_friction", rival),)
    selection = Selection(trial(1.9, 3.0), curve, effects, (), rivals, tried=(mesh,))
    assert axis_verdict.finding_of(selection)[0] == found


@pytest.mark.parametrize(
    ("name", "other", "rms", "train", "found"),
    [
        ("gearbox_clearance", "transmission_ripple", 1.14, 1.0, "none"),
        ("gearbox_clearance", "transmission_ripple", 1.4, 1.0, "effect"),
        ("gearbox_clearance", "sensor_gain", 1.14, 1.0, "effect"),
        ("gearbox_clearance", "transmission_ripple", 1.14, 2.0, "effect"),
        ("preload_flank", "transmission_ripple", 1.14, 1.0, "effect"),
    ],
)
def test_a_second_gap_is_no_finding_where_what_every_machine_has_suffices(
    monkeypatch: pytest.MonkeyPatch, name: str, other: str, rms: float, train: float, found: str
) -> None:
    """A mesh error that showed in the moves that were not fitted was called a second gap, and its backlash with it was
    28 um off: a law with many valleys imitates much."""
    monkeypatch.setattr(axis_common, "deviations", lambda _fitted: {})
    mesh, split = trial(1.0, rms), trial(0.98, 1.04)
    of_split = split.model.fitted
    monkeypatch.setattr(
        axis_verdict, "backlash_of", lambda fitted, _: (121e-6 if fitted is of_split else 149e-6, 1e-7)
    )
    mesh.model.fitted.model.effects = (SimpleNamespace(name=other),)
    selection = Selection(trial(train, 1.95), split, (name,), (), (), tried=(mesh,))
    assert axis_verdict.finding_of(selection)[0] == found


@pytest.mark.parametrize(
    ("name", "before", "after", "found"),
    [
        ("transmission_ripple", 8.0, 1.5, "none"),
        ("transmission_ripple", 3.9, 1.1, "none"),
        ("transmission_ripple", 8.0, 1.1, "effect"),
        ("transmission_ripple", 20.0, 1.5, "effect"),
        ("sensor_gain", 8.0, 1.5, "effect"),
    ],
)
def test_what_every_rack_has_is_a_finding_only_where_it_matters_or_is_everything(
    monkeypatch: pytest.MonkeyPatch, name: str, before: float, after: float, found: str
) -> None:
    values = iter([(50.0e-6, 1e-7), (50.3e-6, 1e-7)])
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: next(values))
    monkeypatch.setattr(axis_common, "deviations", numbers)
    selection = Selection(trial(3.0, before), trial(after, after), (name,), (), ())
    assert axis_verdict.finding_of(selection)[0] == found


@pytest.mark.parametrize(
    ("before", "after", "found"),
    [
        ((4.4, 4.0), (1.5, 1.5), "none"),
        ((4.4, 4.0), (3.0, 3.0), "unknown"),
        ((2.1, 3.4), (1.1, 2.0), "none"),
        ((2.1, 3.4), (1.1, 2.8), "unknown"),
        ((9.0, 25.2), (2.0, 3.5), "none"),
        ((9.0, 25.2), (4.2, 7.6), "unknown"),
        ((1.5, 5.0), (1.0, 3.4), "none"),
        ((1.5, 42.6), (1.0, 19.7), "unknown"),
    ],
)
def test_what_every_rack_has_is_no_explanation_of_what_it_leaves(
    monkeypatch: pytest.MonkeyPatch, before: tuple[float, float], after: tuple[float, float], found: str
) -> None:
    """A mesh error that takes a third from a residual of three and more is not all that acts; nor is what describes a
    guide that warms up in the moves that were fitted and leaves most of it in the others; nor what takes nine tenths of
    what a load leaves that is taken off between the recordings; nor what takes four fifths of what a guide leaves that
    is uneven where the others were made."""
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: (50e-6, 1e-7))
    monkeypatch.setattr(axis_common, "deviations", numbers)
    selection = Selection(trial(*before), trial(*after), ("transmission_ripple",), (), ())
    assert axis_verdict.finding_of(selection)[0] == found


@pytest.mark.parametrize(
    ("amplitude", "period", "held_out", "found"),
    [
        (3.1e-6, 6.3e-3, 8.0, "none"),
        (6.5e-6, 6.3e-3, 8.0, "none"),
        (6.8e-6, 6.3e-3, 8.0, "effect"),
        (3.1e-6, 2.9e-3, 8.0, "none"),
        (1.1e-6, 1.4e-3, 8.0, "effect"),
        (1.1e-6, 1.4e-3, 3.0, "none"),
    ],
)
def test_a_thousandth_of_the_pitch_that_leaves_the_backlash_alone_is_of_the_mesh_unless_quicker_than_teeth(
    monkeypatch: pytest.MonkeyPatch, amplitude: float, period: float, held_out: float, found: str
) -> None:
    """A rack's teeth are 3.14 mm apart and more; 2.9 ± 0.1 mm may be theirs."""
    ripple = {"X1.ripple_amplitude": (amplitude, 2e-7), "X1.ripple_period": (period, 1e-4)}
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: (50e-6, 1e-7))
    monkeypatch.setattr(axis_common, "deviations", lambda _fitted: ripple)
    selection = Selection(trial(3.0, held_out), trial(1.0, 1.1), ("transmission_ripple",), (), ())
    assert axis_verdict.finding_of(selection)[0] == found


@pytest.mark.parametrize(
    ("bend", "std", "found"), [(0.5, 0.05, "effect"), (0.5, 0.2, "none"), (0.12, 0.01, "none")]
)
def test_flanks_that_stiffen_more_than_steel_does_are_a_finding(
    monkeypatch: pytest.MonkeyPatch, bend: float, std: float, found: str
) -> None:
    """Where the number is known well enough to say so; the backlash need not change."""
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: (50e-6, 1e-7))
    monkeypatch.setattr(axis_common, "deviations", lambda _f: {"X1.bend": (bend, std)})
    selection = Selection(trial(1.4, 1.7), trial(1.0, 1.02), ("contact_nonlinearity",), (), ())
    assert axis_verdict.finding_of(selection)[0] == found


@pytest.mark.parametrize(
    ("held_out", "ratio", "std", "found"),
    [
        (2.2, 0.007, 0.001, "none"),
        (2.2, 0.03, 0.01, "none"),
        (2.2, 0.08, 0.01, "effect"),
        (5.0, 0.007, 0.001, "effect"),
    ],
)
def test_a_hose_that_swings_on_the_carriage_is_a_finding_only_where_it_is_everything(
    monkeypatch: pytest.MonkeyPatch, held_out: float, ratio: float, std: float, found: str
) -> None:
    """Cogging of a sound machine was described by a mass of a hundred and fiftieth of the load, in its rhythm."""
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda *_: (50e-6, 1e-7))
    monkeypatch.setattr(axis_common, "deviations", lambda _f: {"X1.hung_ratio": (ratio, std)})
    selection = Selection(trial(1.2, held_out), trial(0.87, 0.88), ("hung_mass_mode",), (), ())
    assert axis_verdict.finding_of(selection)[0] == found


@pytest.mark.parametrize(
    ("pull", "change", "found"),
    [(0.014, 0.1e-6, "none"), (-0.014, 0.1e-6, "none"), (0.05, 0.1e-6, "effect"), (0.014, 3.5e-6, "effect")],
)
def test_the_slope_of_a_level_bed_is_a_finding_only_where_the_backlash_changes(
    monkeypatch: pytest.MonkeyPatch, pull: float, change: float, found: str
) -> None:
    """By twice what matters, 2 %: impurities of a sound machine looked like a bed that falls by 1.4 mm in a metre."""
    values = {"before": (75e-6, 1e-7), "after": (75e-6 - change, 1e-7)}
    monkeypatch.setattr(axis_verdict, "backlash_of", lambda fitted, _axis: values[fitted.when])
    monkeypatch.setattr(axis_common, "deviations", lambda _f: {"X1.constant_force": (pull, 0.001)})
    before, after = trial(1.49, 1.83), trial(1.1, 1.2)
    for when, one in (("before", before), ("after", after)):
        one.model.fitted.when = when
    selection = Selection(before, after, ("constant_force",), (), (), tried=(after,))
    after.model.fitted.model.effects = (SimpleNamespace(name="constant_force"),)
    assert axis_verdict.finding_of(selection)[0] == found
