"""What is said of a residual beside a verdict."""

from __future__ import annotations

import numpy as np
import pytest

from service.dynamics.effects.driven_library import DRIVEN
from service.identification.axis_evidence import in_time, of_motor, zeros_found_again

ALTERNATING = np.tile([1.0, -1.0], 5)


@pytest.mark.parametrize(
    ("sizes", "said"),
    [
        (np.ones(10), None),
        (np.tile([1.0, 4.0], 5), None),
        (np.repeat([1.0, 3.0], [4, 6]), "at once after held-out move 4, to 3 times"),
        (np.repeat([3.0, 1.0], [7, 3]), "at once after held-out move 7, to 0.33 times"),
        (np.linspace(1.0, 5.0, 10), "steadily along the recording, to 5"),
        (np.linspace(4.0, 1.0, 10), "steadily along the recording, to 0.25"),
        (1.0 + np.linspace(-1.2, 1.8, 10) ** 2, "from move to move, up to"),
        (np.array([1.0, 3.0, 2.0, 1.0, 3.0, 2.5, 1.0, 2.0, 3.0, 1.0]), "from move to move, up to"),
    ],
)
def test_how_a_residual_goes_on_along_a_recording_is_said(sizes: np.ndarray, said: str | None) -> None:
    """A residual that differs by direction only does not change with time."""
    errors = sizes[:, None] * np.where(np.arange(400) % 2, 1.0, -1.0)
    direction = ALTERNATING if said is None else np.ones(10)
    lines = in_time(errors, direction)
    assert len(lines) == (said is not None)
    assert said is None or said in lines[0]


def test_a_step_shows_beside_two_directions_too() -> None:
    sizes = np.repeat([1.0, 2.5], [5, 5]) * np.where(ALTERNATING > 0, 1.0, 2.0)
    errors = sizes[:, None] * np.where(np.arange(400) % 2, 1.0, -1.0)
    assert "at once after held-out move 5" in in_time(errors, ALTERNATING)[0]


def test_of_few_moves_no_course_is_told() -> None:
    assert in_time(np.array([[1.0], [9.0], [1.0]]), np.ones(3)) == ()


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("transmission_ripple",), "ripple_phase"),
        (("position_dependent_force", "transmission_ripple"), "spring_zero, ripple_phase"),
        (("sensor_latency",), None),
    ],
)
def test_which_zeros_are_found_again_is_said(names: tuple[str, ...], said: str | None) -> None:
    lines = zeros_found_again([DRIVEN[name](("X1", "X2")).refined for name in names])
    assert lines == (
        () if said is None else (f"found again in the first 45 % of the held-out moves: {said}",)
    )


def test_what_the_motor_says_is_told_where_a_torque_was_recorded() -> None:
    assert of_motor(0.0, "declared") == ()
    (line,) = of_motor(10.06, "declared")
    assert "the declared model leaves at 10.1 of their noise" in line
