"""CPU time per frame of our ingest beside the naive way, in one run.

    python -m tests.benchmarks.ingest

Both read the same frames of a gantry (SYNC, two drives' TPDO1, two accelerometers) from a virtual bus. All frames
lie in the queue before the clock starts, so that only the reader's CPU time is counted, no sender's.

- naive: python-can's Notifier, a canopen PDO callback that reads three ``.raw``, cantools for the accelerometer
- ours: the receive loop with recorder, handlers and supervision, then everything decoded and placed in time
"""

from __future__ import annotations

import struct
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import can
import canopen

if __name__ == "__main__" and not __package__:
    sys.path.insert(0, str(Path(__file__).parents[2]))

from drivers.accelerometer import Accelerometer, AccelerometerConfig
from drivers.bus import Bus, BusConfig
from drivers.commissioning import DriveConfig
from drivers.drivelink import DriveLink
from drivers.drivetraces import decode
from drivers.objects import load_dictionary
from drivers.signals import load_dbc

CHANNEL = "ingest"
SECONDS = 10
NODES = (5, 6)
SENSORS = (0x300, 0x301)


@dataclass(frozen=True)
class Cost:
    """CPU time of one way [s], and how many samples it delivered."""

    name: str
    cpu: float
    samples: int


def gantry_frames() -> list[can.Message]:
    """What a gantry sends in ``SECONDS``, in order of time."""
    frames = []
    for k in range(SECONDS * 1000):
        frames.append((k * 1e-3, 0x80, bytes([k % 240 + 1])))
        frames += [(k * 1e-3 + 1e-4 * n, 0x180 + n, struct.pack("<ihH", k, k % 100, 0x1637)) for n in NODES]
    for k in range(0, SECONDS * 4000, 3):
        values = struct.pack("<hhhH", k % 99, k % 98, k % 97, k % 65536)
        frames += [((k + 2) / 4000.0, can_id, values) for can_id in SENSORS]
    frames.sort(key=lambda frame: frame[0])
    return [
        can.Message(timestamp=at, arbitration_id=can_id, data=data, is_extended_id=False)
        for at, can_id, data in frames
    ]


def fill(frames: Sequence[can.Message]) -> None:
    """Put all frames onto the wire."""
    with can.Bus(interface="virtual", channel=CHANNEL, preserve_timestamps=True) as sender:
        for frame in frames:
            sender.send(frame)


def spent(work: Callable[[], int]) -> tuple[float, int]:
    """CPU time of the process while `work` runs [s], and what it returns."""
    before = time.process_time()
    result = work()
    return time.process_time() - before, result


def naive(frames: Sequence[can.Message]) -> Cost:
    """Notifier, canopen PDO ``.raw``, cantools."""
    bus = can.Bus(interface="virtual", channel=CHANNEL)
    network = canopen.Network(bus)
    kept: list[tuple[float, ...]] = []
    for node_id in NODES:
        node = canopen.RemoteNode(node_id, load_dictionary(node_id))
        network.add_node(node)
        pdo = node.tpdo[1]
        pdo.cob_id, pdo.enabled = 0x180 + node_id, True
        pdo.clear()
        for index in (0x606C, 0x6077, 0x6041):
            pdo.add_variable(index)
        pdo.subscribe()
        pdo.add_callback(lambda p: kept.append((p.timestamp, p[0].raw, p[1].raw, p[2].raw)))
    message = load_dbc().get_message_by_name("AccelerometerData")
    seen = [0]

    def listen(frame: can.Message) -> None:
        if frame.arbitration_id in SENSORS:
            values = message.decode(frame.data, decode_choices=False)
            kept.append(
                (frame.timestamp, values["Sample0"], values["Sample1"], values["Sample2"], values["Counter"])
            )
        seen[0] += 1

    fill(frames)

    def work() -> int:
        notifier = can.Notifier(bus, [*network.listeners, listen])
        while seen[0] < len(frames):
            time.sleep(0.01)
        notifier.stop()
        return len(kept)

    cpu, samples = spent(work)
    bus.shutdown()
    return Cost("Notifier + canopen .raw + cantools", cpu, samples)


def ours(frames: Sequence[can.Message]) -> Cost:
    """Receive loop, recorder, handlers; decoded and placed afterwards."""
    wire = can.Bus(interface="virtual", channel=CHANNEL)
    bus = Bus(BusConfig("virtual", CHANNEL, machine_time=True), opener=lambda _: wire)
    drives = [DriveConfig(f"X{n}", n) for n in NODES]
    for drive in drives:
        DriveLink(bus, drive, lambda: None)
    sensors = [Accelerometer(bus, AccelerometerConfig(f"X{n}", n, None)) for n in SENSORS]
    fill(frames)

    def work() -> int:
        with bus.recording() as recorder, bus:
            while bus.health.received < len(frames):
                time.sleep(0.01)
            recorded = recorder.frames()
            speeds = [decode(recorded, drive, 5.0).speed for drive in drives]
            accelerations = [sensor.record(recorded).acceleration for sensor in sensors]
        return sum(map(len, speeds)) + sum(map(len, accelerations)) // 3

    cpu, samples = spent(work)
    return Cost("our receive loop, decoded and placed", cpu, samples)


def main() -> None:
    """Print the table."""
    frames = gantry_frames()
    print(f"{len(frames)} frames of a gantry, {SECONDS} s on the bus; CPU time of the reading process")
    print(f"{'':40s} {'µs/frame':>9s} {'of one core':>12s} {'values kept':>12s}")
    costs = [naive(frames), ours(frames)]
    for cost in costs:
        print(
            f"{cost.name:40s} {cost.cpu / len(frames) * 1e6:9.2f} {cost.cpu / SECONDS:12.1%} {cost.samples:12d}"
        )
    print(f"{'ratio':40s} {costs[0].cpu / costs[1].cpu:9.1f}")


if __name__ == "__main__":
    main()
