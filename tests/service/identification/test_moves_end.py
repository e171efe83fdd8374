"""How a fit is brought to its end."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.dynamics.driven_model import Model
from service.identification import moves_end
from service.identification.held_out import Explained
from service.identification.moves_end import parted
from service.identification.moves_ridges import other_sizes
from service.identification.selection import Trial


def stub(rms: float, name: str = "") -> Any:
    model, at = (
        SimpleNamespace(axes=("X1",), parameters=(), effects=(), lumps=2),
        SimpleNamespace(local=(), shared=()),
    )
    return cast(Any, SimpleNamespace(rms=rms, moves=("every",), model=model, at=at, name=name))


def test_gear_and_pinion_are_begun_as_soft_and_as_heavy_as_the_drive_they_are_of() -> None:
    drive = {"X1.drive_stiffness": 8e5, "X1.drive_mass": 0.06, "X1.drive_damping_ratio": 0.03}
    both = parted(drive, ("X1",))
    assert 1.0 / (1.0 / both["X1.gear_stiffness"] + 1.0 / both["X1.pinion_stiffness"]) == pytest.approx(8e5)
    assert both["X1.gear_mass"] + both["X1.pinion_mass"] == pytest.approx(0.06)
    assert {p.name for p in Model(("X1",), 2).parameters if "gear" in p.name or "pinion" in p.name} <= set(
        both
    )


def test_a_declared_model_that_lacks_something_is_not_finished(monkeypatch: Any) -> None:
    """It is no more than what the effects are compared with."""

    def trial(model: object, rms: float, ended: bool = False) -> Any:
        explained = SimpleNamespace(fitted=SimpleNamespace(model=model), ended=ended)
        return SimpleNamespace(model=explained, train_rms=rms)

    def finished(_found: Any) -> Any:
        raise AssertionError("finished")

    monkeypatch.setattr(moves_end, "in_full", finished)
    scene = cast(Any, SimpleNamespace(declared="declared"))
    for one in (trial("declared", 2.5), trial("with an effect", 1.1, ended=True)):
        assert moves_end.ended(scene, one) is one
    for one in (trial("declared", 1.5), trial("with an effect", 2.5)):
        with pytest.raises(AssertionError, match="finished"):
            moves_end.ended(scene, one)


@pytest.mark.parametrize(
    ("axes", "reached", "known", "wider"),
    [(2, False, 2e-3, True), (2, True, 2e-3, False), (2, False, 0.1, False), (1, False, 2e-3, False)],
)
def test_a_gap_that_the_other_axis_keeps_from_being_crossed_is_not_claimed_to_be_known(
    monkeypatch: pytest.MonkeyPatch, axes: int, reached: bool, known: float, wider: bool
) -> None:
    """The second flank is met at a logarithm of 0: past it nothing changes, but the slope there says it would."""
    names = [f"X{1 + x}.backlash" for x in range(axes)]
    model = SimpleNamespace(axes=names_of(names), parameters=[SimpleNamespace(name=name) for name in names])

    def at(values: dict[str, float]) -> Any:
        u = np.log([values[name] for name in names])
        own = np.where(u > 0.0, u if reached else 0.0, u) / known
        return SimpleNamespace(model=model, moves=(), at=SimpleNamespace(shared=u), values=values, r=own)

    monkeypatch.setattr(moves_end, "values_at", lambda found: found.values)
    monkeypatch.setattr(moves_end, "covariance", lambda _found: np.eye(axes) * known**2)
    monkeypatch.setattr(moves_end, "fitted_from", lambda _found, values, _rounds, _free: at(values))
    monkeypatch.setattr(
        moves_end,
        "fit",
        lambda _m, _model, point, _r: at(dict(zip(names, np.exp(point.shared), strict=True))),
    )
    gaps = moves_end.wider_where_unreached(at(dict.fromkeys(names, 1.0))).values
    assert [bool(gap > 1.01) for gap in gaps.values()] == [wider] * axes


def names_of(parameters: list[str]) -> tuple[str, ...]:
    return tuple(name.partition(".")[0] for name in parameters)


@pytest.mark.parametrize(
    ("left", "held_out", "steadied"),
    [(1.5, 1.5, [(1.5, True)]), (1.04, 1.3, [(1.04, True)]), (1.04, 1.04, [(1.04, False)]), (1.7, 1.7, [])],
    ids=["near", "describes its own only", "describes all", "far"],
)
def test_only_what_may_be_the_whole_explanation_is_steadied_and_elsewhere_if_it_does_not_describe_all(
    monkeypatch: Any, left: float, held_out: float, steadied: list[tuple[float, bool]]
) -> None:
    """Whitened, a likeness that leaves twice the noise leaves more than it did; and where a right fit left up to
    1.05 of all moves, and whitened 1.03 to 1.07, other valleys were looked for in vain for 3 to 7 s (three of three).
    """
    fitted = SimpleNamespace(model=SimpleNamespace(name="likeness"), rms=left)
    explained = Explained(cast(Any, fitted), cast(Any, None))
    trial = Trial(explained, left, held_out, np.zeros(1), np.zeros(0), 1.0)
    done: list[tuple[float, bool]] = []
    monkeypatch.setattr(moves_end, "in_full", lambda one: one)
    monkeypatch.setattr(moves_end, "with_own_errors", lambda one: one)
    monkeypatch.setattr(moves_end, "swings_at_all", lambda _model: False)
    monkeypatch.setattr(moves_end, "settled", lambda one, *_: one)
    monkeypatch.setattr(moves_end, "with_errors_of_added", lambda _scene, one: one)
    monkeypatch.setattr(moves_end, "steady", lambda one, elsewhere: done.append((one.rms, elsewhere)) or one)
    monkeypatch.setattr(moves_end, "led_across", lambda one: one)
    monkeypatch.setattr(moves_end, "trial_of", lambda *_: trial)
    assert moves_end.ended(cast(Any, SimpleNamespace(declared=None)), trial).model.ended
    assert done == steadied


@pytest.mark.parametrize(("foretold", "led"), [(1.0, False), (1.4, True)])
def test_what_foretells_other_moves_badly_is_led_across_samples_at_the_end(
    monkeypatch: Any, foretold: float, led: bool
) -> None:
    fits = {
        name: cast(Any, SimpleNamespace(model=SimpleNamespace(name=name), rms=1.0))
        for name in ("begun", "steady", "led")
    }
    errors = {"begun": 2.0, "steady": foretold, "led": 1.05}

    def trial_of(_scene: Any, found: Any) -> Any:
        explained = Explained(found, cast(Any, None))
        return Trial(explained, 1.0, errors[found.model.name], np.zeros(1), np.zeros(0), 1.0)

    for name in ("in_full", "with_own_errors"):
        monkeypatch.setattr(moves_end, name, lambda one: one)
    monkeypatch.setattr(moves_end, "swings_at_all", lambda _model: False)
    monkeypatch.setattr(moves_end, "settled", lambda one, *_: one)
    monkeypatch.setattr(moves_end, "with_errors_of_added", lambda _scene, one: one)
    monkeypatch.setattr(moves_end, "steady", lambda *_: fits["steady"])
    monkeypatch.setattr(moves_end, "led_across", lambda _one: fits["led"])
    monkeypatch.setattr(moves_end, "trial_of", trial_of)
    scene = cast(Any, SimpleNamespace(declared=None))
    after = moves_end.ended(scene, trial_of(scene, fits["begun"]))
    assert after.model.fitted is fits["led" if led else "steady"]


@pytest.mark.parametrize(
    ("on", "elsewhere", "ridges", "asked", "reached"),
    [
        (1.0, 0.9, moves_end.OF_ADDED, 0, 1.0),
        (1.4, 1.2, moves_end.OF_ADDED, 1, 1.2),
        (4.5, 4.2, moves_end.OF_ADDED, 0, 4.5),
        (4.5, 4.2, moves_end.HOWEVER_FAR, 1, 4.2),
        (1.4, 1.2, moves_end.LOOKED_FOR_NEXT, 0, 1.4),
    ],
)
def test_a_fit_goes_on_from_where_it_stands_and_in_another_valley_only_if_it_is_not_near(
    monkeypatch: Any, on: float, elsewhere: float, ridges: tuple[float, float], asked: int, reached: float
) -> None:
    """What stays hopeless is not followed further, and with an added effect not looked for elsewhere."""
    over: list[float] = []
    later: list[str] = []
    monkeypatch.setattr(moves_end, "begun_anew", lambda found: found)
    monkeypatch.setattr(moves_end, "reconstructed", lambda found: found.moves)
    monkeypatch.setattr(moves_end, "fit", lambda *_: stub(on))
    monkeypatch.setattr(moves_end, "over_ridges", lambda f: over.append(f.rms) or stub(elsewhere))
    for name in ("in_turns", "as_damped", "swung_in"):
        monkeypatch.setattr(moves_end, name, lambda f, name=name: later.append(name) or f)
    assert moves_end.settled(stub(5.0), 3, ridges).rms == reached
    assert over == [on] * asked
    assert later == ([] if reached > moves_end.HOPELESS else ["in_turns", "as_damped", "swung_in"])


@pytest.mark.parametrize(
    ("on", "elsewhere", "smooth", "asked", "reached", "follows"),
    [
        (1.5, 1.2, 2.1, 0, 1.5, True),
        (2.5, 2.4, 2.1, 1, 2.4, False),
        (9.0, 8.0, 2.1, 0, 9.0, False),
        (2.5, 1.8, 2.1, 1, 1.8, True),
        (2.5, 1.8, 1.1, 0, 2.5, False),
    ],
)
def test_a_declared_model_that_lacks_something_is_looked_for_elsewhere_and_not_followed(
    monkeypatch: Any, on: float, elsewhere: float, smooth: float, asked: int, reached: float, follows: bool
) -> None:
    """Unless it is one of the smooth effects, with all of which next to nothing is left."""
    over: list[float] = []
    monkeypatch.setattr(moves_end, "reconstructed", lambda found: found.moves)
    monkeypatch.setattr(moves_end, "fit", lambda *_: stub(on))
    monkeypatch.setattr(moves_end, "over_ridges", lambda f: over.append(f.rms) or stub(elsewhere))
    later: list[float] = []
    monkeypatch.setattr(moves_end, "followed", lambda f, _rounds: later.append(f.rms) or f)
    monkeypatch.setattr(moves_end, "as_motors_tell", lambda found: found)
    assert moves_end.declared_end([stub(5.0)], 3, smooth).rms == reached
    assert over == [on] * asked
    assert later == [reached] * follows


@pytest.mark.parametrize(
    ("ends", "settled", "nearest"),
    [({15.8: 3.3, 16.9: 3.2, 17.0: 6.3}, 3, 3.2), ({2.7: 2.69, 2.8: 2.6}, 1, 2.69), ({16.0: 3.0}, 1, 3.0)],
    ids=["most goes by settling", "the first is the nearest", "there is one"],
)
def test_other_fits_of_the_declared_model_are_settled_where_that_decides_how_near_they_come(
    monkeypatch: pytest.MonkeyPatch, ends: dict[float, float], settled: int, nearest: float
) -> None:
    asked = list[float]()

    def end_of(found: Any, _rounds: int, _elsewhere: bool) -> Any:
        asked.append(found.rms)
        return stub(ends[found.rms])

    monkeypatch.setattr(moves_end, "settled_present", end_of)
    monkeypatch.setattr(moves_end, "as_motors_tell", lambda found: found)
    assert moves_end.declared_end(map(stub, ends), 12, np.inf).rms == nearest
    assert len(asked) == settled


@pytest.mark.parametrize(
    ("first", "other", "smooth", "reached"),
    [(2.6, 1.5, 2.1, 1.5), (2.6, 2.5, 2.1, 2.6), (1.9, 1.5, 2.1, 1.9), (2.6, 1.5, 1.1, 2.6)],
    ids=["nearer", "hardly nearer", "sound as it is", "a smooth effect is missing"],
)
def test_the_declared_model_ends_where_its_motors_tell_if_that_is_nearer(
    monkeypatch: pytest.MonkeyPatch, first: float, other: float, smooth: float, reached: float
) -> None:
    monkeypatch.setattr(moves_end, "settled_present", lambda found, *_: found)
    monkeypatch.setattr(moves_end, "as_motors_tell", lambda _found: stub(other))
    assert moves_end.declared_end([stub(first)], 12, smooth).rms == reached


@pytest.mark.parametrize(
    ("rms", "nearer", "asked", "reached"),
    [
        (1.2, 0.5, 0, 1.2),
        (1.9, 0.5, 1, 0.95),
        (1.9, 0.999, 1, 1.9),
        (3.0, 0.9, 3, 3.0 * 0.9**3),
        (4.5, 0.5, 0, 4.5),
    ],
)
@pytest.mark.parametrize("by", [None, other_sizes], ids=["the chain", "the effect's own numbers"])
def test_a_fit_that_may_be_the_right_one_and_leaves_too_much_is_led_over_further_ridges(
    monkeypatch: Any, by: Any, rms: float, nearer: float, asked: int, reached: float
) -> None:
    """By its chain, or by its effect's own numbers where that leads nowhere; as often as that is nearer, three times at
    most, and followed each time."""
    over: list[float] = []
    later: list[float] = []

    def over_ridges(f: Any, others: Any = None) -> Any:
        if others is by:
            over.append(f.rms)
            return stub(nearer * f.rms)
        return f

    monkeypatch.setattr(moves_end, "over_ridges", over_ridges)
    monkeypatch.setattr(moves_end, "followed", lambda f, _rounds: later.append(f.rms) or f)
    assert moves_end.led_on(stub(rms)).rms == pytest.approx(reached)
    assert len(over) == asked
    assert len(later) == (asked if reached < rms else 0)


def test_a_hopeless_fit_is_led_on_where_the_chain_is_another_alone(monkeypatch: Any) -> None:
    """And followed once it is near."""
    over: list[tuple[float, Any]] = []
    later: list[float] = []

    def over_ridges(f: Any, others: Any = None) -> Any:
        over.append((f.rms, others))
        return stub(0.4 * f.rms)

    monkeypatch.setattr(moves_end, "over_ridges", over_ridges)
    monkeypatch.setattr(moves_end, "followed", lambda f, _rounds: later.append(f.rms) or f)
    assert moves_end.led_on(stub(20.0)).rms == 20.0
    assert moves_end.led_on(stub(20.0), np.inf).rms == pytest.approx(1.28)
    assert [(pytest.approx(rms), None) for rms in (20.0, 8.0, 3.2)] == over
    assert later == pytest.approx([3.2, 1.28])
    monkeypatch.setattr(moves_end, "over_ridges", lambda f, others=None: over.append((f.rms, others)) or f)
    over.clear()
    assert moves_end.led_on(stub(20.0), np.inf).rms == 20.0
    assert over == [(20.0, None)]


def test_what_is_followed_farther_off_is_not_tried_again(monkeypatch: Any) -> None:
    over: list[float] = []
    monkeypatch.setattr(moves_end, "over_ridges", lambda f, *_: over.append(f.rms) or stub(1.8))
    monkeypatch.setattr(moves_end, "followed", lambda _f, _rounds: stub(2.0))
    assert moves_end.led_on(stub(1.9)).rms == 1.9
    assert over == [1.9]


@pytest.mark.parametrize(
    ("mass", "rms", "again", "kept"),
    [(5.0, 1.8, 1.1, 1.1), (5.0, 1.8, 1.9, 1.8), (5.0, 1.0, 0.9, 1.0), (3.0, 1.8, 1.1, 1.8)],
)
def test_a_chain_in_a_corner_is_begun_anew_with_a_motion_of_its_own(
    monkeypatch: Any, mass: float, rms: float, again: float, kept: float
) -> None:
    """The motion that was made with the wrong chain fits no other: as far as that goes the new fit is farther off."""
    numbers = [SimpleNamespace(name=name) for name in ("X1.coulomb", "X1.gear_mass")]
    found = stub(rms)
    found.model.parameters, found.at.shared = numbers, (6.0, mass)
    monkeypatch.setattr(moves_end, "put_back", lambda *_: {"typical": 1.0})
    monkeypatch.setattr(moves_end, "chain", lambda _model: {"gear_mass"})
    monkeypatch.setattr(moves_end, "fitted_from", lambda _f, values, _n: stub(9.0, *values))
    monkeypatch.setattr(moves_end, "reconstructed", lambda one: one.name)
    monkeypatch.setattr(moves_end, "fit", lambda moves, *_: stub(again if moves == "typical" else 9.0))
    assert moves_end.out_of_corner(found, 3).rms == kept


@pytest.mark.parametrize(("without", "kept"), [(1.15, "sound"), (1.4, "overdamped")])
def test_damping_that_no_chain_has_is_put_back_where_no_sample_tells_it(
    monkeypatch: Any, without: float, kept: str
) -> None:
    """What tells it is a fit that comes no nearer without it, nor by the loads' speeds."""
    held: list[int] = []

    def refit(_found: Any, values: dict[str, float], _rounds: int, free: Any) -> Any:
        begun.append(values)
        held.extend(sorted({0, 1} - set(free)))
        return SimpleNamespace(rms=without, at="sound")

    model = SimpleNamespace(
        parameters=[SimpleNamespace(name=n) for n in ("X1.gear_damping_ratio", "X1.coulomb")]
    )
    found = cast(Any, SimpleNamespace(rms=1.1, moves=(), model=model, at=SimpleNamespace(local=())))
    values = {"X1.gear_damping_ratio": 3.0, "X1.coulomb": 0.3}
    begun: list[dict[str, float]] = []
    monkeypatch.setattr(moves_end, "overdamped", lambda _found: ("X1.gear_damping_ratio",))
    monkeypatch.setattr(moves_end, "values_at", lambda _found: values)
    monkeypatch.setattr(moves_end, "fitted_from", refit)
    monkeypatch.setattr(moves_end, "fit", lambda *_: SimpleNamespace(rms=without, at="sound"))
    monkeypatch.setattr(moves_end, "begun_by_speeds", lambda found: found)
    damped = moves_end.as_damped(found)
    assert (damped is found) == (kept == "overdamped")
    assert begun == [{"X1.coulomb": 0.3}], "a value that is not given is the typical one"
    assert held == [0]


