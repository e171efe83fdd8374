"""The motion process: owns the buses, executes one plan at a time, and stops the axes when anything is amiss.

Nothing else runs in it, so that neither a slow database nor a long fit can delay a quick stop.
"""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Protocol

from drivers.errors import DriverError
from service.config import Settings
from service.motion.messages import Abort, Execute, Failed, Progress, Ready, Recorded, Reply, Shutdown, Steps
from service.motion.plan import NotPermitted

CLIENT_SILENCE = 2.0
"""A run is stopped when the service was not heard for this long [s]; chosen: ten missed Alive messages."""


class RunStopped(RuntimeError):
    """The run was stopped on request, or because the service fell silent."""


class Machine(Protocol):
    """The machine behind the buses, as the motion process uses it."""

    def execute(
        self,
        group: str,
        guard: Callable[[], None],
        on_progress: Callable[[Progress], None],
        steps: Steps | None = None,
    ) -> Recorded:
        """Make the steps; ``guard`` is called at least every 50 ms and raises to stop them."""

    def bus_log(self) -> bytes:
        """The frames of the last run as a BLF file, however it ended; empty where nothing was heard."""


MachineOpener = Callable[[Settings], AbstractContextManager[Machine]]
"""Opens buses and drives; must be importable by name, because the process is spawned."""


def motion_main(connection: Connection, settings: Settings, open_machine: MachineOpener) -> None:
    """Body of the motion process: open the machine, answer requests until Shutdown or a closed connection."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the service's to handle; it sends Shutdown
    try:
        with open_machine(settings) as machine:
            connection.send(Ready())
            _serve(connection, machine)
    except (DriverError, OSError) as error:
        _try_send(connection, Failed(type(error).__name__, str(error)))


def _serve(connection: Connection, machine: Machine) -> None:
    while True:
        try:
            request = connection.recv()
        except (EOFError, OSError):
            return
        if isinstance(request, Shutdown):
            return
        if isinstance(request, Execute):
            _try_send(connection, _execute(connection, machine, request))


def _execute(connection: Connection, machine: Machine, request: Execute) -> Reply:
    guard = _ClientGuard(connection)
    try:
        recorded = machine.execute(request.group, guard, connection.send, request.steps)
    except (DriverError, NotPermitted, RunStopped, OSError) as error:
        return Failed(type(error).__name__, str(error), machine.bus_log())
    return replace(recorded, bus_log=machine.bus_log())


def _try_send(connection: Connection, reply: Reply) -> None:
    with contextlib.suppress(OSError):  # the service is gone; the next recv ends the process
        connection.send(reply)


class _ClientGuard:
    """Raises RunStopped when the service asks for it, or has not been heard."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._heard = time.monotonic()

    def __call__(self) -> None:
        while self._connection.poll():
            try:
                request = self._connection.recv()
            except (EOFError, OSError) as error:
                raise RunStopped("the service closed its connection; the axes were stopped") from error
            if isinstance(request, Abort | Shutdown):
                raise RunStopped("the run was stopped on request; the axes stand, and may be used again")
            self._heard = time.monotonic()
        if time.monotonic() - self._heard > CLIENT_SILENCE:
            raise RunStopped(
                f"the service was silent for {CLIENT_SILENCE:g} s; the axes were stopped. Likely the PC is "
                "overloaded or the service hung: see the journal"
            )
