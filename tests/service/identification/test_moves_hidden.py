"""What hides between motor and load, told by the motors."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.identification import moves_hidden
from service.identification.axis_explain import HIDDEN
from service.identification.explanation import Candidate
from service.identification.moves_hidden import (
    Gain,
    as_heard_by_motors,
    closed,
    hidden,
    judged_by_motors,
    promising,
    swinging,
)
from service.identification.moves_motors import left_by_motors
from service.identification.selection import Trial
from tests.service.identification.a_second_gap import loud, two_gaps


def trial(
    by_motors: float, validation: float = 1.2, limits: tuple[str, ...] = (), moves: int = 10
) -> Trial[Any]:
    """A trial whose motors are left at so much in the held-out moves."""
    blocks = np.full(moves, by_motors**2) * np.linspace(0.9, 1.1, moves)
    return Trial(
        SimpleNamespace(fitted="fitted"), 1.0, validation, blocks, np.zeros(0), 100.0, at_limits=limits
    )


def as_heard(one: Trial[Any]) -> Trial[Any]:
    return replace(one, validation_rms=float(np.sqrt(np.mean(one.validation_blocks))))


@pytest.mark.parametrize(
    ("errors", "after", "why"),
    [
        ((3.0, 1.2), trial(1.5), "what the motors speak of, in the held-out moves, too"),
        ((3.0, 2.9), trial(1.5), "leaves the motors' equations of motion as they are"),
        (
            (3.0, 1.2),
            trial(3.9),
            "takes from the motors' equations of motion in the moves that were fitted only",
        ),
        (
            (3.0, 1.2),
            replace(trial(1.5), train_rms=1.7),
            "what the motors speak of, but it leaves too much of the moves that were fitted",
        ),
        ((3.0, 1.2), trial(1.5, 3.0), "what the motors speak of, but it raises the held-out error"),
        ((3.0, 1.2), trial(1.5, 1.2, ("X1.clearance",)), "only with X1.clearance where no such effect is"),
    ],
)
def test_the_motors_must_say_the_same_in_moves_that_were_not_fitted(
    monkeypatch: pytest.MonkeyPatch, errors: tuple[float, float], after: Trial[Any], why: str
) -> None:
    monkeypatch.setattr(moves_hidden, "closed", lambda _fitted: ())
    trials = (trial(4.0), after)
    heard = (as_heard(trials[0]), as_heard(after))
    judged = judged_by_motors("gearbox_clearance", Gain(errors, (5.0, 2.0)), trials, heard, 20)
    assert judged.why == why
    assert judged.accepted is (why == "what the motors speak of, in the held-out moves, too")


@pytest.mark.parametrize(("left", "accepted"), [(7.68, False), (3.9, True), (5.0, True)])
def test_what_leaves_the_other_moves_as_they_are_has_no_name(
    monkeypatch: pytest.MonkeyPatch, left: float, accepted: bool
) -> None:
    """A film of grease that two gaps imitate where they were fitted: the motors are louder there, and quieter with two
    gaps, but the accelerometer of the other moves stays as it was."""
    monkeypatch.setattr(moves_hidden, "closed", lambda _fitted: ())
    trials = (trial(4.0, 7.81), trial(1.5, left))
    heard = (as_heard(trials[0]), as_heard(trials[1]))
    judged = judged_by_motors("gearbox_clearance", Gain((3.0, 1.2), (5.0, 2.0)), trials, heard, 20)
    assert judged.accepted is accepted
    assert ("leaves the other moves as they are" in judged.why) is not accepted


@pytest.mark.parametrize(
    ("before", "after", "accepted"),
    [(1.57, 1.76, False), (1.57, 1.5, True), (1.0, 1.28, True), (1.0, 1.31, False)],
)
def test_what_foretells_other_moves_worse_than_the_model_before_has_no_name(
    monkeypatch: pytest.MonkeyPatch, before: float, after: float, accepted: bool
) -> None:
    """But for what numbers may spoil that the fitted moves do not tell well: a film of grease would have been two gaps,
    22 um beside the backlash that was right."""
    monkeypatch.setattr(moves_hidden, "closed", lambda _fitted: ())
    trials = (trial(4.0, before), trial(1.1, after))
    heard = (as_heard(trials[0]), as_heard(trials[1]))
    judged = judged_by_motors("gearbox_clearance", Gain((3.0, 1.2), (5.0, 2.0)), trials, heard, 20)
    assert judged.accepted is accepted
    assert ("raises the held-out error" in judged.why) is not accepted


@pytest.mark.parametrize(
    ("gaps", "none"),
    [
        ((60e-6, 10e-6), ()),
        ((0.1e-6, 64e-6), ("X1.backlash",)),
        ((60e-6, 0.2e-6), ("X1.clearance",)),
    ],
)
def test_all_play_beside_none_is_one_gap(
    monkeypatch: pytest.MonkeyPatch, gaps: tuple[float, float], none: tuple[str, ...]
) -> None:
    """A sensor that rang on its mount was a load behind a pinion that chattered in all of the play."""
    values = dict(zip(("X1.backlash", "X1.clearance"), gaps, strict=True))
    monkeypatch.setattr(moves_hidden, "values_at", lambda _found: values)
    assert closed(cast(Any, SimpleNamespace(model=SimpleNamespace(axes=("X1",))))) == none


def test_of_a_gantry_one_side_may_have_the_second_gap(monkeypatch: pytest.MonkeyPatch) -> None:
    values = {"X1.backlash": 4e-5, "X2.backlash": 5e-5, "X1.clearance": 1e-5, "X2.clearance": 1e-8}
    monkeypatch.setattr(moves_hidden, "values_at", lambda _found: values)
    assert closed(cast(Any, SimpleNamespace(model=SimpleNamespace(axes=("X1", "X2"))))) == ()


@pytest.mark.parametrize(
    ("together", "samples", "accepted"),
    [((3.7, 1.1), 2.0, True), ((3.7, 1.2), 2.0, False), ((3.7, 1.1), 3.0, False)],
    ids=["described", "not described", "samples gain little"],
)
def test_of_a_pinion_that_chatters_the_samples_of_the_other_moves_may_be_the_witness(
    monkeypatch: pytest.MonkeyPatch, together: tuple[float, float], samples: float, accepted: bool
) -> None:
    """The motors gain a little there, in every move, but not half of what they leave."""
    monkeypatch.setattr(moves_hidden, "closed", lambda _fitted: ())
    trials = (trial(9.0, 3.5), trial(7.5, samples))
    heard = (as_heard(trials[0]), as_heard(trials[1]))
    judged = judged_by_motors("gearbox_clearance", Gain(together, (15.0, 1.1)), trials, heard, 20)
    assert judged.accepted is accepted


@pytest.mark.parametrize(
    ("of_motors", "held_out"), [((1.4, 1.3), 4.0), ((5.0, 2.0), 0.8)], ids=["fitted", "held out"]
)
def test_what_the_accelerometer_alone_gains_is_not_what_the_motors_speak_of(
    monkeypatch: pytest.MonkeyPatch, of_motors: tuple[float, float], held_out: float
) -> None:
    """A bent contact was called a second gap: samples and motors together gained, and of the motors hardly anything."""
    monkeypatch.setattr(moves_hidden, "closed", lambda _fitted: ())
    gain, trials = Gain((1.7, 1.2), of_motors), (trial(held_out), trial(0.7 * held_out))
    heard = (as_heard(trials[0]), as_heard(trials[1]))
    judged = judged_by_motors("gearbox_clearance", gain, trials, heard, 20)
    assert (judged.accepted, judged.why) == (False, "leaves the motors' equations of motion as they are")


@pytest.mark.parametrize(
    ("of_motors", "fitted", "held_out", "why"),
    [
        ((1.0, 0.9), 1.05, 1.05, "what the samples speak of, in the held-out moves, too"),
        (
            (1.0, 0.9),
            1.05,
            2.0,
            "what the motors do not speak of, and it leaves a part of what the samples show",
        ),
        (
            (1.0, 0.9),
            2.0,
            1.05,
            "what the motors do not speak of, and it leaves a part of what the samples show",
        ),
        ((1.0, 1.6), 1.05, 1.05, "leaves the motors' equations of motion as they are"),
    ],
    ids=["all gone", "of the fitted only", "of the others only", "contradicted since"],
)
def test_what_content_motors_do_not_feel_the_samples_must_show_nearly_all_of(
    monkeypatch: pytest.MonkeyPatch, of_motors: tuple[float, float], fitted: float, held_out: float, why: str
) -> None:
    """The motor of a heavy drive felt nothing of a second gap, of which the samples left 2.2."""
    monkeypatch.setattr(moves_hidden, "closed", lambda _fitted: ())
    trials = (
        replace(trial(2.4, 2.4), train_rms=2.2),
        replace(trial(held_out, held_out), train_rms=fitted),
    )
    heard = (as_heard(trial(1.0)), as_heard(trial(0.9)))
    judged = judged_by_motors("gearbox_clearance", Gain((2.0, 0.9), of_motors), trials, heard, 20)
    assert judged.why == why


@pytest.mark.parametrize(("after", "accepted"), [(0.5, True), (1.1, False)], ids=["put too high", "right"])
def test_how_loud_the_motors_are_is_judged_over_what_is_left_of_them_where_their_noise_is_put_too_high(
    monkeypatch: pytest.MonkeyPatch, after: float, accepted: bool
) -> None:
    """1.3 of a noise of which the right model leaves half speak as loud as 2.6."""
    monkeypatch.setattr(moves_hidden, "closed", lambda _fitted: ())
    trials = (trial(1.3, 1.4), trial(after, 1.0))
    heard = (as_heard(trials[0]), as_heard(trials[1]))
    judged = judged_by_motors("gearbox_clearance", Gain((1.8, 1.0), (3.3, 1.2)), trials, heard, 20)
    assert judged.accepted is accepted


def test_a_gain_that_few_samples_show_is_chance(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(moves_hidden, "closed", lambda _fitted: ())
    noisy = replace(trial(4.0), validation_blocks=np.array([1.0, 60.0, 2.0]), independent=3.0)
    after = replace(trial(2.0), validation_blocks=np.array([2.0, 9.0, 2.5]), independent=3.0)
    heard = (as_heard(noisy), as_heard(after))
    judged = judged_by_motors("gearbox_clearance", Gain((3.0, 1.2), (5.0, 2.0)), (noisy, after), heard, 20)
    assert (judged.accepted, judged.why) == (False, "gain within what chance does")
    assert judged.p_value > 0.01


@pytest.mark.parametrize(
    ("nearest", "of_samples", "described", "names", "hinted"),
    [
        (1.2, 1.1, False, ("gearbox_clearance",), False),
        (1.2, 1.1, True, ("gearbox_clearance",), False),
        (2.4, 1.9, False, (), True),
        (2.4, 2.2, False, (), True),
        (1.9, 3.1, False, ("gearbox_clearance",), False),
        (1.9, 4.1, False, ("gearbox_clearance",), False),
        (2.9, 1.9, False, (), False),
    ],
)
def test_less_than_half_is_a_hint_and_next_to_nothing_none(
    monkeypatch: pytest.MonkeyPatch,
    nearest: float,
    of_samples: float,
    described: bool,
    names: tuple[str, ...],
    hinted: bool,
) -> None:
    """Of the fits in the best valleys the one counts that is nearest to samples and motors. Its play is otherwise
    divided unless all moves are described with it, or the samples of those that were fitted are far off, farther where
    half of what shows is gone."""
    effect = SimpleNamespace(name="gearbox_clearance")

    def one(rms: float, *effects: Any) -> Any:
        left = np.array([0.9 * rms])
        return SimpleNamespace(
            rms=of_samples,
            rms_with_motors=rms,
            motors=left,
            moves=(),
            model=SimpleNamespace(effects=effects),
        )

    base = one(3.0)
    fits = [one(2.95, effect), one(nearest, effect)]
    before: Trial[Any] = replace(trial(4.0), model=SimpleNamespace(fitted=base))
    monkeypatch.setattr(moves_hidden, "as_heard_by_motors", as_heard)
    monkeypatch.setattr(moves_hidden, "candidates", lambda *_: [effect])
    monkeypatch.setattr(moves_hidden, "promising", lambda *_: fits)
    monkeypatch.setattr(moves_hidden, "on_all_moves", lambda _base, fits, _present: fits[-1])
    monkeypatch.setattr(moves_hidden, "at_present", lambda found: found)
    monkeypatch.setattr(moves_hidden, "left_by_motors", lambda found: found.motors)
    monkeypatch.setattr(moves_hidden, "nothing_left", lambda _found: described)
    monkeypatch.setattr(moves_hidden, "describes_all", lambda _before, _trial: described)
    divided: list[float] = []
    monkeypatch.setattr(
        moves_hidden, "otherwise_divided", lambda found: divided.append(found.rms_with_motors) or found
    )
    monkeypatch.setattr(moves_hidden, "closed", lambda _fitted: ())
    monkeypatch.setattr(moves_hidden, "trial_of", lambda _scene, _found, thorough: trial(1.5))
    told: list[str] = []
    found = hidden(cast(Any, None), before, HIDDEN, 20, told.append)
    assert (found.effects, found.witnessed, found.hinted) == (names, names, hinted)
    assert len(found.candidates) == 1
    assert (found.after is before) is (not names)
    assert len(told) == 1
    asked = not described and of_samples < (4.0 if nearest < 2.0 else 2.0)
    assert divided == [nearest] * asked, "also of what is next to nothing, as a wrong division is"


@pytest.mark.parametrize(
    ("left", "right", "seeds"),
    [(1.1, 2, [1, 4]), (1.1, 9, [1, 4, 7]), (1.1, 1, [1]), (1.3, 2, [1])],
    ids=["found then", "not found", "found at once", "describes not even those"],
)
def test_what_describes_the_fitted_moves_and_their_motors_and_not_the_others_is_searched_once_more(
    monkeypatch: pytest.MonkeyPatch, left: float, right: int, seeds: list[int]
) -> None:
    """A gap of 48 um beside 173 um left 1.10 of samples and motors, 1.00 of the samples, and 1.61 of the other moves;
    of seven searches from different seeds five led to one that described those, too."""
    base = SimpleNamespace(motors=np.array([3.0]), model=None)
    before: Trial[Any] = replace(trial(2.0), model=SimpleNamespace(fitted=base))
    begun, gain = list[int](), Gain((3.0, left), (8.0, 1.5))

    def promising(*args: Any) -> list[Any]:
        begun.append(args[3])
        return ["valley"]

    def judged(*_: Any) -> Candidate:
        return Candidate("gearbox_clearance", 1.0, 0.0, len(begun) == right)

    monkeypatch.setattr(moves_hidden, "promising", promising)
    monkeypatch.setattr(moves_hidden, "nearest_trial", lambda *_: ("gearbox_clearance", trial(1.0), gain))
    monkeypatch.setattr(moves_hidden, "judged_by_motors", judged)
    monkeypatch.setattr(moves_hidden, "as_heard_by_motors", as_heard)
    monkeypatch.setattr(moves_hidden, "candidates", lambda *_: [None])
    monkeypatch.setattr(moves_hidden, "at_present", lambda found: found)
    monkeypatch.setattr(moves_hidden, "left_by_motors", lambda found: found.motors)
    found = moves_hidden.hidden(cast(Any, None), before, (), 18, lambda _text: None)
    assert begun == seeds
    assert found.hinted is not bool(found.effects)


@pytest.mark.parametrize(
    ("by_motors", "samples", "why"),
    [
        (2.1, 1.2, "explains nothing of a few moves and their motors"),
        (3.1, 1.2, "explains nothing of a few moves and their motors"),
        (1.7, 2.0, "explains nothing of a few moves and their motors"),
        (1.7, 1.2, "explains nothing of a few moves and their motors"),
        (1.7, 1.1, "needed by no motor once the model is fitted to them, too"),
    ],
    ids=["contradicted", "plainly", "by samples", "by samples, a little", "by numbers"],
)
def test_what_few_moves_and_their_motors_speak_against_is_not_fitted_to_all(
    monkeypatch: pytest.MonkeyPatch, by_motors: float, samples: float, why: str
) -> None:
    """A ripple leaves the motors' equations of motion, too: two gaps take none of it. What other numbers of the model
    take away is not searched for at all, if they describe the samples, too. What motors plainly contradict, however
    the model is fitted to them, lacks something even so."""
    searched: list[Any] = []
    effect = SimpleNamespace(name="gearbox_clearance")
    before: Trial[Any] = replace(
        trial(4.0), model=SimpleNamespace(fitted=SimpleNamespace(model="declared", rms=samples))
    )
    monkeypatch.setattr(moves_hidden, "as_heard_by_motors", as_heard)
    monkeypatch.setattr(moves_hidden, "candidates", lambda *_: [effect])
    monkeypatch.setattr(moves_hidden, "at_present", lambda found: found)
    monkeypatch.setattr(moves_hidden, "left_by_motors", lambda _found: np.array([1.0, by_motors]))
    monkeypatch.setattr(moves_hidden, "promising", lambda *asked: searched.append(asked) or [])
    found = hidden(cast(Any, None), before, HIDDEN, 20, lambda _text: None)
    assert len(searched) == (why != "needed by no motor once the model is fitted to them, too")
    assert (found.effects, found.hinted, found.after) == ((), by_motors > 3.0, before)
    assert [(c.effect, c.accepted, c.why) for c in found.candidates] == [("gearbox_clearance", False, why)]


@pytest.mark.parametrize(
    ("present", "body", "of_all"),
    [(2.6, 2.2, 0.9), (11.1, 2.5, 0.9), (11.1, 1.6, 3.2)],
    ids=["too little", "far from a few", "far from all"],
)
def test_what_swings_is_fitted_to_all_moves_if_half_is_gone_with_it_and_little_left(
    monkeypatch: pytest.MonkeyPatch, present: float, body: float, of_all: float
) -> None:
    """Of an RMS of 2.6 with the motors 0.9 is left with a mass on the carriage, 2.2 with a body under the axis; of 11,
    2.5 with a body, which does not describe a few moves and does no better of all, or 1.6 of these and 3.2 of all."""
    best = {"hung_mass_mode": 0.9, "machine_body_mode": body}
    fitted: list[float] = []

    def fit(_few: Any, model: str, *_: Any) -> Any:
        return two_gaps(0.0, 0.0, best[model])

    def at_all(_few: Any, model: str, machines: Any) -> list[Any]:
        assert machines == ({}, {"X1.gear_mass": 0.05}), "the present machine's and the smooth fit's"
        one = two_gaps(0.0, 0.0, 1.1 * best[model])
        one.model, one.at = model, None
        return [two_gaps(0.0, 0.0, 5.0), one]

    kinds = [SimpleNamespace(name=name, model=name) for name in best]
    monkeypatch.setattr(moves_hidden, "asked", lambda _found: ())
    monkeypatch.setattr(moves_hidden, "left_at_present", lambda _few, _found: present)
    monkeypatch.setattr(moves_hidden, "candidates", lambda *_: kinds)
    monkeypatch.setattr(moves_hidden, "put_back", lambda _found: {})
    monkeypatch.setattr(moves_hidden, "at_all_frequencies", at_all)
    monkeypatch.setattr(moves_hidden, "fit", fit)

    def on_all_moves(_base: Any, ones: Any, _present: Any) -> Any:
        fitted.append(ones[0].rms_with_motors)
        return SimpleNamespace(rms=of_all if ones[0].rms_with_motors == body else 0.9)

    monkeypatch.setattr(moves_hidden, "on_all_moves", on_all_moves)
    monkeypatch.setattr(moves_hidden, "at_present", lambda found: found)
    monkeypatch.setattr(moves_hidden, "settled", lambda one, _rounds: one)
    monkeypatch.setattr(moves_hidden, "judged", lambda _scene, _before, _found: "tried")
    base = SimpleNamespace(model="declared", at=None)
    before: Trial[Any] = replace(trial(4.0), model=SimpleNamespace(fitted=base))
    told: list[str] = []
    scene: Any = SimpleNamespace(smooth={"X1.gear_mass": 0.05})
    assert swinging(scene, before, (), told.append) == {"hung_mass_mode": "tried"}
    assert fitted == ([0.9, body] if body < 2.0 else [0.9])
    assert len(told) == 2


def test_a_valley_is_promising_if_it_takes_a_part_of_what_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an RMS of 2, 3 are left of its square beside the noise: two fifths of that, and not more than the best few."""
    monkeypatch.setattr(moves_hidden, "asked", lambda _found: ())
    monkeypatch.setattr(moves_hidden, "left_at_present", lambda _few, _found: 2.0)
    valleys = [two_gaps(0.0, 0.0, rms) for rms in (1.1, 1.2, 1.3, 1.4, 1.66, 1.69)]
    monkeypatch.setattr(moves_hidden, "valleys", lambda *_: valleys)
    base: Any = SimpleNamespace(model=None, at=None, rms=3.0)
    assert promising(cast(Any, None), base, cast(Any, None)) == valleys[:4]
    monkeypatch.setattr(moves_hidden, "valleys", lambda *_: valleys[3:])
    assert promising(cast(Any, None), base, cast(Any, None)) == valleys[3:5]
    far_off = [two_gaps(0.0, 0.0, rms) for rms in (3.9, 4.1)]
    monkeypatch.setattr(moves_hidden, "left_at_present", lambda _few, _found: 9.0)
    monkeypatch.setattr(moves_hidden, "valleys", lambda *_: far_off)
    near = promising(cast(Any, None), base, cast(Any, None))
    assert near and all(one is far_off[0] for one in near), "none that is hopeless"


