"""What the tests in the guest share."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable


def eventually(condition: Callable[[], bool], patience: float = 10.0) -> bool:
    """Wait for a condition on real time."""
    end = time.monotonic() + patience
    while not (found := condition()) and time.monotonic() < end:
        time.sleep(0.005)
    return found


def set_link(channel: str, state: str) -> None:
    """Bring an interface "up" or "down"."""
    subprocess.run(["ip", "link", "set", channel, state], check=True)
