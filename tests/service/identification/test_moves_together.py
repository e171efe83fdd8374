"""Two effects at once: which of many a fit needs, when two of them are all, and in which order they are looked for."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from service.backlash.moves_point import width
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_library import DRIVEN
from service.identification import moves_together
from service.identification.moves_together import added, are_all, exchanged, nearer_instead, pairs, ranked
from service.identification.selection import Trial

Begun = list[tuple[tuple[str, ...], dict[str, float]]]
"""The effects of each fit that is begun, and its values."""
AXES, MOVES, SAMPLES = ("X1",), 4, 60
NAMES = ("sensor_gain", "sensor_bias", "asymmetric_friction", "position_dependent_force")
DECLARED = Model(AXES, 2, ())
FULL = Model(AXES, 2, tuple(DRIVEN[name](AXES) for name in NAMES))
PRESENT = cast(Any, SimpleNamespace(model=DECLARED, rms=9.0))


class Linear:
    """A fit of a model whose residuals are linear in all coordinates, at its best: ridge regression in closed form."""

    def __init__(self, truth: NDArray[np.float64], seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.model = FULL
        shared = len(FULL.parameters)
        of_move = np.kron(np.eye(MOVES), np.ones((SAMPLES, width(FULL))))
        J = rng.standard_normal((MOVES * SAMPLES, len(truth)))
        J[:, shared:] *= of_move
        self.J, self.y = J, J @ truth + 0.01 * rng.standard_normal(len(J))
        u = np.linalg.solve(J.T @ J + np.eye(len(truth)), J.T @ self.y)
        self.at = SimpleNamespace(shared=u[:shared], local=(u[shared:].reshape(MOVES, -1),))
        self.r = J @ u - self.y
        self.rms = float(np.sqrt(np.mean(self.r**2)))

    @property
    def slopes(self) -> Any:
        return SimpleNamespace(dense=lambda: self.J)


def coordinates(names: tuple[str, ...]) -> NDArray[np.float64]:
    """Those of all, and 1 for the amounts of these effects, in every move for what is found again there."""
    shared = np.zeros(len(FULL.parameters))
    local = np.zeros((MOVES, width(FULL)))
    for k, p in enumerate(FULL.parameters):
        if p.dose and p.name.rpartition(".")[2] in {o.name for n in names for o in DRIVEN[n].own}:
            shared[k] = 1.0
    if "sensor_bias" in names:  # a zero that goes its way from move to move, and no straight drift
        shared[[p.name for p in FULL.parameters].index("X1.bias_drift")] = 0.0
        local[:, 2] = [1.0, -2.0, 0.5, 1.5]
    return np.concatenate((shared, local.ravel()))


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(
    "names",
    [
        ("sensor_gain", "asymmetric_friction"),
        ("asymmetric_friction", "position_dependent_force"),
        ("sensor_gain", "sensor_bias"),
    ],
)
def test_the_two_without_which_most_would_be_left_come_first(names: tuple[str, str], seed: int) -> None:
    assert set(ranked(PRESENT, cast(Any, Linear(coordinates(names), seed)), ())[0]) == set(names)


def test_beside_one_that_is_given_the_other_is_found() -> None:
    fit = cast(Any, Linear(coordinates(("sensor_gain", "asymmetric_friction")), 1))
    assert ranked(PRESENT, fit, ("sensor_gain",))[0] == ("asymmetric_friction", "sensor_gain")


def test_pairs_that_are_far_behind_are_not_fitted() -> None:
    fit = cast(Any, Linear(coordinates(("sensor_gain", "asymmetric_friction")), 1))
    assert len(ranked(PRESENT, fit, ())) == 1


def trial(train: float, held_out: float, *effects: str, limits: tuple[str, ...] = ()) -> Trial[Any]:
    model = SimpleNamespace(effects=tuple(SimpleNamespace(name=name) for name in effects))
    fitted = SimpleNamespace(model=model)
    return Trial(
        SimpleNamespace(fitted=fitted),
        train,
        held_out,
        np.ones(5),
        np.zeros(0),
        100.0,
        at_limits=limits,
    )


@pytest.mark.parametrize(
    ("left", "joint", "limits", "all_is_explained"),
    [
        ((1.05, 1.1), 1.0, (), True),
        ((1.05, 1.1), 1.0, ("body_ratio",), False),
        ((1.18, 1.44), 1.15, (), True),
        ((1.18, 1.44), 1.15, ("body_ratio",), False),
        ((1.37, 0.92), 0.94, (), False),
        ((1.3, 1.7), 1.3, (), False),
        ((1.59, 1.59), 1.55, (), False),
        ((1.0, 1.5), 0.98, (), True),
        ((1.0, 1.5), 0.98, ("body_ratio",), False),
        ((1.0, 1.7), 0.98, (), False),
    ],
    ids=[
        "described",
        "no such effect",
        "a law that differs",
        "that of no such effect",
        "all at once leave less",
        "too much is left",
        "more than a hundredth is left",
        "numbers that the fitted moves do not tell well",
        "that of no such effect",
        "too much is left of the others",
    ],
)
def test_two_are_all_where_hardly_anything_is_left(
    left: tuple[float, float], joint: float, limits: tuple[str, ...], all_is_explained: bool
) -> None:
    found = cast(Any, SimpleNamespace(rms=joint))
    assert are_all(trial(12.0, 11.0), trial(*left, limits=limits), found) is all_is_explained


def test_what_a_model_has_more_than_the_one_before() -> None:
    assert (
        added(trial(1.0, 1.0, "channel_tolerance"), trial(1.0, 1.0, "channel_tolerance", *NAMES[:2]))
        == NAMES[:2]
    )


@pytest.mark.parametrize(
    ("smooth", "beside", "of_smooth", "asked"),
    [
        (1.1, 1.0, True, ["smooth"]),
        (1.1, 1.0, False, ["smooth", "beside", "hung_mass_mode"]),
        (5.0, 1.0, True, ["beside", "hung_mass_mode"]),
        (5.0, None, True, ["beside"]),
    ],
    ids=["two smooth ones are all", "they are not", "they are far from all", "nothing leads beside them"],
)
def test_one_that_is_not_smooth_is_asked_for_where_no_two_smooth_ones_are_all(
    monkeypatch: pytest.MonkeyPatch, smooth: float, beside: float | None, of_smooth: bool, asked: list[str]
) -> None:
    said: list[str] = []

    def one_beside(*_: Any) -> Any:
        said.append("beside")
        model = SimpleNamespace(effects=(SimpleNamespace(name="hung_mass_mode"),))
        return beside and SimpleNamespace(rms=beside, model=model)

    def fitted_pairs(_scene: Any, _before: Any, _found: Any, names: tuple[str, ...], *_: Any) -> list[str]:
        said.append(*names or ("smooth",))
        return ["two"] if names or of_smooth else []

    monkeypatch.setattr(moves_together, "with_all_smooth", lambda *_: SimpleNamespace(rms=smooth))
    monkeypatch.setattr(moves_together, "with_one_beside", one_beside)
    monkeypatch.setattr(moves_together, "fitted_pairs", fitted_pairs)
    pairs(cast(Any, None), trial(9.0, 9.0), (), lambda _text: None)
    assert said == asked


def test_there_are_no_pairs_of_one_effect() -> None:
    assert pairs(cast(Any, None), cast(Any, a_trial()), [DRIVEN["sensor_gain"]], lambda _text: None) == []


def a_trial() -> Any:
    return SimpleNamespace(model=SimpleNamespace(fitted=SimpleNamespace(model=DECLARED)), train_rms=9.0)


@dataclass(frozen=True)
class OfModel:
    """A fit of which only the model counts."""

    model: Model


def of(names: tuple[str, ...], left: float) -> Trial[Any]:
    fitted = OfModel(Model(AXES, 2, tuple(DRIVEN[name](AXES) for name in names)))
    return Trial(SimpleNamespace(fitted=fitted), left, left, np.ones(5), np.zeros(0), 100.0)


def begun(
    monkeypatch: pytest.MonkeyPatch, left: float, late: float = 2e-3
) -> list[tuple[tuple[str, ...], dict[str, float]]]:
    """What is begun with which values; it leaves so much. Such a delay [s] was found."""
    said: Begun = []

    def begun_as(_scene: Any, found: OfModel, values: dict[str, float]) -> Trial[Any]:
        names = tuple(effect.name for effect in found.model.effects)
        said.append((names, values))
        return of(names, left)

    monkeypatch.setattr(moves_together, "begun_as", begun_as)
    monkeypatch.setattr(moves_together, "values_at", lambda _found: {"X1.latency": late, "X1.bend": 0.4})
    return said


def test_a_filter_is_begun_where_a_delay_ended_beside_the_same_other_effect(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    said = begun(monkeypatch, 1.0)
    first = of(("sensor_latency", "contact_nonlinearity"), 2.2)
    (trial,) = exchanged(cast(Any, None), first, list(DRIVEN.values()))
    ((names, values),) = said
    assert names == ("sensor_filter", "contact_nonlinearity")
    assert (values["X1.filter_delay"], values["X1.bend"]) == (2e-3, 0.4)
    assert trial.train_rms == 1.0


def test_nothing_is_exchanged_where_a_pair_is_as_near_as_a_right_one_comes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun(monkeypatch, 1.0)
    assert (
        exchanged(cast(Any, None), of(("sensor_latency", "contact_nonlinearity"), 1.0), list(DRIVEN.values()))
        == []
    )


@pytest.mark.parametrize(("left", "taken"), [(1.0, "begun there"), (3.0, "its own")])
def test_what_does_much_the_same_is_begun_where_the_nearest_pair_ended(
    monkeypatch: pytest.MonkeyPatch, left: float, taken: str
) -> None:
    """A filter of the drive's speed makes the load seem early."""
    said = begun(monkeypatch, left, late=-2e-3)
    own = of(("speed_filter", "position_dependent_force"), 1.3)
    trial = nearer_instead(cast(Any, None), own, of(("sensor_latency", "position_dependent_force"), 1.03))
    ((_, values),) = said
    assert values["X1.filter_time"] == 2e-3
    assert (trial is own) == (taken == "its own")