@pytest.mark.parametrize(
    ("rms", "present", "first", "near"),
    [
        (1.1, 2.0, 1.75, [1.2]),
        (1.1, 2.0, 1.6, [1.6]),
        (1.1, 2.0, 1.95, []),
        (3.0, 2.0, 1.75, []),
        (6.0, 9.0, 3.5, [1.2, 3.5]),
        (6.0, 9.0, 2.4, [2.4]),
        (6.0, 9.0, 4.5, []),
    ],
    ids=["none", "one", "not worth following", "samples not described", "afar", "near", "hopeless"],
)
def test_valleys_are_searched_again_where_a_gap_is_likely_and_none_near(
    monkeypatch: pytest.MonkeyPatch, rms: float, present: float, first: float, near: list[float]
) -> None:
    """Of an RMS of 2 an RMS of 1.75 takes a third, which is worth following, and 1.6 two fifths or more. Where only the
    motors are not described, a gap is likely; where a valley that takes most of what shows leaves much, it is a wrong
    one."""
    monkeypatch.setattr(moves_hidden, "asked", lambda _found: ())
    monkeypatch.setattr(moves_hidden, "left_at_present", lambda _few, _found: present)
    seeds: list[int] = []

    taken_over: list[Any] = []

    def valleys(_scene: Any, _base: Any, _candidate: Any, seed: int, begun: Any) -> list[Any]:
        seeds.append(seed)
        taken_over.append(begun)
        return [two_gaps(0.0, 0.0, first if len(seeds) == 1 else 1.2)]

    monkeypatch.setattr(moves_hidden, "valleys", valleys)
    base: Any = SimpleNamespace(model=None, at=None, rms=rms)
    begun: Any = {"gearbox_clearance": "begun near by"}
    candidate: Any = SimpleNamespace(name="gearbox_clearance")
    found = promising(cast(Any, None), base, candidate, near=begun)
    assert len(seeds) == len(set(seeds)) == (2 if 1.2 in near else 1)
    assert taken_over == ["begun near by", None][: len(seeds)]
    assert not begun, "its random numbers go on: it cannot be taken over twice"
    assert [one.rms_with_motors for one in found] == near


