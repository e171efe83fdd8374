"""Machines that the motion process opens in tests: no bus, only the behaviour that the connection must survive."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from drivers.errors import DriverError
from service.config import Settings
from service.motion.messages import Progress, Recorded, Steps
from service.recording import Recording


class FakeMachine:
    def execute(
        self,
        group: str,
        guard: Callable[[], None],
        on_progress: Callable[[Progress], None],
        steps: Steps | None = None,
    ) -> Recorded:
        if group == "fault":
            raise DriverError("drive X1 reports fault 0x7305")
        if group == "crash":
            os._exit(9)
        for step in range(3 if group == "good" else 100_000):
            on_progress(Progress(step, 3, group))
            guard()
            time.sleep(0.01)
        return Recorded(Recording(machine=group, axes=(), traces={}))

    def bus_log(self) -> bytes:
        return b"frames"


@contextmanager
def open_fake(settings: Settings) -> Iterator[FakeMachine]:
    yield FakeMachine()


@contextmanager
def open_broken(settings: Settings) -> Iterator[FakeMachine]:
    raise DriverError("can0 does not exist")
    yield FakeMachine()
