"""The connection to the motion process: what comes back, and what happens when either end dies."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.config import Settings, load_settings
from service.motion.client import MotionClient, MotionError
from service.motion.messages import Alive, Execute, Failed, Progress, Ready
from service.motion.process import motion_main
from tests.service.motion.fake_machine import open_broken, open_fake

EXAMPLE = Path(__file__).parents[3] / "deploy" / "flankwatch.toml"


@pytest.fixture(scope="module")
def settings() -> Settings:
    return load_settings(EXAMPLE)


@pytest.fixture
def client(settings: Settings) -> Iterator[MotionClient]:
    with MotionClient(settings, open_fake) as client:
        yield client


def test_a_run_reports_progress_and_returns_its_recording(client: MotionClient) -> None:
    seen: list[int] = []
    recorded = client.execute("good", lambda progress: seen.append(progress.done))
    assert recorded.recording.machine == "good"
    assert recorded.bus_log == b"frames"
    assert seen == [0, 1, 2]


def test_a_fault_is_reported_by_its_name_and_the_next_run_is_possible(client: MotionClient) -> None:
    with pytest.raises(MotionError, match="0x7305") as caught:
        client.execute("fault")
    assert (caught.value.kind, caught.value.bus_log) == ("DriverError", b"frames")
    assert client.execute("good").recording.machine == "good"


def test_a_crash_is_a_failed_run_and_a_new_process_serves_the_next(client: MotionClient) -> None:
    with pytest.raises(MotionError, match="ended in mid-run") as caught:
        client.execute("crash")
    assert caught.value.kind == "MotionProcessLost"
    assert client.execute("good").recording.machine == "good"


def test_a_run_can_be_aborted(client: MotionClient) -> None:
    with pytest.raises(MotionError, match="on request") as caught:
        client.execute("endless", lambda progress: client.abort() if progress.done == 5 else None)
    assert caught.value.kind == "RunStopped"


def test_a_machine_that_cannot_be_opened_says_why(settings: Settings) -> None:
    with (
        MotionClient(settings, open_broken) as client,
        pytest.raises(MotionError, match="can0 does not exist"),
    ):
        client.execute("good")


def test_the_process_stops_the_run_of_a_client_that_fell_silent(settings: Settings) -> None:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=motion_main, args=(theirs, settings, open_fake))
    process.start()
    theirs.close()
    try:
        assert isinstance(ours.recv(), Ready)
        ours.send(Execute("endless"))
        ours.send(Alive())
        started = time.monotonic()
        while isinstance(reply := ours.recv(), Progress):
            assert time.monotonic() - started < 30
        assert isinstance(reply, Failed)
        assert "silent" in reply.message
    finally:
        ours.close()
        process.join(10)
        process.close()