def test_what_is_begun_near_by_is_begun_once(monkeypatch: pytest.MonkeyPatch) -> None:
    counted: list[str] = []
    monkeypatch.setattr(moves_hidden, "candidates", lambda *_: [SimpleNamespace(name="gearbox_clearance")])
    monkeypatch.setattr(moves_hidden, "begun_near", lambda _s, _b, one: counted.append(one.name) or "begun")
    monkeypatch.setattr(moves_hidden, "comes_nearer", lambda _base, begun: begun == "begun")
    before: Any = SimpleNamespace(model=SimpleNamespace(fitted=SimpleNamespace(model=None)))
    near: Any = {}
    assert moves_hidden.leads(cast(Any, None), before, (), near)
    assert moves_hidden.leads(cast(Any, None), before, (), near)
    assert counted == ["gearbox_clearance"] and near == {"gearbox_clearance": "begun"}


@pytest.mark.parametrize(
    ("at_once", "after_rounds", "pinions", "reached"),
    [(1.0, 1.2, False, 1.0), (3.8, 3.6, False, 3.6), (3.8, 3.6, True, 3.8)],
)
def test_a_valley_of_what_swings_is_carried_to_all_moves_with_and_without_samples_first(
    monkeypatch: pytest.MonkeyPatch, at_once: float, after_rounds: float, pinions: bool, reached: float
) -> None:
    """The samples alone led out of a valley that samples and motors of a few moves had found; where a pinion lies
    between two gaps nothing came nearer so."""
    monkeypatch.setattr(moves_hidden, "pinions_lie", lambda _model: pinions)
    monkeypatch.setattr(moves_hidden, "noted", lambda found, _moves: found)
    monkeypatch.setattr(moves_hidden, "carried", lambda _base, _one, rounds: rounds)
    ends = {0: at_once, moves_hidden.FIRST_ROUNDS: after_rounds}
    monkeypatch.setattr(moves_hidden, "jointly", lambda rounds: two_gaps(0.0, 0.0, ends[rounds]))
    monkeypatch.setattr(moves_hidden, "led_through_rests", lambda found: found)
    base: Any = SimpleNamespace(moves=())
    assert moves_hidden.on_all_moves(base, [two_gaps(0.0, 0.0)], loud()).rms_with_motors == reached


