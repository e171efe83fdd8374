"""The simulated machine: CiA 402 drives and accelerometers on virtual buses, moved by a physics from outside.

It is the same wire from the device's side, for the demo and the tests; nothing else imports it. All frames carry
machine time, which begins at 0 when the machine is switched on. Unpaced, it is as fast as the PC, and one seed
gives the same bytes at the same machine times run after run: see ``pacing`` for how and under which condition.
Answers to SDO carry the machine time at which they were given. The order of SDO answers among the frames of a
moving axis is the one thing left to chance, as is the time of a stop that the master commands in mid-move.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from drivers.sim.accelerometer_node import AccelerometerConfig, AccelerometerNode
from drivers.sim.core import Line, MachineCore
from drivers.sim.drive_config import DriveConfig
from drivers.sim.drive_node import DriveNode
from drivers.sim.pacing import LockStep, Timing, run_paced
from drivers.sim.physics import Physics
from drivers.sim.wire import Wire

log = logging.getLogger(__name__)

EDS = Path(__file__).parents[1] / "drive.eds"


class SimulatedMachine:
    """A machine that runs in a thread of its own between ``start`` and ``stop``, or as a context manager.

    Parameters
    ----------
    buses : names of virtual channels, to be opened with ``preserve_timestamps=True`` by whoever listens
    physics : moves all axes; its axes without a drive are never powered
    seed : of everything that is random: noise, jitter, losses
    paced : True lets machine time pass as wall time, for people to watch
    timing : of the unpaced machine
    bitrate : of all buses [bit/s]; spaces the frames, is not a limit
    """

    def __init__(
        self,
        buses: Sequence[str],
        drives: Sequence[DriveConfig],
        accelerometers: Sequence[AccelerometerConfig],
        physics: Physics,
        *,
        seed: int,
        paced: bool = False,
        timing: Timing | None = None,
        bitrate: int = 1_000_000,
    ) -> None:
        _check_wiring(buses, drives, accelerometers, physics)
        self._lines = {bus: Line(Wire(bus, bitrate)) for bus in buses}
        for drive in drives:
            self._lines[drive.bus].drives.append(DriveNode(drive, EDS, physics.dt, seed))
        for sensor in accelerometers:
            self._lines[sensor.bus].accelerometers.append(AccelerometerNode(sensor, physics.dt, seed))
        self._core = MachineCore(list(self._lines.values()), physics)
        self._paced, self._timing = paced, timing or Timing()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="simulated machine")
        self._failure: BaseException | None = None

    @property
    def time(self) -> float:
        """Machine time [s]."""
        return self._core.time

    @property
    def frames_sent(self) -> int:
        """Frames sent so far on all buses."""
        return sum(line.wire.frames_sent for line in self._lines.values())

    @property
    def frames_lost(self) -> int:
        """Frames that a listener's full queue did not take."""
        return sum(line.wire.frames_lost for line in self._lines.values())

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        """Switch off, wait for the thread, leave the buses; raises what ended the thread before its time."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()
        for line in self._lines.values():
            line.wire.close()
        if self._failure is not None:
            raise RuntimeError("the simulated machine broke down and fell silent") from self._failure

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def _run(self) -> None:
        try:
            if self._paced:
                run_paced(self._core, self._stop)
            else:
                LockStep(self._core, self._stop, self._timing).run()
        except BaseException as error:
            log.exception("the simulated machine broke down; its buses are silent from here on")
            self._failure = error


def _check_wiring(
    buses: Sequence[str],
    drives: Sequence[DriveConfig],
    accelerometers: Sequence[AccelerometerConfig],
    physics: Physics,
) -> None:
    if not buses:
        raise ValueError("a machine needs at least one bus")
    parts: list[DriveConfig | AccelerometerConfig] = [*drives, *accelerometers]
    for part in parts:
        if part.bus not in buses:
            raise ValueError(f"{part.axis} is wired to bus {part.bus!r}, the machine has {list(buses)}")
        if part.axis not in physics.axes:
            raise ValueError(f"axis {part.axis!r} is unknown to the physics, which has {list(physics.axes)}")
    nodes = [(drive.bus, drive.node_id) for drive in drives]
    ids = [(s.bus, can_id) for s in accelerometers for can_id in (s.data_id, s.time_id)]
    if len(set(nodes)) < len(nodes) or len(set(ids)) < len(ids):
        raise ValueError("two parts of the machine share a node id or a CAN identifier on one bus")
