"""The backlash's variance by the noise of the motor's speed, against fits of speeds with more of that noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from service.backlash import model_fit
from service.backlash.model_fit_data import measure
from service.backlash.model_fit_input_noise import errors_of_samples, input_variance
from service.backlash.model_fit_interval import linearised
from service.backlash.model_fit_problem import fit
from service.backlash.model_fit_single import single_fit
from service.backlash.model_fit_stages import backlashes, following_force
from service.backlash.model_fit_start import closed_form
from service.backlash.rest_noise import sample_noise
from service.captures import read_capture

DRAWS = 12


def test_refits_of_noisier_speeds_scatter_by_what_is_expected(shared_dir: Path) -> None:
    """Nothing of the influence is used by the refits; twelve of them know their scatter to a fifth."""
    recording = read_capture(shared_dir / "captures" / "declared-single-02.parquet")
    measured = measure(recording, ("X1",), range(len(recording.moves)))
    best = single_fit(measured, {"X1": closed_form(recording, "X1")}, model_fit.SINGLE).best
    linear = linearised(best.problem, best.fit.point)
    expected = np.sqrt(input_variance(measured, best, linear.influence(model_fit.coordinate(best, 0))))
    speed, rng = recording.traces["X1", "motor_speed"], np.random.default_rng(1)
    sigma, found = sample_noise(speed, recording), []
    for _ in range(DRAWS):
        noisier = replace(speed, value=speed.value + rng.normal(0.0, sigma, len(speed)))
        traces = {**recording.traces, ("X1", "motor_speed"): noisier}
        again = measure(replace(recording, traces=traces), ("X1",), range(len(recording.moves)))
        problem = following_force(
            again, replace(best.problem, motion=again.motion, echoes=(), force=None), best.fit
        )
        found.append(float(backlashes(problem, fit(problem, best.fit.point, 6, 0.3))[0]))
    assert 0.6 < np.std(found) / expected < 1.7


def test_a_samples_error_is_seen_around_its_time_only_and_all_together_are_a_speed() -> None:
    time, h, K = 1e-3 * np.arange(200), 2.5e-4, 100
    starts = (0.0501, 0.1203)
    errors = errors_of_samples(time, np.full(200, 0.3), starts, h, K)
    together = errors.sum(axis=0)
    np.testing.assert_allclose(together[..., 1], 0.3, rtol=1e-9)
    np.testing.assert_allclose(together[:, :, 0], np.tile(0.3 * h * np.arange(K), (2, 1)), atol=1e-12)
    one = np.abs(errors[12, 0, :, 1])
    middle = starts[0] + h * np.arange(K)
    own = time[np.flatnonzero(time > starts[0])[0] - 4 + 12]
    assert abs(middle[np.argmax(one)] - own) < 1e-3
    assert np.max(one[np.abs(middle - own) > 8e-3]) < 0.01 * np.max(one)
