"""The service's end of the connection to the motion process.

The motion process owns the buses; the service has none. Should the process die, the drives notice by the
missing master heartbeat and stop by themselves; the client reports it as a failed run and starts a new one
for the next.
"""

from __future__ import annotations

import contextlib
import multiprocessing
from collections.abc import Callable
from contextlib import AbstractContextManager
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

from service.config import Settings
from service.motion.messages import (
    Abort,
    Alive,
    Execute,
    Failed,
    Progress,
    Ready,
    Recorded,
    Request,
    Shutdown,
    Steps,
)
from service.motion.process import MachineOpener, motion_main

START_LIMIT = 20.0
"""Longest start of the motion process [s]; chosen: importing numpy on a slow PC takes seconds."""

END_LIMIT = 5.0
"""Longest end of the motion process before it is killed [s]; chosen: a quick stop and a release take one or two."""

ALIVE_PERIOD = 0.2
"""Period of Alive while a run is under way [s]: a tenth of the process' CLIENT_SILENCE."""


class MotionError(RuntimeError):
    """The run could not be carried out; ``kind`` names the class of the fault in the motion process.

    ``bus_log`` is what was on the buses until then, as a BLF file; empty where nothing was heard.
    """

    def __init__(self, kind: str, message: str, bus_log: bytes = b"") -> None:
        super().__init__(message)
        self.kind = kind
        self.bus_log = bus_log


class MotionClient(AbstractContextManager["MotionClient"]):
    """Starts the motion process when it is first needed, and again after it died.

    ``execute`` is called by one worker thread; ``abort`` may come from any thread.
    """

    def __init__(self, settings: Settings, open_machine: MachineOpener) -> None:
        self._settings = settings
        self._open_machine = open_machine
        self._process: BaseProcess | None = None
        self._connection: Connection | None = None
        self._abort = False

    def __exit__(self, *exc: object) -> None:
        self.close()

    def execute(
        self,
        group: str,
        on_progress: Callable[[Progress], None] = lambda progress: None,
        steps: Steps | None = None,
    ) -> Recorded:
        """Make the diagnostic steps on ``group``, the configured ones or others, and return what was recorded.

        Raises
        ------
        MotionError : the drive, a sensor, the bus or the motion process itself failed; nothing was recorded.
        """
        connection = self._connected()
        try:
            connection.send(Execute(group, steps))
            if self._abort:
                connection.send(Abort())
            return self._await_recording(connection, on_progress)
        except (EOFError, OSError) as error:
            self._reap()
            raise MotionError(
                "MotionProcessLost",
                "the motion process ended in mid-run; the drives stop by themselves when its heartbeat is "
                "missing. Likely a crash or lack of memory: see the journal, then run again",
            ) from error

    def abort(self) -> None:
        """Stop the run that is under way, and any later one at its beginning: the service is ending."""
        self._abort = True

    def close(self) -> None:
        """End the motion process; harmless when there is none."""
        if self._connection is not None:
            with contextlib.suppress(OSError):  # it is gone already, which is what was wanted
                self._connection.send(Shutdown())
        self._reap()

    def _await_recording(self, connection: Connection, on_progress: Callable[[Progress], None]) -> Recorded:
        while True:
            if not connection.poll(ALIVE_PERIOD):
                request: Request = Abort() if self._abort else Alive()
                connection.send(request)
                continue
            match connection.recv():
                case Progress() as progress:
                    on_progress(progress)
                    connection.send(Abort() if self._abort else Alive())
                case Recorded() as recorded:
                    return recorded
                case Failed(kind, message, bus_log):
                    raise MotionError(kind, message, bus_log)

    def _connected(self) -> Connection:
        if self._process is not None and not self._process.is_alive():
            self._reap()
        if self._connection is None:
            self._start()
        assert self._connection is not None
        return self._connection

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(
            target=motion_main, args=(theirs, self._settings, self._open_machine), name="flankwatch-motion"
        )
        process.start()
        theirs.close()
        self._process, self._connection = process, ours
        self._await_ready(ours)

    def _await_ready(self, connection: Connection) -> None:
        try:
            reply = connection.recv() if connection.poll(START_LIMIT) else None
        except EOFError:
            reply = None
        if isinstance(reply, Ready):
            return
        self._reap()
        if isinstance(reply, Failed):
            raise MotionError(reply.kind, reply.message)
        raise MotionError(
            "MotionProcessLost", f"the motion process did not start within {START_LIMIT:g} s: see the journal"
        )

    def _reap(self) -> None:
        if self._connection is not None:
            self._connection.close()
        if self._process is not None:
            self._process.join(END_LIMIT)
            if self._process.is_alive():
                self._process.kill()
                self._process.join()
            self._process.close()
        self._process = self._connection = None
