"""The command line as a program and as a person uses it: answers, exit status, and what is said of bad input."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
from typer.testing import CliRunner, Result

from service import cli
from service.backlash.results import Reason
from service.captures import write_capture
from service.cli import app
from service.dynamics.parameters import AxisParameters
from service.dynamics.simulation import simulate, ten_steps
from service.recording import AxisDescription, Recording, Trace

B = 60e-6


def simulated() -> Recording:
    """A clean run of a simulated axis with backlash B, sampled like a drive and a sensor do."""
    parameters = AxisParameters(b=B)
    run = simulate(parameters, ten_steps())
    measured = run.axes["X1"].measured
    means = np.diff(measured.load_speed[::2]) / np.diff(run.time[::2])
    noise = np.random.default_rng(7).normal(0.0, 0.03, len(means))
    return Recording(
        machine="simulated",
        axes=(
            AxisDescription(
                "X1", parameters.transmission, rates={"motor_speed": 1000.0, "acceleration": 4000.0}
            ),
        ),
        traces={
            ("X1", "motor_speed"): Trace(run.time[7::8], measured.motor_speed[7::8]),
            ("X1", "acceleration"): Trace(run.time[1::2][: len(means)], means + noise),
        },
        moves=run.moves,
    )


@pytest.fixture(scope="module")
def sound() -> Recording:
    return simulated()


def changed(recording: Recording, channel: str, factor: float) -> Recording:
    traces = dict(recording.traces)
    trace = traces["X1", channel]
    traces["X1", channel] = Trace(trace.time, factor * trace.value)
    return replace(recording, traces=traces)


def without(recording: Recording, channel: str) -> Recording:
    return replace(recording, traces={k: v for k, v in recording.traces.items() if k[1] != channel})


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def analysed(recording: Recording, path: Path) -> dict[str, Any]:
    write_capture(recording, path)
    result = call("analyze", path, "--json")
    assert result.exit_code == 0, result.stderr
    return dict(json.loads(result.stdout)["axes"][0])


def test_a_sound_capture_gives_a_value_near_its_truth(sound: Recording, tmp_path: Path) -> None:
    axis = analysed(sound, tmp_path / "run.parquet")
    assert (axis["verdict"], axis["reason"]) == ("ok", None)
    assert axis["backlash_m"] == pytest.approx(B, abs=1e-6)
    assert axis["interval_95_m"][0] < axis["backlash_m"] < axis["interval_95_m"][1]
    assert [step["index"] for step in axis["steps"]] == list(range(10))
    assert set(axis["steps"][0]) == {
        "index", "direction", "verdict", "reason", "backlash_m", "t1_s", "t2_s", "position_m",
    }  # fmt: skip


def test_csv_and_parquet_give_the_same_answer(sound: Recording, tmp_path: Path) -> None:
    as_csv, as_parquet = analysed(sound, tmp_path / "run.csv"), analysed(sound, tmp_path / "run.parquet")
    assert as_csv == as_parquet


@pytest.mark.parametrize(
    ("channel", "factor"),
    [
        ("motor_speed", 60 / (2 * np.pi)),
        ("acceleration", 1 / 9.80665),
        ("motor_speed", -1.0),
        ("acceleration", -1.0),
    ],
)
def test_wrong_units_and_signs_are_refused(
    sound: Recording, tmp_path: Path, channel: str, factor: float
) -> None:
    axis = analysed(changed(sound, channel, factor), tmp_path / "run.parquet")
    assert axis["verdict"] == "refused"
    assert axis["reason"] in set(Reason)
    assert axis["backlash_m"] is None
    assert axis["interval_95_m"] is None


@pytest.mark.parametrize("channel", ["motor_speed", "acceleration"])
def test_one_channel_alone_is_refused(sound: Recording, tmp_path: Path, channel: str) -> None:
    axis = analysed(without(sound, channel), tmp_path / "run.parquet")
    assert (axis["verdict"], axis["reason"]) == ("refused", "channel_missing")


def test_a_capture_without_moves_is_refused(sound: Recording, tmp_path: Path) -> None:
    axis = analysed(replace(sound, moves=()), tmp_path / "run.parquet")
    assert (axis["verdict"], axis["reason"]) == ("refused", "no_moves")


def test_what_cannot_be_read_is_named_and_the_others_are_still_analysed(
    sound: Recording, tmp_path: Path
) -> None:
    good, torn, absent = (tmp_path / name for name in ("good.parquet", "torn.parquet", "absent.parquet"))
    write_capture(sound, good)
    torn.write_bytes(good.read_bytes()[:5000])
    result = call("analyze", absent, torn, good, "--json")
    assert result.exit_code == 1
    assert [json.loads(line)["capture"] for line in result.stdout.splitlines()] == [str(good)]
    assert str(absent) in result.stderr
    assert str(torn) in result.stderr


@pytest.mark.parametrize(("asked", "threads"), [(None, "1"), ("4", "4")])
def test_numbers_do_not_depend_on_the_cores_of_a_machine(
    monkeypatch: pytest.MonkeyPatch, asked: str | None, threads: str
) -> None:
    """A fit is chaotic far from its end: another order of a sum may lead to another answer."""
    for variable in cli.ONE_THREAD:
        monkeypatch.setenv(variable, asked or "")
        if not asked:
            monkeypatch.delenv(variable)
    monkeypatch.setattr(cli, "app", lambda: None)
    cli.main()
    assert [os.environ[variable] for variable in cli.ONE_THREAD] == [threads, threads]
    assert "numpy" not in modules_of("import service.cli"), "they are read when it is imported"


def modules_of(statement: str) -> set[str]:
    """What is imported by a statement in a Python of its own."""
    command = [sys.executable, "-c", f"{statement}; import sys; print(*sys.modules)"]
    return set(subprocess.run(command, check=True, capture_output=True, text=True).stdout.split())


def test_a_picture_of_a_step_is_drawn(sound: Recording, tmp_path: Path) -> None:
    capture, out = tmp_path / "run.parquet", tmp_path / "step.svg"
    write_capture(sound, capture)
    assert call("picture", capture, "--out", out, "--step", 3).exit_code == 0
    drawn = out.read_text(encoding="utf-8")
    assert drawn.startswith("<svg")
    assert "step 4 of 10, backward" in drawn
    refused = call("picture", capture, "--out", out, "--step", 99)
    assert refused.exit_code == 1
    assert "no step 99" in refused.stderr


def test_a_configuration_is_explained_or_refused(tmp_path: Path) -> None:
    example = Path(__file__).parents[2] / "deploy" / "flankwatch.toml"
    told = call("check-config", example)
    assert told.exit_code == 0
    assert "group X: X1, X2" in told.stdout
    assert "travels" not in told.stdout
    travelling = tmp_path / "travelling.toml"
    text = example.read_text(encoding="utf-8").replace("# diagnostic_positions_m", "diagnostic_positions_m")
    travelling.write_text(text, encoding="utf-8")
    assert "group Y: Y; every check travels to -0.6 m, 0 m, 0.6 m and back, at 0.25 m/s" in call(
        "check-config", travelling
    ).stdout.replace("\n", " ")
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(example.read_text(encoding="utf-8").replace("[machine]", "[machin]"), encoding="utf-8")
    refused = call("check-config", wrong)
    assert refused.exit_code == 1
    assert "is machine meant?" in refused.stderr


@pytest.mark.parametrize(
    ("url", "says"), [("http://127.0.0.1:9", "is it running?"), ("ftp://x", "use http://host:port")]
)
@pytest.mark.parametrize("command", [("check", "X1"), ("explain", "--run", "1")])
def test_without_a_service_it_says_what_to_do(command: tuple[str, ...], url: str, says: str) -> None:
    result = call(*command, "--url", url)
    assert result.exit_code == 1
    assert says in result.stderr


def test_explain_finds_the_time_skew_of_a_real_robot(shared_dir: Path, tmp_path: Path) -> None:
    """KUKA axis 3, trained on recording a and judged on b: the skew between its two encoders is 3.0 ± 0.3 ms."""
    train, validate = (shared_dir / "measured" / f"kuka-a3-{name}.parquet" for name in "ab")
    out = tmp_path / "predictions.parquet"
    result = call("explain", "--train", train, "--validate", validate, "--json", "--predictions", out)
    assert result.exit_code == 0, result.stderr
    axis = json.loads(result.stdout)["axes"][0]
    assert axis["effects"][0] == "sensor_latency"
    assert axis["after"]["validation_rms"] < 0.2 * axis["before"]["validation_rms"]
    columns = pyarrow.parquet.read_table(out)
    assert columns.column_names == ["time_s", "axis", "channel", "model", "value"]
    assert set(columns["model"].to_pylist()) == {"before", "after"}


def test_explain_does_not_judge_on_what_it_fitted(shared_dir: Path) -> None:
    path = shared_dir / "measured" / "kuka-a3-a.parquet"
    result = call("explain", "--train", path, "--validate", path)
    assert result.exit_code == 1
    assert "same recording" in result.stderr


def test_patience_is_for_recordings_not_for_runs() -> None:
    result = call("explain", "--run", 1, "--patience", 5)
    assert result.exit_code == 2
    assert "as long as usual" in result.stderr
    assert call("explain", "--run", 1, "--patience", 0).exit_code == 2


def test_plan_proposes_a_step_for_an_axis_of_the_configuration() -> None:
    config = Path(__file__).parents[2] / "deploy" / "flankwatch.toml"
    result = CliRunner().invoke(app, ["plan", "Y", "--config", str(config), "--json"])
    found = json.loads(result.stdout)
    assert (result.exit_code, found["verdict"]) == (0, "ok")
    assert found["expected_backlash_m"] == pytest.approx(45e-6)
    assert found["a_max_m_s2"] < 10.0
    assert found["expected_interval_95_m"][0] < 45e-6 < found["expected_interval_95_m"][1]


def test_plan_names_the_limit_that_is_in_the_way() -> None:
    result = CliRunner().invoke(
        app, ["plan", "--v-lim", "1", "--a-lim", "0.05", "--travel-mm", "10", "--json"]
    )
    assert result.exit_code == 1
    assert json.loads(result.stdout)["limit"] == "acceleration"


def test_plan_without_limits_says_what_it_needs() -> None:
    result = CliRunner().invoke(app, ["plan", "--v-lim", "1"])
    assert result.exit_code == 2
    assert "--a-lim" in result.stderr