@pytest.mark.parametrize(
    ("second", "of_present", "followed"),
    [(1.6, 6.0, [1.5, 1.6]), (2.0, 6.0, [1.5]), (1.6, 1.6, [])],
    ids=["two about as near", "one nearest", "none takes a part of what is left"],
)
def test_of_many_valleys_the_nearest_to_all_moves_are_followed(
    monkeypatch: pytest.MonkeyPatch, second: float, of_present: float, followed: list[float]
) -> None:
    monkeypatch.setattr(moves_hidden, "pinions_lie", lambda _model: True)
    monkeypatch.setattr(moves_hidden, "noted", lambda found, _moves: found)
    monkeypatch.setattr(moves_hidden, "carried", lambda _base, one, rounds: (one.rms_with_motors, rounds))
    monkeypatch.setattr(moves_hidden, "jointly", lambda begun: two_gaps(0.0, 0.0, begun[0]))
    led: list[float] = []
    monkeypatch.setattr(
        moves_hidden, "led_through_rests", lambda found: led.append(found.rms_with_motors) or found
    )
    base: Any = SimpleNamespace(moves=())
    begun = [two_gaps(0.0, 0.0, rms) for rms in (second, 3.0, 1.5, 4.0)]
    assert moves_hidden.on_all_moves(base, begun, loud(of_present)).rms_with_motors == 1.5
    assert led == followed


