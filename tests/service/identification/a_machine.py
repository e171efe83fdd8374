"""The numbers of a usual machine with one mass between motor and rack, and what a sensor feels of one on a body."""

from dataclasses import replace

import numpy as np

from service.backlash.moves import Moves
from service.backlash.moves_fit import Fitted, fit
from service.backlash.moves_point import Point
from service.backlash.moves_predicted import left_over, predict
from service.dynamics.driven_model import Model
from service.identification.moves_rests import KNOWN, swinging_on

MACHINE = {
    "X1.backlash": 8e-5,
    "X1.contact_stiffness": 8e5,
    "X1.drive_stiffness": 1.2e6,
    "X1.drive_mass": 0.1,
    "X1.coulomb": 0.3,
    "X1.viscous": 0.8,
}


def swinging_through(moves: Moves, model: Model, at: Point) -> Fitted:
    """The model at a point, with the moves as a sensor with noise feels them where what swings goes on from each to the
    next."""
    for _ in moves.grids:
        (moves,), _ = swinging_on([moves], model, at, KNOWN[-1])
    said = predict(moves, model, at.shared[None], at.local[0][None]).acceleration()[0]
    felt = said + moves.noise[:, None] * np.random.default_rng(3).standard_normal(said.shape)
    grids = [replace(g, measured=np.where(g.used, f, np.nan)) for g, f in zip(moves.grids, felt, strict=True)]
    return fit([replace(moves, grids=tuple(grids))], model, at, 0)


def as_heard(machine: Fitted) -> Moves:
    """Its moves with nothing known of what swings when they begin but what is heard then."""
    part, model = machine.moves[0], machine.model
    begun = left_over(part, model, model.complete(model.values(machine.at.shared[None])))
    return replace(part, swings=None, heard={name: of_moves[0] for name, of_moves in begun.items()})
