"""From recorded frames to a drive's speed and torque, placed by the counter that SYNC carries.

A drive samples at the SYNC and answers with TPDO1, so frames come as SYNC 17, TPDO, SYNC 18, TPDO … and a
TPDO is the sample of the SYNC before it. Where a SYNC was lost its TPDO still counts, provided that as many
TPDOs lie between the SYNCs received as there were SYNCs; where that is not so, nobody knows whose sample is
missing, and all of that gap are lost. Lost samples are known and never filled in.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.commissioning import SYNC_ID, SYNC_OVERFLOW, DriveConfig
from drivers.errors import SamplesMissing
from drivers.timebase import FloatArray, IntArray, Timebase, place
from drivers.trace import Frames, Trace


@dataclass(frozen=True)
class DriveRecord:
    """What one drive said during a recording.

    Attributes
    ----------
    speed : [rad/s] at the motor shaft, positive travel positive
    torque : [N·m] at the motor shaft
    statusword : (n,) as float, at the same times
    received : (n,) when the frames of the samples arrived [s], in the order of arrival
    timebase : where the SYNCs lie
    lost : samples between the first and the last SYNC that did not arrive or could not be told apart
    """

    speed: Trace
    torque: Trace
    statusword: Trace
    received: FloatArray
    timebase: Timebase
    lost: int

    def sampled(self, received: float) -> float:
        """When the sample was taken whose frame arrived at ``received`` [s]: what a frame says happened then.

        A frame may be read late, by as much as the PC was busy; where its sample stands on the trace is exact.
        """
        last = int(np.searchsorted(self.received, received, side="right")) - 1
        return float(self.speed.time[max(last, 0)])


def decode(frames: Frames, config: DriveConfig, rated_torque: float) -> DriveRecord:
    """Decode TPDO1 of one drive; `rated_torque` 0x6076 in [N·m].

    Raises SamplesMissing, CounterRestarted or ClockInconsistent when the samples cannot be placed.
    """
    table = frames.table
    is_sync = (table["can_id"] == SYNC_ID) & (table["length"] >= 1)
    is_tpdo = (table["can_id"] == 0x180 + config.node_id) & (table["length"] == 8)
    sync = Frames(table[is_sync])
    counter = sync.payload[:, 0]
    index, timebase = place(counter, sync.time, SYNC_OVERFLOW, config.sync_period, first=1)
    sample, kept = _sample_of(np.flatnonzero(is_tpdo), np.flatnonzero(is_sync), index)
    payload = Frames(table[is_tpdo]).payload[kept]
    if not len(payload):
        raise SamplesMissing(f"{config.name} (node {config.node_id}): no TPDO1 between {len(index)} SYNCs")
    time = timebase.time(sample)
    sign = config.direction
    velocity = payload[:, 0:4].copy().view("<i4")[:, 0]
    torque = payload[:, 4:6].copy().view("<i2")[:, 0]
    status = payload[:, 6:8].copy().view("<u2")[:, 0]
    return DriveRecord(
        speed=Trace(time, velocity * (sign * config.speed_lsb_rad_s)),
        torque=Trace(time, torque * (sign * rated_torque / 1000)),
        statusword=Trace(time, status.astype(np.float64)),
        received=Frames(table[is_tpdo]).time[kept],
        timebase=timebase,
        lost=int(index[-1] - index[0] + 1 - len(sample)),
    )


def _sample_of(tpdo: IntArray, sync: IntArray, index: IntArray) -> tuple[IntArray, IntArray]:
    """SYNC index of each TPDO that can be told, and which TPDOs those are.

    Parameters
    ----------
    tpdo, sync : places of the frames in the order of arrival
    index : unwrapped counter of each SYNC
    """
    slot = np.searchsorted(sync, tpdo) - 1
    inside = np.flatnonzero(slot >= 0)
    slot = slot[inside]
    arrived = np.bincount(slot, minlength=len(sync))
    due = np.append(np.diff(index), 1)
    first = np.searchsorted(slot, slot)
    rank = np.arange(len(slot)) - first
    known = arrived[slot] == due[slot]
    return (index[slot] + rank)[known], inside[known]