@pytest.mark.parametrize(
    ("behind", "damped", "typical", "left"),
    [(1.0, True, 2.0, True), (1.4, True, 2.0, False), (1.0, False, 2.0, False), (1.12, True, 1.15, True)],
)
def test_a_corner_is_left_by_the_loads_speeds_if_what_lies_behind_is_as_near(
    monkeypatch: Any, behind: float, damped: bool, typical: float, left: bool
) -> None:
    """The same machine with a typical damping may be about as near, and predict other moves ten times worse."""
    corner, other = stub(1.1), stub(behind)
    corner.model = SimpleNamespace(parameters=[SimpleNamespace(name="X1.gear_damping_ratio")])
    odd = [corner] if damped else [corner, other]
    monkeypatch.setattr(moves_end, "overdamped", lambda f: ("X1.gear_damping_ratio",) if f in odd else ())
    monkeypatch.setattr(moves_end, "values_at", lambda _found: {})
    monkeypatch.setattr(moves_end, "fitted_from", lambda *_: stub(typical))
    monkeypatch.setattr(moves_end, "begun_by_speeds", lambda _found: other)
    assert moves_end.as_damped(corner) is (other if left else corner)


def test_a_few_moves_tell_by_the_speeds_which_numbers_to_put_back(monkeypatch: Any) -> None:
    """Every way is tried on a few moves: the nearest is taken, but none that is damped as no chain is."""
    values = {f"X1.{n}": 1.0 for n in ("coulomb", "gear_mass", "gear_damping_ratio", "clock_offset", "gain")}
    ways: list[tuple[set[str], float]] = []
    nearest = {0.05: 2.0, 0.01: 1.5}

    def by_speeds(_few: Any, _model: Any, at: Any, lasting: float, _rounds: int) -> Any:
        ways.append(({name.removeprefix("X1.") for name in at}, lasting))
        chain_put_back = "X1.gear_mass" not in at
        return stub(
            nearest[lasting] - chain_put_back, "odd" if chain_put_back and lasting < 0.02 else "sound"
        )

    monkeypatch.setattr(moves_end, "fewer", lambda _found: ("few",))
    monkeypatch.setattr(moves_end, "chain", lambda _model: {"gear_mass", "gear_damping_ratio"})
    monkeypatch.setattr(moves_end, "values_at", lambda found: values if found.name == "corner" else found.rms)
    monkeypatch.setattr(moves_end, "point_at", lambda _model, kept, _few: set(kept))
    monkeypatch.setattr(moves_end, "speeds_first", by_speeds)
    monkeypatch.setattr(moves_end, "overdamped", lambda f: ("ratio",) if f.name == "odd" else ())
    monkeypatch.setattr(moves_end, "zeros_alike", lambda *_: ())
    monkeypatch.setattr(moves_end, "begun_at", lambda _moves, _model, begun, _local: begun)
    monkeypatch.setattr(moves_end, "fit", lambda moves, _model, at, _rounds: (moves, at))
    every = ("every",)
    assert moves_end.begun_by_speeds(stub(1.0, "corner")) == (every, 1.0)
    near = stub(0.8, "corner")
    assert moves_end.begun_by_speeds(near) is near, "none of them is about as near"
    del ways[4:]
    kept = {"coulomb", "gear_mass", "gain"}
    assert ways == [(k, lasting) for k in (kept, kept - {"gear_mass"}) for lasting in (0.05, 0.01)]


