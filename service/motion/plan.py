"""What may move, and how far: a bounded plan of diagnostic steps and travels, checked before the drive is enabled.

Software cannot stop an 86 ms step (in 10 ms the axis covers 0.9 mm), so nothing is decided in mid-move:
the plan is bounded by construction, and the drive keeps its own limits. All axes of a group make the same
steps and travel the same way, so that a bridge is not skewed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from service.config import AxisSettings, ExcitationSettings, TravelSettings
from service.dynamics.trajectory import jerk_limited_step

NEAR = 1e-4
"""Way that is not worth a travel [m]; chosen: far below the half step within which steps are at one place."""


class NotPermitted(RuntimeError):
    """The machine's state does not permit the plan; the message says which axis, why, and what to do."""


@dataclass(frozen=True)
class PlannedStep:
    """One step of all axes of the group: SL [m] with its sign in ``direction`` (±1)."""

    direction: int
    length: float


@dataclass(frozen=True)
class Travel:
    """A way that all axes of the group go together, jerk-limited.

    Attributes
    ----------
    distance : signed [m]
    goal : the place that it leads to, in the first axis' coordinate [m], for messages
    jerk, duration, v_max, a_max : [m/s³], [s], [m/s], [m/s²]
    """

    distance: float
    goal: float
    jerk: float
    duration: float
    v_max: float
    a_max: float


@dataclass(frozen=True)
class Visit:
    """The steps at one place, and the way there; ``travel`` is None where the axis stands there already."""

    travel: Travel | None
    steps: tuple[PlannedStep, ...]


@dataclass(frozen=True)
class Plan:
    """Ten steps at each place, alternating direction, and the way back to where the axis stood.

    Attributes
    ----------
    jerk : j_lim [m/s³]
    duration : of one step [s]
    v_max, a_max : reached in a step [m/s], [m/s²]
    rest : standstill before each step [s]
    """

    axes: tuple[str, ...]
    visits: tuple[Visit, ...]
    way_back: Travel | None
    jerk: float
    duration: float
    v_max: float
    a_max: float
    rest: float

    @property
    def steps(self) -> tuple[PlannedStep, ...]:
        """The steps of all visits, in their order."""
        return tuple(step for visit in self.visits for step in visit.steps)


def plan_steps(
    axes: Sequence[AxisSettings],
    excitation: ExcitationSettings,
    positions: Mapping[str, float],
    prefer: int = 1,
) -> Plan:
    """Plan the diagnostic steps of one group where its axes stand.

    Parameters
    ----------
    positions : present position of each axis [m], in the coordinates of travel_min_m and travel_max_m
    prefer : direction ±1 of the first step where both have room

    Raises
    ------
    NotPermitted : no direction keeps every axis within its travel.
    """
    length = excitation.step_length_m
    first = next(
        (
            sign
            for sign in (prefer, -prefer)
            if all(_stays_inside(axis, positions[axis.name], sign * length) for axis in axes)
        ),
        None,
    )
    if first is None:
        raise NotPermitted(_no_room(axes, positions, length))
    return _plan(axes, excitation, (Visit(None, _alternating(excitation, first)),), None)


def plan_map(
    axes: Sequence[AxisSettings],
    excitation: ExcitationSettings,
    travel: TravelSettings,
    positions: Mapping[str, float],
    places: Sequence[float],
    first: int = 1,
) -> Plan:
    """Plan the steps at several places of a group, the ways between them, and the way back.

    Parameters
    ----------
    places : middles of the steps [m], in their order
    first : direction ±1 of the first step at each place
    positions : present position of each axis [m], in the coordinates of travel_min_m and travel_max_m

    Raises
    ------
    NotPermitted : an axis stands outside its travel, or the two sides of a bridge do not say the same place.
    """
    require_inside(axes, positions)
    _require_one_place(axes, positions, excitation.step_length_m / 2)
    begin = here = sum(positions[axis.name] for axis in axes) / len(axes)
    steps = _alternating(excitation, first)
    reach = first * excitation.step_length_m
    visits = []
    for place in places:
        way = _way(axes, travel, place - reach / 2 - here, place)
        here += 0.0 if way is None else way.distance
        _require_room(axes, {name: at + here - begin for name, at in positions.items()}, reach)
        visits.append(Visit(way, steps))
        here += sum(step.direction * step.length for step in steps)
    return _plan(axes, excitation, tuple(visits), _way(axes, travel, begin - here, positions[axes[0].name]))


