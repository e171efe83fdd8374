"""What may move, and how far: a bounded plan of diagnostic steps, checked before the drive is enabled.

Software cannot stop an 86 ms step (in 10 ms the axis covers 0.9 mm), so nothing is decided in mid-move:
the plan is bounded by construction, and the drive keeps its own limits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from service.config import AxisSettings, ExcitationSettings
from service.dynamics.trajectory import jerk_limited_step


class NotPermitted(RuntimeError):
    """The machine's state does not permit the plan; the message says which axis, why, and what to do."""


@dataclass(frozen=True)
class PlannedStep:
    """One step of all axes of the group: SL [m] with its sign in ``direction`` (±1)."""

    direction: int
    length: float


@dataclass(frozen=True)
class Plan:
    """Ten steps, alternating direction, so that the axis ends where it began.

    Attributes
    ----------
    jerk : j_lim [m/s³]
    duration : of one step [s]
    v_max, a_max : reached in a step [m/s], [m/s²]
    rest : standstill before each step [s]
    """

    axes: tuple[str, ...]
    steps: tuple[PlannedStep, ...]
    jerk: float
    duration: float
    v_max: float
    a_max: float
    rest: float

    @property
    def total_duration(self) -> float:
        """Machine time of the whole plan [s]."""
        return (len(self.steps) + 1) * self.rest + len(self.steps) * self.duration


def plan_steps(
    axes: Sequence[AxisSettings],
    excitation: ExcitationSettings,
    positions: Mapping[str, float],
    prefer: int = 1,
) -> Plan:
    """Plan the diagnostic steps of one group from where its axes stand.

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
    step = jerk_limited_step(
        length,
        excitation.jerk_m_s3,
        min(axis.acceleration_limit_m_s2 for axis in axes),
        min(axis.velocity_limit_m_s for axis in axes),
    )
    return Plan(
        axes=tuple(axis.name for axis in axes),
        steps=tuple(PlannedStep(first * (-1) ** index, length) for index in range(excitation.steps)),
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


def _no_room(axes: Sequence[AxisSettings], positions: Mapping[str, float], length: float) -> str:
    where = ", ".join(
        f"{axis.name} stands at {positions[axis.name] * 1e3:.2f} mm of "
        f"{axis.travel_min_m * 1e3:.2f} … {axis.travel_max_m * 1e3:.2f} mm"
        for axis in axes
    )
    return (
        f"no room for a step of {length * 1e3:g} mm: {where}. Likely the axis was parked at an end stop or has "
        "lost its reference: move it into its travel, or home it, and run again"
    )