@pytest.mark.parametrize(
    ("turns", "reached", "taken"),
    [
        ((3.4, 4.2, 1.6, 1.1), 1.1, 4),
        ((3.4, 3.5, 3.4, 3.6, 3.3, 3.4, 3.5, 3.4), 3.2, 8),
        ((3.19, 3.18, 3.1799, 1.1), 3.1799, 3),
    ],
)
def test_the_way_from_a_motion_that_a_wrong_chain_has_made_leads_uphill(
    monkeypatch: Any, turns: tuple[float, ...], reached: float, taken: int
) -> None:
    """A hung mass of the right frequency stood at 3.2 with a gear as heavy as the load."""
    left = list(turns)
    monkeypatch.setattr(moves_end, "reconstructed", lambda found: found.moves)
    monkeypatch.setattr(moves_end, "fit", lambda *_: stub(left.pop(0)))
    assert moves_end.in_turns(stub(3.2)).rms == reached
    assert len(turns) - len(left) == taken


@pytest.mark.parametrize(
    ("white", "elsewhere", "light", "ended"),
    [
        (1.01, 0.9, 0.9, 1.01),
        (1.1, 0.9, 1.2, 0.9),
        (1.1, 1.0999, 1.2, 1.1),
        (1.1, 1.2, 1.0, 1.0),
        (1.04, 1.2, 0.9, 1.04),
    ],
    ids=[
        "no more than expected",
        "over a ridge",
        "hardly nearer",
        "hardly damped",
        "about as much as expected",
    ],
)
def test_what_leaves_no_more_than_is_expected_is_led_over_no_further_ridge(
    monkeypatch: Any, white: float, elsewhere: float, light: float, ended: float
) -> None:
    monkeypatch.setattr(moves_end, "cornered", lambda _found: False)
    monkeypatch.setattr(moves_end, "whitened", lambda found, is_white: stub(white) if is_white else found)
    monkeypatch.setattr(moves_end, "agreed", lambda found: found)
    monkeypatch.setattr(moves_end, "as_damped", lambda found: found)
    monkeypatch.setattr(moves_end, "over_ridges", lambda _found: stub(elsewhere))
    monkeypatch.setattr(moves_end, "hardly_damped_chain", lambda _found: stub(light))
    assert moves_end.steady(stub(1.2)).rms == ended
    assert moves_end.steady(stub(1.2), elsewhere=False).rms == white


