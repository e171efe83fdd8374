"""Compilation of the few loops that numpy cannot express without Python in the middle (numba).

Of functions that allocate nothing the arrays that they are given need not be counted in and out (`lean`). Those that
are called for every contact event are put into the functions that call them (`within`, `once`): handing over some tens
of arrays costs more than the few sums that they do. A function in the middle of such calls would be compiled again in
every one above it, so it becomes part of its only caller before anything is compiled (`once`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

REORDERED = {"reassoc", "contract", "arcp", "nsz"}
"""What the compiler may do with sums, so that they run in vector registers; infinities and NaN stay what they are."""

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F, **options: Any) -> F:
    """The function compiled at its first call; the machine code is kept beside the source, in NUMBA_CACHE_DIR or in
    the user's cache, and where none of them can be written it is compiled anew in every process."""
    try:
        made: Any = numba.njit(cache=True, error_model="numpy", fastmath=REORDERED, **options)(function)
    except RuntimeError:  # numba found no place to keep the code
        return cast(F, numba.njit(error_model="numpy", fastmath=REORDERED, **options)(function))
    kept = getattr(made, "_cache", None)  # not there where compiling is switched off
    if kept is not None:
        # By itself numba looks at the function's own file, and keeps what calls a function that changed in another.
        kept._cache_file._source_stamp = sources(Path(__file__).parent)
    return cast(F, made)


@cache
def sources(folder: Path) -> str:
    """Digest of all modules that are compiled: code that was made of others is out of date."""
    texts = (path.read_bytes() for path in sorted(folder.glob("driven_*.py")))
    return hashlib.sha256(b"".join(text for text in texts if b"dynamics.compiled import" in text)).hexdigest()


def is_kept(function: Callable[..., object]) -> bool | None:
    """Whether machine code of a compiled function is kept; None where there is no place to keep it."""
    kept = getattr(function, "_cache", None)
    index = getattr(kept, "_cache_file", None)
    return None if index is None else bool(index._load_index())


def lean(function: F) -> F:
    """As `compiled`, for a function that allocates nothing."""
    return compiled(function, _nrt=False)


def within(function: F) -> F:
    """As `lean`, for one that is part of an inner loop."""
    return compiled(function, _nrt=False, forceinline=True)


def once(function: F) -> F:
    """As `within`, for one that is called at one place and calls such functions itself."""
    return compiled(function, _nrt=False, inline="always")