def test_a_valley_that_describes_samples_and_motors_is_carried_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(moves_hidden, "pinions_lie", lambda _model: False)
    monkeypatch.setattr(moves_hidden, "noted", lambda found, _moves: found)
    carried: list[int] = []
    monkeypatch.setattr(moves_hidden, "carried", lambda _base, _one, rounds: carried.append(rounds))
    monkeypatch.setattr(moves_hidden, "jointly", lambda _begun: two_gaps(0.0, 0.0, 1.0))
    monkeypatch.setattr(moves_hidden, "led_through_rests", lambda found: found)
    base: Any = SimpleNamespace(moves=())
    assert moves_hidden.on_all_moves(base, [two_gaps(0.0, 0.0)], loud()).rms_with_motors == 1.0
    assert carried == [0]


def test_the_held_out_motors_are_those_of_the_moves_as_they_were_predicted(found: Any) -> None:
    explained: Any = SimpleNamespace(
        fitted=found, held=SimpleNamespace(simulated=found.moves[0], at=found.at)
    )
    heard = as_heard_by_motors(Trial(cast(Any, explained), 1.0, 1.0, np.ones(5), np.zeros(0), 9.0))
    assert heard.validation_rms == pytest.approx(left_by_motors(found)[0])
    assert len(heard.validation_blocks) == len(found.moves[0].grids)
    assert heard.independent > len(heard.validation_blocks)


