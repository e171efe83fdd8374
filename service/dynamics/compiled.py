"""Compilation of the few loops that numpy cannot express without Python in the middle (numba)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

REORDERED = {"reassoc", "contract", "arcp", "nsz"}
"""What the compiler may do with sums, so that they run in vector registers; infinities and NaN stay what they are."""

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """The function compiled at its first call; the machine code is kept beside the source, in NUMBA_CACHE_DIR or in
    the user's cache, and where none of them can be written it is compiled anew in every process."""
    try:
        return cast(F, numba.njit(cache=True, error_model="numpy", fastmath=REORDERED)(function))
    except RuntimeError:  # numba found no place to keep the code
        return cast(F, numba.njit(error_model="numpy", fastmath=REORDERED)(function))
