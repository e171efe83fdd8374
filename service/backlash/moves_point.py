"""A point of the coordinates of a fit of moves, those that all share and those of each: how they are numbered, their
priors and limits, steps of them, and the derivative of residuals with respect to them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from service.backlash.moves import Moves
from service.dynamics.driven_model import Model
from service.recording import FloatArray

FAR, FAR_OF_AMOUNT = 5.0, 50.0
"""How far a shared coordinate may go from its prior's centre: no chain is farther from the usual ones, but how much
there is of an effect has no such limit (chosen: 25 m/s² of friction or weight)."""
OWN_FAR = 20.0
"""How far a coordinate of a move may go from its prior's centre."""

Free = NDArray[np.int64]
"""Indices of the shared coordinates that are free."""


@dataclass(frozen=True)
class Point:
    """shared : (P,); local : per recording (T, L), the coordinates of each move; in_vain : RMS of the fit from which
    other valleys were looked for on the way here, and its shared coordinates (P,), if none was found."""

    shared: FloatArray
    local: tuple[FloatArray, ...]
    in_vain: tuple[float, FloatArray] | None = None


@dataclass(frozen=True)
class Slopes:
    """Derivative of residuals (N,), move after move: a move's own coordinates change its own residuals only.

    Attributes
    ----------
    shared : (N, P) with respect to the free shared coordinates
    own : (N, L) with respect to those of the residual's move
    ends : (T + 1,) where the moves of all recordings begin and end
    """

    shared: FloatArray
    own: FloatArray
    ends: NDArray[np.int64]

    def moves(self) -> Iterator[tuple[slice, slice]]:
        """Rows and columns of every move."""
        P, L = self.shared.shape[1], self.own.shape[1]
        for t, (begin, end) in enumerate(pairwise(self.ends)):
            yield slice(begin, end), slice(P + t * L, P + (t + 1) * L)

    @property
    def size(self) -> int:
        """Coordinates, those of all moves with them."""
        return int(self.shared.shape[1]) + (len(self.ends) - 1) * int(self.own.shape[1])

    def dense(self) -> FloatArray:
        """(N, size)."""
        J = np.zeros((len(self.shared), self.size))
        J[:, : self.shared.shape[1]] = self.shared
        for rows, columns in self.moves():
            J[rows, columns] = self.own[rows]
        return J

    def normal(self, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Products of the derivative with itself (size, size) and with residuals r (size,)."""
        P = self.shared.shape[1]
        H, g = np.zeros((self.size, self.size)), np.zeros(self.size)
        H[:P, :P], g[:P] = self.shared.T @ self.shared, self.shared.T @ r
        for rows, columns in self.moves():
            shared, own = self.shared[rows], self.own[rows]
            H[:P, columns] = shared.T @ own
            H[columns, :P] = H[:P, columns].T
            H[columns, columns] = own.T @ own
            g[columns] = own.T @ r[rows]
        return H, g


def width(model: Model) -> int:
    """Coordinates of each move: position and speed of every load, and the effects' nuisances."""
    return 2 * len(model.axes) + len(model.nuisance)


def resting(moves: Sequence[Moves], model: Model) -> tuple[FloatArray, ...]:
    """All moves beginning at the driving flank, all nuisances at their likeliest."""
    return tuple(np.zeros((len(m.grids), width(model))) for m in moves)


def every(model: Model) -> Free:
    """All shared coordinates are free."""
    return np.arange(len(model.parameters))


def found_again(model: Model) -> Free:
    """Those that are found again in every recording."""
    return np.flatnonzero([p.found_again for p in model.parameters])


def priors(at: Point, free: Free) -> FloatArray:
    """Residuals of the priors."""
    return np.concatenate([at.shared[free], *(local.ravel() for local in at.local)])


def limits(model: Model) -> FloatArray:
    """Least and greatest coordinate of every shared parameter, (P, 2): where its value ends, at most FAR, or as an
    amount FAR_OF_AMOUNT."""
    far = np.array([FAR_OF_AMOUNT if p.dose else FAR for p in model.parameters])[:, None]
    return np.clip(model.scales.ends, -far, far)


def within(model: Model, at: Point) -> Point:
    """The point with every shared coordinate where its parameter has a value of its own."""
    low, high = limits(model).T
    return replace(at, shared=np.clip(at.shared, low, high))


def stopped(model: Model, at: Point, free: Free, g: FloatArray) -> NDArray[np.bool_]:
    """(F,) which free shared coordinates stand at a limit beyond which the gradient g would take them."""
    low, high = limits(model)[free].T
    here = at.shared[free]
    return np.asarray(((here <= low) & (g[: len(free)] > 0.0)) | ((here >= high) & (g[: len(free)] < 0.0)))


def moved(model: Model, at: Point, step: FloatArray, free: Free) -> Point:
    """The point after a step of the free coordinates."""
    shared, local, first = at.shared.copy(), [], len(free)
    shared[free] = np.clip(shared[free] + step[: len(free)], *limits(model)[free].T)
    for own in at.local:
        local.append(np.clip(own + step[first : first + own.size].reshape(own.shape), -OWN_FAR, OWN_FAR))
        first += own.size
    return replace(at, shared=shared, local=tuple(local))
