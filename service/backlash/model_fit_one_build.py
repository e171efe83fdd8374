"""Starts with other drives than the search found: both of one build, or typical ones of the softness found.

Each side is searched for by itself, and a start may be near on one side and in another minimum on the other: its load
far too light and its drive far too stiff, or the like. But a gantry's two drives come from one drawing: what was found
of the one is a guess for the other. Or both ended with hardly any drive, all softness in their contacts: the softness
is right then, and a drive of ordinary mass has a part of it. These are starts only, no priors; where the drives are
not so the data lead away from it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from service.backlash.model_fit_problem import Point, fit
from service.backlash.model_fit_stages import Outcome
from service.dynamics.driven_model import LINKS, Model
from service.recording import FloatArray

WAYS = ((0.5, 0.5), (1.0, 0.0), (0.0, 1.0))
"""Shares of the two sides in the drive that both begin with: their mean, the first's, the second's."""

SOFT = (0.3, 0.6)
"""Shares of a typical drive in an axis' compliance."""

ROUNDS = 4
"""Rounds in which what differs from side to side is found for the drives as they are."""


def built(model: Model) -> frozenset[str]:
    """The parameters of an axis that its drawing gives: contact and links, as the model names them."""
    links = (*LINKS[model.lumps], "contact")
    numbers = ("stiffness", "damping_ratio", "mass")
    return frozenset(f"{link}_{number}" for link in links for number in numbers)


def of_one_build(model: Model, shared: FloatArray, way: tuple[float, float]) -> FloatArray:
    """The coordinates (P,) with both drives the same share of the two, and both loads of one mass."""
    where = {p.name: k for k, p in enumerate(model.parameters)}
    out = shared.copy()
    for name in built(model):
        at = [where.get(f"{axis}.{name}") for axis in model.axes]
        sides = [k for k in at if k is not None]
        out[sides] = np.dot(way, shared[sides]) if sides else out[sides]
    out[where["mass_ratio"]] = 0.0
    return out


def with_typical_drives(model: Model, shared: FloatArray, soft: float) -> FloatArray:
    """The coordinates (P,) of a chain with one lump per drive, as soft as the given one, of which the drives, of
    typical mass and damping, have the share ``soft``."""
    where = {p.name: k for k, p in enumerate(model.parameters)}
    out = shared.copy()
    for axis in model.axes:
        names = {link: f"{axis}.{link}_stiffness" for link in ("drive", "contact")}
        given = [model.parameters[where[name]].value(shared[where[name]]) for name in names.values()]
        compliance = sum(1.0 / float(k) for k in given)
        for link, share in (("drive", soft), ("contact", 1.0 - soft)):
            k = where[names[link]]
            out[k] = float(model.parameters[k].internal(1.0 / (share * compliance)))
            out[where[f"{axis}.{link}_damping_ratio"]] = 0.0
        out[where[f"{axis}.drive_mass"]] = 0.0
    return out


def other_drives(model: Model, shared: FloatArray) -> list[FloatArray]:
    """Coordinates (P,) of chains with one lump per drive that differ from the given one in their drives only."""
    ways = [of_one_build(model, shared, way) for way in WAYS]
    return ways + [with_typical_drives(model, way, soft) for way in (shared, *ways) for soft in SOFT]


def begun_alike(found: Outcome, way: tuple[float, float]) -> Point:
    """Where a fit with both drives of one build begins: gaps, zeros, friction and bridge found for them first."""
    model = found.problem.model
    drawn = (*built(model), "mass_ratio")
    free = tuple(p.name.rpartition(".")[2] not in drawn for p in model.parameters)
    at = Point(of_one_build(model, found.fit.point.shared, way), found.fit.point.local)
    return fit(replace(found.problem, free=free), at, ROUNDS, 1.0).point