@pytest.mark.parametrize(
    ("rms", "known", "close_by", "reached"),
    [
        (1.0, 0.1, [0.1], "own"),
        (1.0, 0.3, [0.3, 0.03], "second"),
        (1.0, 0.3, [0.3, 0.3], "own"),
        (1.3, 0.3, [0.1], "own"),
    ],
    ids=["is close", "another is", "none is", "not described"],
)
def test_what_is_not_tied_closely_swings_at_a_frequency_close_by(
    monkeypatch: pytest.MonkeyPatch, rms: float, known: float, close_by: list[float], reached: str
) -> None:
    def one(name: str, known: float) -> Any:
        return SimpleNamespace(name=name, moves=known, rms=rms, model=None, at="here")

    others = {
        k: one(name, how) for k, (name, how) in enumerate(zip(("first", "second"), close_by, strict=False))
    }
    monkeypatch.setattr(moves_end, "swings_at_all", lambda _model: True)
    monkeypatch.setattr(moves_end, "how_known", lambda moves: moves)
    monkeypatch.setattr(moves_end, "at_near_frequencies", lambda _found: list(others))
    monkeypatch.setattr(
        moves_end, "tied", lambda _found, at, _steps: one("own", known) if at == "here" else others[at]
    )
    assert cast(Any, moves_end.swung_in(one("found", 1.0))).name == reached
