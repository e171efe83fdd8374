"""Carries a mechanism through time, exactly between events and with each event located inside its sub-step.

Events are: a flank makes or loses contact, a sliding stops or starts. In a sub-step without one, the state is
multiplied by one matrix. In a sub-step with one, the time of the event is found by halving (each half is
again one multiplication), the mode is changed there, and the rest of the sub-step follows in the new mode.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from service.dynamics.mechanism import FloatArray, Mechanism
from service.dynamics.modes import HALVINGS, Condition, Key, Layout, Mode, build_mode

_TICKS = 2**HALVINGS
_TOLERANCE = -1e-12  # 1e-12 m/s, 1e-12 m, 1e-7 N: below anything physical, above the rounding
_MOST_VAIN = 16  # searches in a sub-step for events that turn out to be none: a condition on its very edge
_MOST_CHANGES = 16  # at one instant: each sliding and each contact can change once, and change back


class ContactChange(NamedTuple):
    """A flank contact made or lost at ``time`` [s]: states are +1 upper flank, −1 lower flank, 0 open."""

    time: float
    contact: str
    before: int
    after: int


class Propagator:
    """The state of one mechanism, at rest at q = 0 when made.

    Attributes
    ----------
    w : (N,), see ``modes``; forces, levels, limits and commands may be written between two sub-steps
    changes : contacts made and lost so far
    """

    def __init__(self, mechanism: Mechanism, dt: float) -> None:
        self.mechanism = mechanism
        self.layout = Layout(mechanism)
        self.dt = dt
        self.sub_steps = 0
        self.changes: list[ContactChange] = []
        self._modes: dict[Key, Mode] = {}
        self.w = np.zeros(self.layout.size)
        self.w[self.layout.F] = mechanism.F0
        self.w[self.layout.up] = self.w[self.layout.down] = [s.level for s in mechanism.slidings]
        self.w[self.layout.UL] = [c.UL for c in mechanism.contacts]
        self.w[self.layout.LL] = [c.LL for c in mechanism.contacts]
        self._key = Key((0,) * len(mechanism.contacts), (0,) * len(mechanism.slidings))
        self.mode = self._mode(self._key)

    def place(self, q: FloatArray, v: FloatArray) -> None:
        """Put the bodies at q [m] with speeds v [m/s], both (n,)."""
        self.w[self.layout.q], self.w[self.layout.v] = q, v
        slidings = tuple(int(np.sign(s.row @ v)) for s in self.mechanism.slidings)
        self._key = Key((0,) * len(self.mechanism.contacts), slidings)
        self.mode = self._mode(self._key)
        self._change_mode(self.time)

    def take_over(self, other: Propagator) -> None:
        """Go on where ``other`` is now, at standstill; bodies that it lacks are put where their springs rest.

        The state of contacts and slidings is found anew.
        """
        m, theirs = self.mechanism, other.mechanism
        new = np.array([name not in theirs.bodies for name in m.bodies])
        q = np.array([0.0 if n else other.w[theirs.index(b)] for b, n in zip(m.bodies, new, strict=True)])
        q[new] = np.linalg.solve(m.K[np.ix_(new, new)], (m.F0 - m.K @ q)[new])
        self.w[self.layout.T] = other.w[other.layout.T]
        self.sub_steps, self.changes = other.sub_steps, other.changes
        self.place(q, np.zeros(len(q)))

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self.sub_steps * self.dt

    @property
    def acceleration(self) -> FloatArray:
        """q̈ (n,) [m/s²] at this instant."""
        q_ddot: FloatArray = self.mode.acceleration.dot(self.w)
        return q_ddot

    def step(self) -> None:
        """Go on by one sub-step dt."""
        trial = self.mode.propagators[0].dot(self.w)
        if self._holds(trial):
            self.w = trial
        else:
            self._step_through_events()
        self.sub_steps += 1

    def _holds(self, w: FloatArray) -> bool:
        return min(self.mode.gauge.dot(w).tolist(), default=0.0) >= _TOLERANCE or not self._broken(w)

    def _broken(self, w: FloatArray) -> list[Condition]:
        """Conditions of the mode that w breaks."""
        mode = self.mode
        gauge = mode.gauge.dot(w).tolist()
        for rows in mode.open_gaps:
            if max(gauge[row] for row in rows) >= _TOLERANCE:
                for row in rows:
                    gauge[row] = 0.0
        return [c for c, value in zip(mode.conditions, gauge, strict=True) if value < _TOLERANCE]

    def _step_through_events(self) -> None:
        done = vain = 0
        while done < _TICKS:
            done += self._walk(_TICKS - done, search=vain < _MOST_VAIN)
            vain += not self._change_mode((self.sub_steps + done / _TICKS) * self.dt)

    def _walk(self, ticks: int, search: bool) -> int:
        """Go on by the largest power of two in ``ticks``, or just past the event before its end.

        Without ``search`` no event is looked for: by rounding, a condition that a machine at rest meets exactly
        can be broken after eight ticks and not after four and four, over and over.
        """
        level = HALVINGS - (ticks.bit_length() - 1)
        size = 1 << (HALVINGS - level)
        trial = self.mode.propagators[level].dot(self.w)
        if not search or self._holds(trial):
            self.w = trial
            return size
        gone = 0
        while level < HALVINGS:
            level += 1
            half = self.mode.propagators[level].dot(self.w)
            if self._holds(half):
                self.w = half
                gone += 1 << (HALVINGS - level)
        self.w = self.mode.propagators[HALVINGS].dot(self.w)
        return gone + 1

    def _change_mode(self, time: float) -> bool:
        """Change contacts and slidings until none of the mode's conditions is broken; whether any was."""
        for changes in range(_MOST_CHANGES):
            broken = self._broken(self.w)
            if not broken:
                return changes > 0
            self._apply(broken[0], time)
        return True

    def _apply(self, broken: Condition, time: float) -> None:
        contacts, slidings = list(self._key.contacts), list(self._key.slidings)
        if broken.kind == "contact":
            name = self.mechanism.contacts[broken.part].name
            self.changes.append(ContactChange(time, name, contacts[broken.part], broken.state))
            contacts[broken.part] = broken.state
        else:
            # A sliding that stops sticks at first; it slides on at once if its level does not hold it.
            slidings[broken.part] = broken.state
        self._key = Key(tuple(contacts), tuple(slidings))
        self.mode = self._mode(self._key)
        if broken.kind == "stop":
            self.w[self.layout.v] = self.mode.stick.dot(self.w[self.layout.v])

    def _mode(self, key: Key) -> Mode:
        mode = self._modes.get(key)
        if mode is None:
            mode = self._modes[key] = build_mode(self.mechanism, self.layout, key, self.dt)
        return mode
