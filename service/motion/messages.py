"""What the service and the motion process say to each other: a handful of frozen dataclasses.

The service asks with Execute, shows that it lives with Alive, and ends with Abort or Shutdown.
The motion process answers with Progress while it moves, then with Recorded or Failed, and nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass

from service.recording import Recording


@dataclass(frozen=True)
class Steps:
    """Steps other than the configured ones: SL [m], j_lim [m/s³], direction of the first one ±1.

    ``places`` [m] are the middles of the steps along the rack; empty: where the axis stands.
    """

    length: float
    jerk: float
    direction: int = 1
    places: tuple[float, ...] = ()


@dataclass(frozen=True)
class Execute:
    """Run the diagnostic steps on one group: the configured ones, or others."""

    group: str
    steps: Steps | None = None


@dataclass(frozen=True)
class Alive:
    """The client lives; without it for CLIENT_SILENCE seconds a run is stopped."""


@dataclass(frozen=True)
class Abort:
    """Stop the run by quick stop."""


@dataclass(frozen=True)
class Shutdown:
    """End the motion process."""


@dataclass(frozen=True)
class Ready:
    """The buses are open, the process waits for Execute."""


@dataclass(frozen=True)
class Progress:
    """``done`` of ``total`` steps are made; ``text`` is for a person."""

    done: int
    total: int
    text: str


@dataclass(frozen=True)
class Recorded:
    """All steps were made; what was recorded, and what the recorder noticed (lost frames, slow sensor).

    ``bus_log`` is a BLF file of all frames, empty where nothing was heard.
    """

    recording: Recording
    warnings: tuple[str, ...] = ()
    bus_log: bytes = b""


@dataclass(frozen=True)
class Failed:
    """The run ended without a recording. ``kind`` names the error class, ``message`` cause and remedy.

    ``bus_log`` is a BLF file of the frames up to there, empty where nothing was heard.
    """

    kind: str
    message: str
    bus_log: bytes = b""


Request = Execute | Alive | Abort | Shutdown
Reply = Ready | Progress | Recorded | Failed
