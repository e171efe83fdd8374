"""The motor's holding brake, which the drive closes and opens: CiA 402 has it applied in every state without torque.

Closing takes its time. Where the drive is left the choice (disable operation, shutdown, after a quick stop or a
fault reaction) it keeps the torque until the brake grips. Where the voltage is to go at once (disable voltage)
nothing holds the axis meanwhile: one with weight on it sags. Opening takes no time here.
"""

from __future__ import annotations

from drivers.sim.power_states import State

HELD_FOR = (State.SWITCHED_ON, State.READY_TO_SWITCH_ON)
"""Where a controlword may lead from Operation enabled with the torque kept until the brake grips."""


class HoldingBrake:
    """The brake of one motor; ``closing_ticks`` None: the motor has none."""

    def __init__(self, closing_ticks: int | None) -> None:
        self._closing_ticks = closing_ticks
        self._closed_for = closing_ticks or 0
        self._then: State | None = None

    @property
    def grips(self) -> bool:
        """Whether it holds the motor now."""
        return self._closing_ticks is not None and self._closed_for >= self._closing_ticks

    @property
    def closing(self) -> bool:
        """Whether the drive keeps the torque until it grips."""
        return self._then is not None

    def close(self, then: State) -> bool:
        """Begin to close before the torque goes and ``then`` is entered; False: there is none to wait for."""
        if self._closing_ticks is None:
            return False
        if self._then is None:
            self._closed_for = 0
        self._then = then
        return True

    def open(self) -> None:
        """Let go of the motor, which carries torque from now on."""
        self._then, self._closed_for = None, 0

    def let_fall(self) -> None:
        """The torque goes at once; the brake is on its way."""
        self._then = None

    def pass_time(self, ticks: int, powered: bool) -> State | None:
        """The state to be entered when a brake that was waited for grips now."""
        if not powered or self.closing:
            self._closed_for += ticks
        if self.closing and self.grips:
            then, self._then = self._then, None
            return then
        return None
