"""Who lets the machine's time pass: the wall clock, or the master's own conversation with it.

In lock-step time stands still while the machine waits for the master, and flies while an axis moves:

- Frozen, the machine takes commands one by one, each at the same machine time whatever the wall clock says. SDO
  costs no time. A command that others can see is followed by ``answer_s`` in which they see it; enabling or moving
  an axis by ``rest_s``, which begins again when the axis has come to rest.
- While time passes, commands are kept for the next halt. At once go only, in mid-move, those that stop an axis or
  merely read. After a set-point there is one more halt, for the master to answer the acknowledgement (bit 12).
  A halt waits for the other enabled drives' set-points too, so that the sides of a gantry start together.
- A drive that keeps its torque until its brake grips is not left at a halt: time passes until it has answered.
- A master that says nothing for ``patience_s`` of wall time, having read all frames, is waiting for time to pass:
  it is given ``idle_s``. While a drive is enabled, a master has ``patience_enabled_s``: what comes next depends on
  it, and it need not wait for bus time beyond ``rest_s``. Where nobody listens at all, time stands still.

So the machine time at which a command takes effect does not depend on the threads' luck, as long as a master that
is not waiting for bus time answers within that patience, and waits for bus time no longer than ``rest_s`` after a
move (or else always longer than the luck of one ``idle_s``). A stop in mid-move comes when it comes.

The drives' watch over the master runs on machine time as well. Before it would expire, time stands still until
the master has beaten or has been silent for the same span of wall time: a master that beats by the wall clock is
never declared lost for the machine's haste, and one that fell silent is lost after exactly 0x1016.
Flow control: time waits for a listener more than ``window`` frames behind, but not for ever for a deaf one.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass

from drivers.sim.communication import TICK
from drivers.sim.core import Command, MachineCore

BLOCK = 5
"""Ticks that pass between two looks at the inbox; chosen: a drive's reaction time of up to 5 ms."""

REST_BLOCK = 20
"""The same where no axis moves and all commands are kept for the halt; saves two thirds of the work."""

_WAIT = 0.01
"""Length of one wait for a command [s of wall time]; a busy PC stretches it, as it does the master's reactions."""

_DIGESTION = 0.002
"""Wall time [s] that a listener is given at a halt to deal with the last frames it took; chosen: a batch of them."""

NMT = 0x000
"""CAN id of NMT commands."""

_SLIP = 0.25
"""A paced machine that is later than this [s] was stopped with its PC: its clock slips instead of racing."""


@dataclass(frozen=True)
class Timing:
    """How lock-step deals with time; ``_s`` of machine time except ``patience_s`` … ``deaf_s`` of wall time.

    Attributes
    ----------
    rest_s : chosen longer than the rest before a step (0.35 s) plus settling, so that a run never idles
    answer_s : ten SYNCs show what a command did
    beat_s : what follows an NMT command: the next heartbeat, at most 100 ms away, tells the new state
    idle_s : shorter than any time limit of the master
    patience_s : counted in waits that a busy PC stretches; a hundred times a master's reaction time
    patience_enabled_s : ten periods (100 ms) by which a container's share of the processor is rationed, thread by
        thread: the master may stand still for one while the machine's thread does not
    rolling_s : an axis without torque that is still rolling after this (on a slope, without a brake) is not waited
        for any longer: a drive answers its master all the same
    switch_on_s : a master that only listens sees the machine boot after this
    deaf_s : a listener that read nothing for so long is no longer waited for
    window : frames that the slowest listener may be behind while an axis moves, about 20 ms of one axis; eight
        times as many at rest, where nobody must react
    """

    rest_s: float = 0.5
    answer_s: float = 0.01
    beat_s: float = 0.11
    idle_s: float = 0.25
    rolling_s: float = 2.0
    patience_s: float = 0.12
    patience_enabled_s: float = 1.0
    switch_on_s: float = 1.0
    deaf_s: float = 5.0
    window: int = 64


