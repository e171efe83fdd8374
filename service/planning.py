"""``flankwatch plan``: from a configuration or from options to a proposed step, in SI units."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from service.backlash.excitation import CHAIN_OF_TWO, GANTRY_OF_LUMPS, Limits, NoStep, Proposal, propose
from service.backlash.step_information import Sensing
from service.config import Settings

WANTED = (0.3e-6, 0.005)
"""Half width that more than ten steps are spent for: the larger of the two [m] and share of the backlash."""

LARGEST_JERK = 2000.0
"""j_lim of an axis whose configuration names none [m/s³]. Chosen: ten times the paper's step."""

TYPICAL = 50e-6
"""Expected backlash of an axis without a reference [m]. Chosen: the middle of what is tolerated."""


def of_axis(settings: Settings, name: str) -> tuple[Limits, Sensing, float, int]:
    """Limits, sensing, expected backlash [m] and number of axes that a configuration says of an axis.

    Of a gantry the tighter limit of both axes counts. Raises KeyError for an axis that it does not name.
    """
    group = next((axes for axes in settings.groups.values() if name in axes), None)
    if group is None:
        raise KeyError(name)
    axes = [settings.axis_named(axis) for axis in group]
    axis = settings.axis_named(name)
    bus = next(bus for bus in settings.bus if bus.name == axis.bus)
    limits = Limits(
        v=min(a.velocity_limit_m_s for a in axes),
        a=min(a.acceleration_limit_m_s2 for a in axes),
        jerk=LARGEST_JERK,
        travel=min(a.travel_max_m - a.travel_min_m for a in axes),
    )
    sensing = Sensing(
        speed_rate=1e6 / bus.sync_period_us,
        acceleration_rate=axis.accelerometer.nominal_rate_hz,
        speed_lsb=axis.speed_lsb_rad_s * axis.transmission,
    )
    b = axis.reference_um * 1e-6 if axis.reference_um is not None else TYPICAL
    return limits, sensing, b, len(axes)


def planned(limits: Limits, sensing: Sensing, b: float, axes: int) -> Proposal | NoStep:
    """The proposal for an expected backlash b [m], with what the fit's structure is worth in its interval."""
    lacking = CHAIN_OF_TWO if axes == 1 else GANTRY_OF_LUMPS
    return propose(limits, sensing, b, lacking, max(WANTED[0], WANTED[1] * b), axes)


def as_json(found: Proposal | NoStep, b: float) -> dict[str, Any]:
    """One JSON object, SI units; a plan that is none has the limit in its way and what to do."""
    if isinstance(found, NoStep):
        return {"verdict": "refused", "expected_backlash_m": b, **asdict(found)}
    return {
        "verdict": "ok",
        "expected_backlash_m": b,
        "step_length_m": found.length,
        "jerk_m_s3": found.jerk,
        "steps": found.steps,
        "duration_s": found.duration,
        "v_max_m_s": found.v_max,
        "a_max_m_s2": found.a_max,
        "gap_time_s": found.gap_time,
        "half_width_95_m": found.half_width,
        "expected_interval_95_m": [b - found.half_width, b + found.half_width],
        "half_width_95_by_noise_m": found.noise_alone,
    }


def in_words(found: Proposal, b: float) -> str:
    """The proposal as lines for a configuration, and what to expect of it."""
    return "\n".join(
        (
            "[excitation]",
            f"step_length_m = {found.length:.4g}",
            f"jerk_m_s3 = {found.jerk:.4g}",
            f"steps = {found.steps}",
            "",
            f"# {found.duration * 1e3:.0f} ms, v_max {found.v_max * 1e3:.0f} mm/s, a_max {found.a_max:.2f} m/s²; the "
            f"gap is passed in {found.gap_time * 1e3:.1f} ms or more",
            f"# expected: {b * 1e6:.1f} ± {found.half_width * 1e6:.2f} µm (95 %), of which the sensor's noise "
            f"{found.noise_alone * 1e6:.2f} µm",
        )
    )
