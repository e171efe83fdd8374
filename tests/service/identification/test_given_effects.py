"""Numbers that were accepted of an axis, put back under the names that its model has for them."""

from __future__ import annotations

from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_library import DRIVEN
from service.identification.explanation import Accepted
from service.identification.given_effects import names_of, numbers_in


def test_numbers_come_back_under_the_names_of_the_model() -> None:
    """Those in seconds are told with their unit; what two axes have in common is told of both."""
    axes = ("X1", "X2")
    effects = tuple(DRIVEN[name](axes) for name in ("sensor_latency", "gantry_coupling"))
    model = Model(axes, 2, effects)
    accepted = {
        "X1": Accepted(("sensor_latency",), {"latency_s": 0.002, "backlash": 5e-5, "bridge_stiffness": 3e5}),
        "X2": Accepted(("sensor_latency",), {"latency_s": 0.003, "bridge_stiffness": 4e5, "forgotten": 1.0}),
    }
    assert numbers_in(model, accepted) == {
        "X1.latency": 0.002,
        "X1.backlash": 5e-5,
        "X2.latency": 0.003,
        "bridge_stiffness": 3e5,
    }


def test_axes_that_move_together_have_all_that_either_is_accepted_to_have() -> None:
    accepted = {
        "X1": Accepted(("hung_mass_mode", "sensor_gain")),
        "X2": Accepted(("sensor_gain", "lost_motion", "stribeck_friction")),
        "Y": Accepted(("constant_force",)),
    }
    names = names_of(accepted, ("X1", "X2"))
    assert names == ("hung_mass_mode", "sensor_gain", "stribeck_friction"), "lost_motion is none of moves"
    assert names_of({}, ("X1",)) == ()