def test_what_does_something_else_is_not_begun_there(monkeypatch: pytest.MonkeyPatch) -> None:
    said = begun(monkeypatch, 1.0)
    own = of(("sensor_gain", "position_dependent_force"), 1.3)
    first = of(("sensor_latency", "position_dependent_force"), 1.03)
    assert nearer_instead(cast(Any, None), own, first) is own
    assert not said


PAIR = ("sensor_gain", "sensor_bias")


def fitted_of(
    monkeypatch: pytest.MonkeyPatch, few: dict[str, float], left: dict[str, float], before: float = 9.0
) -> tuple[list[Trial[Any]], list[str], dict[str, Trial[Any]]]:
    """The pairs that are fitted, what was done with which of them, and the trials of all, by what each leaves of a few
    moves and of all, and what is left without them."""
    trials, said = {name: of(PAIR, rms) for name, rms in left.items()}, list[str]()
    names = {id(trial): name for name, trial in trials.items()}

    def nearer(_scene: Any, trial: Trial[Any], _first: Any) -> Trial[Any]:
        said.append(f"asked {names[id(trial)]}")
        return trial

    def to_its_end(_scene: Any, _before: Any, trial: Trial[Any]) -> Trial[Any]:
        said.append(f"ended {names[id(trial)]}")
        return trial

    def fitted_two(_moves: Any, found: Any) -> str:
        said.append(f"fitted {found.name}")
        return str(found.name)

    many = cast(Any, SimpleNamespace(moves=()))
    monkeypatch.setattr(moves_together, "ranked", lambda *_: [(name, "beside") for name in few])
    monkeypatch.setattr(moves_together, "fewer", lambda _found: ())
    monkeypatch.setattr(
        moves_together,
        "begun_two",
        lambda _present, _found, names, _few: SimpleNamespace(name=names[0], rms=few[names[0]]),
    )
    monkeypatch.setattr(moves_together, "fitted_two", fitted_two)
    monkeypatch.setattr(moves_together, "trial_of", lambda _scene, name: trials[name])
    monkeypatch.setattr(moves_together, "exchanged", lambda *_: [])
    monkeypatch.setattr(moves_together, "nearer_instead", nearer)
    monkeypatch.setattr(moves_together, "to_its_end", to_its_end)
    monkeypatch.setattr(moves_together, "are_all", lambda *_: True)
    out = moves_together.fitted_pairs(cast(Any, None), of(PAIR, before), many, (), (), lambda _text: None)
    return out, said, trials


