"""What else the model fit says of an axis: stiffness, friction, skew of the clocks, with their standard deviations.

Stiffnesses and frictions are those of the moved mass, per kilogram of it: the load's acceleration and the motor's
motion alone say nothing of how heavy it is. Each drifts for a reason of its own - a contact grows softer with
wear, a guide's friction with dirt, a drive with a loose coupling - so that each is kept as a trend.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from service.backlash.model_fit_interval import Linearised
from service.backlash.model_fit_problem import Fit
from service.backlash.results import ByProduct
from service.dynamics.driven_model import LINKS

OF_AN_AXIS: Mapping[str, tuple[str, str]] = {
    "contact_stiffness": ("contact_stiffness", "N/(m kg)"),
    "coulomb": ("coulomb_friction", "N/kg"),
    "viscous": ("viscous_friction", "N s/(m kg)"),
    "skew": ("skew", "s"),
}
"""Parameter of the model -> name and unit of the by-product. Skew: by how much the speed's clock is ahead of the
accelerometer's."""

OF_A_GANTRY: Mapping[str, tuple[str, str]] = {
    "bridge_stiffness": ("bridge_stiffness", "N/(m kg)"),
    "bridge_offset": ("bridge_offset", "m"),
}


def by_products(fit: Fit, linear: Linearised, x: int) -> tuple[ByProduct, ...]:
    """By-products of axis x of a linearised fit; standard deviations by its covariance, enlarged by the misfit."""
    model = linear.model
    axis, places = model.axes[x], {p.name: k for k, p in enumerate(model.parameters)}
    enlarged = float(np.sqrt(max(1.0, fit.misfit)))
    wanted = {f"{axis}.{name}": told for name, told in OF_AN_AXIS.items()} | dict(OF_A_GANTRY)
    found = [
        ByProduct(name, fit.value(model, parameter), enlarged * deviation(linear, places[parameter]), unit)
        for parameter, (name, unit) in wanted.items()
        if parameter in places
    ]
    drive = drive_stiffness(fit, linear, [f"{axis}.{link}_stiffness" for link in LINKS[model.lumps]])
    return (*found, *(ByProduct(d.name, d.value, enlarged * d.std, d.unit) for d in drive))


def deviation(linear: Linearised, k: int) -> float:
    """Standard deviation of parameter k in its own unit, first order."""
    return abs(linear.slope(k)) * float(np.sqrt(linear.covariance[k, k]))


def drive_stiffness(fit: Fit, linear: Linearised, links: Sequence[str]) -> tuple[ByProduct, ...]:
    """The springs between motor and pinion in series, 1/k = Σ 1/k_i; nothing where the model has none.

    To first order δk/k = Σ (k/k_i)·δk_i/k_i, and the coordinates of the fit are logarithms over their spread.
    """
    if not links:
        return ()
    model = linear.model
    where = [[p.name for p in model.parameters].index(link) for link in links]
    each = np.array([fit.value(model, link) for link in links])
    k = 1.0 / float(np.sum(1.0 / each))
    slope = k / each * np.array([model.parameters[i].spread for i in where])
    variance = float(slope @ linear.covariance[np.ix_(where, where)] @ slope)
    return (ByProduct("drive_stiffness", k, k * float(np.sqrt(max(variance, 0.0))), "N/(m kg)"),)