def test_nothing_is_judged_where_the_held_out_moves_have_no_torque(found: Any) -> None:
    """Their drive did not map it, although that of the train moves did."""
    recording = found.moves[0].recording
    traces = {key: trace for key, trace in recording.traces.items() if key[1] != "motor_torque"}
    silent = replace(found.moves[0], recording=replace(recording, traces=traces))
    explained: Any = SimpleNamespace(fitted=found, held=SimpleNamespace(simulated=silent, at=found.at))
    before: Trial[Any] = Trial(explained, 1.0, 1.0, np.ones(5), np.zeros(0), 9.0)
    assert as_heard_by_motors(before).validation_rms == 0.0
    selection = hidden(cast(Any, None), before, HIDDEN, 20, lambda _text: None)
    assert (selection.effects, selection.candidates, selection.hinted) == ((), (), False)


@pytest.mark.parametrize(
    ("nearest", "follows"),
    [(1.104, True), (1.14, False), (1.13, False)],
    ids=["a third", "chance", "a seventh"],
)
def test_beside_what_was_found_a_gap_that_takes_a_share_of_little_is_followed(
    monkeypatch: pytest.MonkeyPatch, nearest: float, follows: bool
) -> None:
    """Beside Stribeck friction a second gap, begun near by, left 1.104 of 1.148 of a few moves and their motors."""
    begun: Any = SimpleNamespace(few=(), fits=[SimpleNamespace(rms_with_motors=r) for r in (3.0, nearest)])
    before: Any = SimpleNamespace(model=SimpleNamespace(fitted=SimpleNamespace(model=None)))
    monkeypatch.setattr(moves_hidden, "candidates", lambda *_: [SimpleNamespace(name="gearbox_clearance")])
    monkeypatch.setattr(moves_hidden, "begun_near", lambda *_: begun)
    monkeypatch.setattr(moves_hidden, "left_at_present", lambda *_: 1.148)
    near: Any = {}
    assert moves_hidden.may_lead(cast(Any, None), before, (), near) is follows
    assert near == {"gearbox_clearance": begun}