class LockStep:
    """Lets time pass as the master's commands and silences ask for it, as fast as possible."""

    def __init__(self, core: MachineCore, stop: threading.Event, timing: Timing) -> None:
        self._core, self._stop, self._timing = core, stop, timing
        self._held: deque[Command] = deque()
        self._deaf = False

    def run(self) -> None:
        """Until ``stop``: halt, take commands, let time pass."""
        self._await_first_command()
        self._pass(self._timing.answer_s)
        while not self._stop.is_set():
            if not self._held and not self._core.listened_to:
                self._await_first_command()
            self._pass(self._halt())

    # -- time stands still

    def _await_first_command(self) -> None:
        """Nobody is there: time stands still until a master's first command, or for a listener without a word."""
        deadline = None
        while not self._stop.is_set() and (deadline is None or time.monotonic() < deadline):
            if (command := self._core.receive(_WAIT)) is not None:
                self._held.append(command)
                return
            if deadline is None and self._core.listened_to:
                deadline = time.monotonic() + self._timing.switch_on_s

    def _halt(self) -> float:
        """Take commands until one of them, or their absence, asks for time; how much [s]."""
        self._let_listeners_finish()
        while (command := self._next_command()) is not None:
            before, moves, powered = self._core.situation, self._core.moves, self._core.powered
            self._core.apply(command)
            if self._core.moves > moves:
                self._let_others_join()
                return self._timing.rest_s
            if self._core.powered > powered:
                return self._timing.rest_s
            if command.can_id == NMT:
                return self._timing.beat_s
            if self._core.situation != before:
                return self._timing.answer_s
        return self._timing.idle_s if self._core.listened_to else 0.0

    def _let_others_join(self) -> None:
        while self._core.waiting_to_join and (command := self._next_command()) is not None:
            self._core.apply(command)
        self._pass(self._timing.answer_s)
        while self._core.acknowledging and (command := self._next_command()) is not None:
            self._core.apply(command)

    def _let_listeners_finish(self) -> None:
        """A master with several threads has seen all of the past, on every bus, before it hears an answer."""
        self._await_listeners(allowed=0)
        self._stop.wait(_DIGESTION)

    def _next_command(self) -> Command | None:
        """The next command; None when the master keeps silent or leaves, or we must stop."""
        if self._held:
            return self._held.popleft()
        patience = self._timing.patience_enabled_s if self._core.powered else self._timing.patience_s
        for _ in range(round(patience / _WAIT)):
            if self._stop.is_set() or not self._core.listened_to:
                break
            if (command := self._core.receive(_WAIT)) is not None:
                return command
        return None

    # -- time passes

    def _pass(self, duration: float) -> None:
        """Let at least ``duration`` [s] pass, as long as an axis moves and ``rest_s`` after it, or a brake closes."""
        core, end = self._core, self._core.tick + round(duration / TICK)
        # no longer than asked for in the short spans, which belong to a halt of the same move
        rest = round(self._timing.rest_s / TICK) if duration > self._timing.answer_s else 0
        answer = round(self._timing.answer_s / TICK)
        patient_until = core.tick + round(self._timing.rolling_s / TICK)
        while core.tick < end and not self._stop.is_set():
            self._serve_urgent()
            self._await_listeners(self._timing.window * (1 if core.moving else 8))
            ticks = min(BLOCK if core.moving else REST_BLOCK, end - core.tick)
            self._await_heartbeat(ticks)
            closing = core.closing_brake
            core.step(ticks)
            if core.driven:
                patient_until = core.tick + round(self._timing.rolling_s / TICK)
            if core.moving and core.tick < patient_until:
                end = max(end, core.tick + rest)
            if closing:
                end = max(end, core.tick + answer)

    def _serve_urgent(self) -> None:
        while (command := self._core.receive(timeout=0.0)) is not None:
            if not (self._core.moving and self._core.is_urgent(command)):
                self._held.append(command)
                continue
            # what was kept for the halt is older than a stop and must not revive the axis after it
            self._held = deque(c for c in self._held if c.can_id != command.can_id)
            self._core.apply(command)

    def _await_listeners(self, allowed: int) -> None:
        """Stand still while a listener is more than ``allowed`` frames behind, unless it is deaf."""
        deadline = time.monotonic() + self._timing.deaf_s
        while self._core.backlog > allowed:
            if self._deaf or self._stop.is_set():
                return
            time.sleep(0.0005)
            self._deaf = time.monotonic() > deadline
        self._deaf = False

    def _await_heartbeat(self, ticks: int) -> None:
        """Stand still before a drive would declare the master lost in ``ticks``, until the wall clock agrees.

        Only the time waited here counts, so that a PC that stalled as a whole does not look like a lost master.
        """
        waited = 0.0
        while (left := self._core.patience_of_drives()) is not None and 0 < left <= ticks:
            limit = max(drive.master.limit for drive in self._core.drives) * TICK
            if waited >= limit or self._stop.is_set():
                return
            self._serve_urgent()
            time.sleep(0.002)
            waited += 0.002


def run_paced(core: MachineCore, stop: threading.Event) -> None:
    """Until ``stop``: machine time is wall time, from the first listener on; commands take effect as they come."""
    while not core.listened_to and not stop.wait(0.01):
        pass
    origin = time.monotonic() - core.time
    while not stop.is_set():
        while (command := core.receive(timeout=0.0)) is not None:
            core.apply(command)
        core.step(BLOCK)
        late = time.monotonic() - origin - core.time
        origin += late if late > _SLIP else 0.0
        stop.wait(max(0.0, -late))
