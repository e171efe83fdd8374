"""The rule by which effects are taken: significant and material on what was not fitted, corrected for the search."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from service.dynamics.effects.driven_library import DRIVEN
from service.identification.explanation import Explanation
from service.identification.regression_effects import play
from service.identification.selection import Limits, Trial, gain_p_value, leads_on, select, sole_fit


def trial(rms: float, seed: int, noise: float = 0.0) -> Trial[str]:
    """Twenty held-out blocks of a given RMS, each with its own luck."""
    luck = 1.0 + noise * np.random.default_rng(seed).standard_normal(20)
    blocks = 50.0 * rms**2 * luck
    return Trial(
        "", rms, float(np.sqrt(blocks.sum() / 1000.0)), blocks, np.zeros(0), 50.0 if noise else 1000.0
    )


def test_chance_among_many_candidates_is_not_taken() -> None:
    before = trial(1.0, 0, 0.3)
    found = select(before, lambda _present, _taken: {f"c{k}": trial(0.985, k, 0.3) for k in range(1, 18)})
    assert found.effects == ()


def test_the_better_of_two_real_gains_is_taken_first() -> None:
    table = {(): {"a": 0.8, "b": 0.6}, ("b",): {"a": 0.5}, ("b", "a"): {}}
    found = select(
        trial(1.0, 0),
        lambda _present, taken: (
            {name: trial(rms, 0) for name, rms in table[taken].items()} or {"c": trial(0.5, 0)}
        ),
    )
    assert found.effects == ("b", "a")
    assert found.after.validation_rms < found.before.validation_rms


@pytest.mark.parametrize(("alone", "effects"), [(0.31, ("body",)), (0.5, ("hung", "body"))])
def test_what_only_led_to_another_effect_is_left_out_again(alone: float, effects: tuple[str, ...]) -> None:
    """A hung mass, taken first for a rocking body, of which the body leaves nothing."""
    table = {(): {"hung": 0.6}, ("hung",): {"body": 0.3}, ("body",): {"hung": 0.31}}
    found = select(
        trial(1.0, 0),
        lambda _present, taken: {name: trial(rms, 0) for name, rms in table[taken].items()},
        limits=Limits(enough=0.35, most=2),
        without=lambda _trial, name: trial({"hung": alone}[name], 0),
    )
    assert found.effects == effects


def test_of_two_that_come_equally_near_the_smaller_is_taken() -> None:
    """A force that grows along the travel contains a constant one."""
    trials = {
        "large": replace(trial(0.49, 0), model="four numbers"),
        "small": replace(trial(0.50, 0), model="one"),
    }
    for size, first in ((lambda t: len(t.model), "small"), (lambda _t: 0, "large")):
        found = select(
            trial(1.0, 0), lambda _p, taken: {} if taken else trials, limits=Limits(enough=0.6), size=size
        )
        assert found.effects == (first,)


@pytest.mark.parametrize(("refined", "kept"), [(1.05, 1.05), (1.3, 1.0)])
def test_what_was_fitted_to_the_end_is_kept_unless_it_predicts_far_worse(refined: float, kept: float) -> None:
    """The end of a fit is where the train moves want it: the held-out ones judge it, and do not choose between ends."""
    before = trial(3.0, 0)
    done = select(
        before,
        lambda _present, _taken: {"sensor_gain": trial(1.0, 1)},
        refine=lambda _trial: trial(refined, 2),
        limits=Limits(most=1),
    )
    assert done.after.validation_rms == pytest.approx(kept, rel=0.05)


def test_an_effect_that_needs_a_number_where_no_such_effect_is_is_not_taken() -> None:
    """A body that hardly swings, damped as no machine is, is a name for something else."""
    body = replace(trial(0.3, 0), at_limits=("body_damping",))
    near = {"body": body, "filter": trial(0.35, 0)}
    found = select(trial(1.0, 0), lambda _present, taken: near if not taken else {"c": trial(0.35, 0)})
    assert found.effects == ("filter",)
    assert next(c.why for c in found.candidates if c.effect == "body").startswith("only with body_damping")
    assert DRIVEN["machine_body_mode"](("X1",)).parameters[2].at_limit(0.3)
    assert not DRIVEN["machine_body_mode"](("X1",)).parameters[2].at_limit(0.02)
    damped = DRIVEN["preload_flank"](("X1",)).parameters[1]
    assert damped.name == "X1.preload_damping_ratio"
    assert damped.at_limit(1.1) and not damped.at_limit(0.2)


def test_nothing_is_named_where_what_is_no_such_effect_comes_far_nearer() -> None:
    """A hung mass that swings on by itself, beside a filter that does a little of the same: something else acts."""
    swinging = replace(trial(0.2, 0), at_limits=("hung_displacement",))
    rounds = [{"hung": swinging, "filter": trial(0.6, 0)}]
    found = select(trial(1.0, 0), lambda _present, _taken: rounds.pop())
    assert found.effects == ()
    assert {c.effect for c in found.candidates} == {"hung", "filter"}


def test_an_error_that_a_model_announces_counts_less_and_the_announcement_against_it() -> None:
    """A fifth of the error, but doubts of six times: no nearer; a tenth of the error, doubled for its doubts, is."""
    before = trial(1.0, 0)
    boasting = replace(trial(0.2, 0), doubt=6.0, validation_blocks=36.0 * trial(0.2, 0).validation_blocks)
    honest = replace(trial(0.1, 0), doubt=2.0, validation_blocks=4.0 * trial(0.1, 0).validation_blocks)
    assert select(before, lambda _present, _taken: {"boasting": boasting}).effects == ()
    assert select(before, lambda _present, _taken: {"honest": honest}).effects == ("honest",)


def test_what_contains_another_is_taken_only_for_a_gain_of_its_own_and_is_no_rival_of_it() -> None:
    """A spring with a preload becomes a constant force when its rate is zero."""

    def contains(name: str) -> tuple[str, ...]:
        return ("force",) if name == "spring" else ()

    for rms, first in ((0.5, "force"), (0.3, "spring")):
        trials = {"force": trial(0.51, 0), "spring": trial(rms, 0)}
        found = select(
            trial(1.0, 0),
            lambda _p, taken, trials=trials: {} if taken else trials,
            limits=Limits(enough=0.6, further=(0.25, 0.6)),
            contains=contains,
        )
        assert found.effects == (first,)
        assert not found.rivals


@pytest.mark.parametrize(
    ("inner", "outer", "named"),
    [
        ((1.03, 1.18), (0.99, 1.0), "spring"),
        ((1.03, 1.18), (1.03, 1.0), "force"),
        ((1.0, 1.08), (0.99, 0.99), "force"),
    ],
)
def test_what_contains_another_is_taken_where_it_explains_nearly_all_that_that_leaves(
    inner: tuple[float, float], outer: tuple[float, float], named: str
) -> None:
    """A soft spring is a constant force, but for a sixth of the held-out error: in all moves, and more than is left
    beside a constant force that is one."""
    before = replace(trial(5.0, 0), train_rms=3.0)
    trials = {
        name: replace(trial(held, 0), train_rms=train)
        for name, (train, held) in (("force", inner), ("spring", outer))
    }
    found = select(
        before,
        lambda _p, taken: {} if taken else trials,
        limits=Limits(enough=0.6, further=(0.25, 1.6)),
        contains=lambda name: ("force",) if name == "spring" else (),
    )
    assert found.effects == (named,)


@pytest.mark.parametrize(
    ("name", "rms", "rivals"), [("filter", 0.54, 1), ("filter", 0.56, 0), ("gain", 0.54, 0)]
)
def test_what_is_nearly_the_same_is_a_rival_as_long_as_it_comes_nearly_as_near(
    name: str, rms: float, rivals: int
) -> None:
    """Of slow motion a filter is a delay."""
    trials = {"latency": trial(0.5, 0), name: trial(rms, 0)}
    found = select(
        trial(1.0, 0),
        lambda _present, taken: {} if taken else trials,
        limits=Limits(enough=0.6, further=(0.25, 0.6)),
        nearly=lambda effect: ("filter",) if effect == "latency" else (),
    )
    assert found.effects == ("latency",)
    assert len(found.rivals) == rivals


def test_an_error_that_only_the_held_out_moves_show_is_searched_for() -> None:
    """A friction that is curved: at the speed of the train moves alone it looks like any other."""
    for held_out, effects in ((3.0, ("curved",)), (1.5, ())):
        before = replace(trial(held_out, 0), train_rms=1.0)
        found = select(
            before, lambda _p, _t: {"curved": trial(1.0, 0)}, limits=Limits(enough=1.25, further=(0.25, 1.6))
        )
        assert found.effects == effects


def test_the_search_ends_with_an_effect_that_explains_nearly_all() -> None:
    """Unless what it leaves is more than its law's difference from the machine's."""
    table = {(): {"a": 3.0}, ("a",): {"b": 2.0}}
    for before, last, effects in ((30.0, 3.0, ("a",)), (30.0, 2.9, ("a", "b")), (5.0, 3.0, ("a", "b"))):
        found = select(
            trial(before, 0),
            lambda _p, taken: {n: trial(r, 0) for n, r in table.get(taken, {"c": 2.0}).items()},
            limits=Limits(further=(0.25, 1.6), last=last),
        )
        assert found.effects == effects


def test_the_search_ends_where_no_effect_explains_as_much_as_several_of_them_would() -> None:
    """The strongest of four effects explains a quarter of the excess variance at least, that of two the half."""
    for first, most, effects in (
        (13.9, 4, ("a",)),
        (12.0, 4, ("a", "b")),
        (12.0, 2, ("a",)),
        (10.0, 2, ("a", "b")),
    ):
        table = {(): {"a": first}, ("a",): {"b": 2.0}}
        found = select(
            trial(15.0, 0),
            lambda _p, taken, table=table: {n: trial(r, 0) for n, r in table.get(taken, {"c": 2.0}).items()},
            limits=Limits(0.05, further=(0.25, 1.6), most=most),
        )
        assert found.effects == effects


@pytest.mark.parametrize(
    ("first", "left", "leads"),
    [(2.35, 1.94, False), (2.96, 1.76, True), (1.9, 1.55, True)],
    ids=["two fifths", "three quarters", "little left"],
)
def test_a_first_effect_that_leaves_what_was_fitted_as_it_was_leads_to_no_second(
    first: float, left: float, leads: bool
) -> None:
    """A load that had changed was described in part by a body that rocks, in the held-out moves before all; of two
    planted effects the first took more than half of both."""
    before, after = (replace(trial(held, 0), train_rms=rms) for rms, held in ((first, 3.0), (left, 2.0)))
    assert leads_on(before, after, 1, 2) is leads


def test_no_gain_has_no_significance() -> None:
    assert gain_p_value(trial(1.0, 0), trial(1.0, 0)) == 1.0
    assert gain_p_value(trial(1.0, 0), trial(0.5, 0)) < 1e-5


def test_play_keeps_its_state_at_rest_and_saturates() -> None:
    state = play(np.array([0.0, 1.0, 2.0, 2.0, 1.5, -3.0]), 1.0)
    assert state.tolist() == [0.0, 1.0, 1.0, 1.0, 0.5, -1.0]


def test_an_explanation_of_nothing_is_still_an_object() -> None:
    assert Explanation(()).as_json() == {"axes": []}


def test_what_contains_an_effect_that_was_taken_before_is_named_in_its_place() -> None:
    """A cable chain pulls with a constant and a changing force: first the constant shows, then what changes."""
    rounds = [{"spring": trial(0.2, 0)}, {"constant": trial(0.5, 0)}]
    found = select(
        trial(1.0, 0),
        lambda _present, _taken: rounds.pop() if rounds else {"else": trial(0.2, 0)},
        contains=lambda name: ("constant",) if name == "spring" else (),
    )
    assert found.effects == ("spring",)


@pytest.mark.parametrize(("named", "taken"), [(1.3, ()), (1.05, ("sensor_gain",))])
def test_what_explains_nearly_all_as_no_such_effect_does_leaves_no_name_to_what_does_not(
    named: float, taken: tuple[str, ...]
) -> None:
    trials = {
        "sensor_gain": trial(named, 0),
        "machine_body_mode": replace(trial(1.02, 0), at_limits=("body_damping",)),
    }
    found = select(trial(2.0, 0), lambda _p, done: {} if done else trials, limits=Limits(0.1, 1.25))
    assert found.effects == taken


@pytest.mark.parametrize(
    ("before", "first", "second", "only"),
    [
        (1.8, 1.02, 1.75, "first"),
        (1.8, 1.02, 1.40, None),  # the second explains a part
        (1.8, 1.15, 1.75, None),  # not nearly all
        (5.0, 1.40, 4.90, None),  # leaves too much
        (1.5, 1.02, 1.45, None),  # impurities leave as much
    ],
)
def test_one_that_alone_describes_what_was_fitted_need_not_gain_much_elsewhere(
    before: float, first: float, second: float, only: str | None
) -> None:
    """Flanks that stiffen strongly left 1.02 of 1.76, and of harder moves 1.84 of 1.95."""
    present = replace(trial(1.95, 0), train_rms=before)
    trials = {
        "first": replace(trial(1.84, 0), train_rms=first),
        "second": replace(trial(1.93, 0), train_rms=second),
    }
    assert sole_fit(present, trials, 1.6) == only
    assert sole_fit(present, {"first": trials["first"]}, 1.6) is None, "nothing else was tried"
    found = select(
        present, lambda _present, taken: {} if taken else trials, limits=Limits(0.1, most=1, sole=1.6)
    )
    assert found.effects == (("first",) if only else ())
    worse = trials | {"first": replace(trial(1.96, 0), train_rms=first)}
    found = select(
        present, lambda _present, taken: {} if taken else worse, limits=Limits(0.1, most=1, sole=1.6)
    )
    assert found.effects == (), "not if it harms what was not fitted"