@pytest.mark.parametrize(
    ("nearest", "second", "ended", "asked"),
    [(1.0, 1.02, 2, 1), (1.0, 1.1, 1, 2), (1.1, 1.2, 2, 1), (2.0, 2.0, 1, 2), (2.0, 2.1, 1, 2)],
    ids=[
        "as near",
        "the first is as near as a right one comes",
        "the first is not",
        "the first ended too far off, and the next is no nearer",
        "nor farther",
    ],
)
def test_the_nearest_pairs_are_ended_and_what_comes_after_them_is_left(
    monkeypatch: pytest.MonkeyPatch, nearest: float, second: float, ended: int, asked: int
) -> None:
    few = {"second": 1.0, "first": 1.0, "third": 1.0}
    out, said, trials = fitted_of(monkeypatch, few, {"second": second, "first": nearest, "third": 9.0})
    assert out[0].train_rms == trials["first"].train_rms
    done = [text.split()[0] for text in said]
    assert (len(out), done.count("ended"), done.count("asked")) == (ended, ended, asked)


def test_a_pair_that_is_far_behind_on_a_few_moves_is_not_fitted_to_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _, said, _ = fitted_of(
        monkeypatch, {"near": 1.0, "about": 1.3, "far": 1.4}, {"near": 1.0, "about": 1.3, "far": 1.4}
    )
    assert [text for text in said if text.startswith("fitted")] == ["fitted near", "fitted about"]


@pytest.mark.parametrize(
    ("before", "left", "fitted"), [(3.0, 1.5, True), (3.0, 1.6, False), (9.0, 1.6, True), (9.0, 1.7, False)]
)
def test_no_pair_is_fitted_to_all_moves_where_each_leaves_too_much_of_a_few(
    monkeypatch: pytest.MonkeyPatch, before: float, left: float, fitted: bool
) -> None:
    out, said, _ = fitted_of(monkeypatch, {"one": left}, {"one": left}, before)
    assert bool(out) == bool(said) == fitted
