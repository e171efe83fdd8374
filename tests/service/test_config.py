"""The configuration: a real example that holds, and every way to get it wrong named with its remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from service.config import ConfigError, load_settings

EXAMPLE = Path(__file__).parents[2] / "deploy" / "flankwatch.toml"


def write(tmp_path: Path, *changes: tuple[str, str]) -> Path:
    text = EXAMPLE.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    path = tmp_path / "machine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_example_is_a_whole_machine() -> None:
    settings = load_settings(EXAMPLE)
    assert settings.groups == {"X": ("X1", "X2"), "Y": ("Y",)}
    assert settings.axis_named("X1").transmission == pytest.approx(0.003)
    assert settings.group_of("X2") == "X"
    assert settings.group_of("Z") is None


def test_the_environment_overrides_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FLANKWATCH_API__PORT", "9999")
    assert load_settings(EXAMPLE).api.port == 9999


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("gear_ratio = 10.0\ntravel_min_m = -0.75", "gear_ration = 10.0\ntravel_min_m = -0.75", "gear_ratio"),
        ("[schedule]", "[shedule]", "is schedule meant"),
        ("step_length_m = 0.004", "step_length_m = 3.5", "longer than its travel"),
        ("jerk_m_s3 = 200.0", "jerk_m_s3 = 9000.0", "a_max"),
        ("velocity_limit_m_s = 1.5", "velocity_limit_m_s = 0.05", "v_max"),
        ("nominal_rate_hz = 4000.0", "nominal_rate_hz = 8000.0", "at most 70%"),
        ("nominal_rate_hz = 4000.0", "nominal_rate_hz = 100.0", "greater than or equal to 500"),
        ("node_id = 2", "node_id = 1", "share a node id"),
        ("sync_producer = true ", "sync_producer = false ", "exactly one drive"),
        ('axes = ["X1", "X2"]', 'axes = ["X1", "X9"]', "X9 is not declared"),
        ("data_id = 0x301", "data_id = 0x300", "0x300"),
        ('bus = "sensors"\ndata_id = 0x300', 'bus = "nowhere"\ndata_id = 0x300', "not declared"),
        ('timezone = "Europe/Berlin"', 'timezone = "Europe/Bern"', "IANA"),
        ('host = "127.0.0.1"', 'host = "0.0.0.0"', "token_sha256"),
        ("gear_ratio = 10.0", "gear_ratio = -10.0", "greater than 0"),
        ('name = "X"\n', 'name = "Y"\n', "named like an axis"),
        ("# diagnostic_positions_m = [-0.6,", "diagnostic_positions_m = [-0.7485,", "no room for a step"),
        ("# diagnostic_positions_m = [-0.6,", "diagnostic_positions_m = [-0.6, -0.597,", "one place"),
        (
            "travel_max_m = 3.0\nvelocity_limit_m_s = 1.5\nacceleration_limit_m_s2 = 10.0\nreference",
            "travel_max_m = 3.0\nvelocity_limit_m_s = 1.5\nacceleration_limit_m_s2 = 10.0\n"
            "diagnostic_positions_m = [1.5]\nreference",
            "give both the same",
        ),
        ("jerk_m_s3 = 20.0 ", "jerk_m_s3 = 0.0 ", "greater than 0"),
    ],
)
def test_what_cannot_work_is_refused_with_its_reason(tmp_path: Path, old: str, new: str, says: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_settings(write(tmp_path, (old, new)))
    assert "machine.toml" in str(caught.value)
    assert says in str(caught.value)


def test_a_gantry_on_500_kbit_is_an_impossible_load(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="at most 70%"):
        load_settings(write(tmp_path, ("bitrate = 1_000_000", "bitrate = 500_000")))


def test_broken_toml_and_absent_files_are_named(tmp_path: Path) -> None:
    broken = tmp_path / "broken.toml"
    broken.write_text("[machine", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"broken\.toml: is not TOML"):
        load_settings(broken)
    with pytest.raises(ConfigError, match=r"absent\.toml: cannot be read"):
        load_settings(tmp_path / "absent.toml")
