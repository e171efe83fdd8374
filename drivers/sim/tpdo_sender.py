"""The TPDOs of a simulated drive: packed at their SYNCs, ready a little later, some of them lost."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from drivers.sim.communication import TICK
from drivers.sim.dictionary import Dictionary
from drivers.sim.drive_config import DriveConfig
from drivers.sim.pdo import Pdo
from drivers.sim.wire import Frame

Signals = Mapping[int, NDArray[np.int64]]
"""Objects that change within a block, by index, at each of its ticks."""


class TpdoSender:
    """Sends what the drive's TPDOs are mapped to."""

    def __init__(self, config: DriveConfig, dictionary: Dictionary, seed: int) -> None:
        self._config = config
        self.pdos = [Pdo(dictionary, 0x1800), Pdo(dictionary, 0x1801)]
        self._jitter, self._chance = (np.random.default_rng([seed, config.node_id, k]) for k in (1, 2))
        self._syncs = 0

    def frames(self, signals: Signals, first: int, syncs: list[int], moves: int) -> list[Frame]:
        """The frames of a block whose ticks begin with ``first``, in its SYNCs; ``moves`` were begun so far."""
        frames: list[Frame] = []
        for pdo in self.pdos:
            if pdo.valid and pdo.mapped and syncs:
                every = pdo.transmission_type
                due = [tick for k, tick in enumerate(syncs, self._syncs + 1) if k % every == 0]
                frames += self._packed(pdo, signals, first, due, moves)
        self._syncs += len(syncs)
        return frames

    def _packed(self, pdo: Pdo, signals: Signals, first: int, due: list[int], moves: int) -> list[Frame]:
        at = np.array(due, dtype=np.intp) - first
        raw, size = pdo.pack(len(due), {index: values[at] for index, values in signals.items()})
        ready = self._ready_times(due)
        lost = self._lost(len(due), moves)
        return [
            (ready[k], pdo.cob_id, raw[k * size : (k + 1) * size]) for k in range(len(due)) if not lost[k]
        ]

    def _ready_times(self, due: list[int]) -> list[float]:
        delays = self._config.send_delay_s + self._config.send_jitter_s * self._jitter.random(len(due))
        return [float(tick * TICK + delay) for tick, delay in zip(due, delays, strict=True)]

    def _lost(self, count: int, moves: int) -> NDArray[np.bool_]:
        faults = self._config.faults
        if faults.silent_from_move is not None and moves > faults.silent_from_move:
            return np.ones(count, dtype=np.bool_)
        return self._chance.random(count) < faults.tpdo_loss