def require_inside(axes: Sequence[AxisSettings], positions: Mapping[str, float]) -> None:
    """Raise NotPermitted unless every axis stands within its travel."""
    if not all(_stays_inside(axis, positions[axis.name], 0.0) for axis in axes):
        raise NotPermitted(
            f"no travel to the diagnostic positions: {_where(axes, positions)}. Likely the axis has lost its "
            "reference, or was pushed by hand: move it into its travel, or home it, and run again"
        )


def _require_room(axes: Sequence[AxisSettings], there: Mapping[str, float], reach: float) -> None:
    """Raise NotPermitted unless the steps forth from a place keep every axis, not only the first, inside."""
    if not all(_stays_inside(axis, there[axis.name], reach) for axis in axes):
        raise NotPermitted(
            f"no room at a diagnostic position: there {_where(axes, there, 'would stand')}. The two sides of the "
            "bridge differ by that little: move the position further from the end of the travel"
        )


def _require_one_place(axes: Sequence[AxisSettings], positions: Mapping[str, float], apart: float) -> None:
    stand = [positions[axis.name] for axis in axes]
    if max(stand) - min(stand) > apart:
        raise NotPermitted(
            f"no travel to the diagnostic positions: {_where(axes, positions)}, which is {max(stand) - min(stand):.4f} "
            "m apart on one bridge. Likely one side has lost its reference, or the bridge is skewed: home both "
            "sides, and run again"
        )


def _way(axes: Sequence[AxisSettings], travel: TravelSettings, distance: float, goal: float) -> Travel | None:
    """The travel over a distance [m]; None where it is not worth one."""
    if abs(distance) < NEAR:
        return None
    profile = jerk_limited_step(
        abs(distance),
        travel.jerk_m_s3,
        min(travel.acceleration_m_s2, *(axis.acceleration_limit_m_s2 for axis in axes)),
        min(travel.velocity_m_s, *(axis.velocity_limit_m_s for axis in axes)),
    )
    return Travel(distance, goal, profile.jerk, profile.duration, profile.v_max, profile.a_max)


def _alternating(excitation: ExcitationSettings, first: int) -> tuple[PlannedStep, ...]:
    length = excitation.step_length_m
    return tuple(PlannedStep(first * (-1) ** index, length) for index in range(excitation.steps))


def _plan(
    axes: Sequence[AxisSettings],
    excitation: ExcitationSettings,
    visits: tuple[Visit, ...],
    way_back: Travel | None,
) -> Plan:
    step = jerk_limited_step(
        excitation.step_length_m,
        excitation.jerk_m_s3,
        min(axis.acceleration_limit_m_s2 for axis in axes),
        min(axis.velocity_limit_m_s for axis in axes),
    )
    return Plan(
        axes=tuple(axis.name for axis in axes),
        visits=visits,
        way_back=way_back,
        jerk=excitation.jerk_m_s3,
        duration=step.duration,
        v_max=step.v_max,
        a_max=step.a_max,
        rest=excitation.rest_s,
    )


def _stays_inside(axis: AxisSettings, position: float, travel: float) -> bool:
    return axis.travel_min_m <= position <= axis.travel_max_m and (
        axis.travel_min_m <= position + travel <= axis.travel_max_m
    )


def _where(axes: Sequence[AxisSettings], positions: Mapping[str, float], verb: str = "stands") -> str:
    return ", ".join(
        f"{axis.name} {verb} at {positions[axis.name] * 1e3:.2f} mm of "
        f"{axis.travel_min_m * 1e3:.2f} … {axis.travel_max_m * 1e3:.2f} mm"
        for axis in axes
    )


def _no_room(axes: Sequence[AxisSettings], positions: Mapping[str, float], length: float) -> str:
    return (
        f"no room for a step of {length * 1e3:g} mm: {_where(axes, positions)}. Likely the axis stands too near an end "
        "of its travel for a step of this length, or has lost its reference: move it further into its travel, for a "
        "long step to one end of it, or home it, and run again"
    )
