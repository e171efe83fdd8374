"""The backlash of a fitted model, and how well it is known beside the numbers of an effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from service.backlash.moves_begun import point_at, shared_at
from service.backlash.moves_fit import Fitted, fit, values_at
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_transmission import DrivenBentContact, DrivenLocalBacklash
from service.identification.axis_numbers import (
    SPLIT,
    UNSURE,
    apart_in_time,
    backlash_of,
    clearance_beside,
    division_known,
    interval_95,
    misfit,
    unseen_depth,
)
from tests.service.identification.with_a_clearance import with_a_clearance


def test_how_two_gaps_divide_their_sum_is_in_the_interval_of_the_backlash(found: Fitted) -> None:
    whole = found.value("X1.backlash")
    model, at = with_a_clearance(found, 0.4 * whole)
    both = fit(found.moves, model, at, 0)
    b, std = backlash_of(both, 0)
    assert b == pytest.approx(0.6 * whole)
    assert clearance_beside(both, 0) == pytest.approx(whole)
    assert clearance_beside(found, 0) == 0.0
    assert std > UNSURE * whole > 5.0 * backlash_of(found, 0)[1], "no motor was asked"
    for left, share in ((0.99, SPLIT), (1.5, UNSURE)):
        told = replace(both, r=np.full(10, left), motors=np.full(10, left))
        assert division_known(told, 0) == pytest.approx(share * whole)
    assert division_known(found, 0) == 0.0


def test_where_a_bent_flank_begins_to_push_is_in_the_interval_of_the_backlash(found: Fitted) -> None:
    """What lies below the noise no sample shows; a straight flank begins where its line does."""
    model = replace(found.model, effects=(*found.model.effects, DrivenBentContact(("X1",))))
    k, bend, push = 6e4, 0.6, 4.0
    values = values_at(found) | {"X1.bend": bend, "X1.contact_stiffness": k}
    bent = fit(found.moves, model, point_at(model, values, found.moves), 0)
    depth = unseen_depth(bent, 0) / bend
    assert k * depth * (depth / (push / k)) ** bend == pytest.approx(found.moves[0].noise[0])
    assert backlash_of(bent, 0)[1] > 0.5 * bend * depth
    assert unseen_depth(found, 0) == 0.0


def test_a_gap_that_changes_along_the_rack_is_said_where_the_moves_cross_it(found: Fitted) -> None:
    """Its width where the recording began, and what a wave of 9 mm adds up to at 0.6 of every move."""
    model = replace(found.model, effects=(*found.model.effects, DrivenLocalBacklash(("X1",))))
    planted = {"X1.gap_slope": 0.01, "X1.gap_bow": -4.0, "X1.gap_period": 9e-3}
    at = point_at(model, values_at(found) | planted, found.moves)
    (part,), kappa = found.moves, 2 * np.pi / 9e-3
    steps = [part.recording.moves[grid.index] for grid in part.grids]
    places = np.array([float(part.plain[0](step.start + 0.6 * step.duration)) for step in steps])
    size, phase = np.hypot(0.01 / kappa, 4.0 / kappa**2), np.arctan2(4.0, 0.01 * kappa)
    wider = float(np.mean(size * (np.sin(kappa * places + phase) - np.sin(phase))))
    assert abs(wider) > 1e-6
    b, std = backlash_of(fit(found.moves, model, at, 0), 0)
    assert b == pytest.approx(found.value("X1.backlash") + wider, abs=1e-10)
    assert std > backlash_of(found, 0)[1], "the wave is not known exactly, either"


@pytest.mark.parametrize(("left", "share"), [(0.95, 0.0), (1.05, 0.0), (1.45, 0.03), (10.05, 0.3)])
def test_what_a_model_leaves_of_the_moves_may_be_in_its_backlash(
    found: Fitted, left: float, share: float
) -> None:
    """By three hundredths of it for a residual that is as large as the noise, and nothing for noise."""
    one = replace(found, r=np.full(found.r.shape, left))
    assert misfit(one, 0) == pytest.approx(share * found.value("X1.backlash"), rel=0.01)
    (b, (low, high)), (_, std) = interval_95(one, 0, 2.0), backlash_of(one, 0)
    assert high - b == pytest.approx(1.96 * np.hypot(2.0 * std, misfit(one, 0)))
    assert low == pytest.approx(max(0.0, 2.0 * b - high))


@pytest.mark.parametrize(
    ("offset", "apart"), [(80e-6, 0.0), (-80e-6, 0.0), (100e-6, 100e-6), (-140e-6, -140e-6)]
)
def test_channels_are_apart_in_time_only_by_more_than_clocks_are(
    found: Fitted, offset: float, apart: float
) -> None:
    values = values_at(found) | {"X1.clock_offset": offset}
    late = replace(found, at=replace(found.at, shared=shared_at(found.model, values)))
    assert apart_in_time(late, 0) == pytest.approx(apart, abs=1e-9)


def test_a_model_without_clocks_has_none_apart(found: Fitted) -> None:
    model = Model(("X1",), 2, (), "whole_move", ("constant", "skew"))
    plain = replace(found, model=model, at=replace(found.at, shared=np.zeros(len(model.parameters))))
    assert apart_in_time(plain, 0) == 0.0
