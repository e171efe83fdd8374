"""The machine code made once, by a process of its own: the compiler keeps a hundred megabytes that it never gives back,
and in the process that compiles, functions call each other in another way than where their code is read: sums would be
rounded otherwise in a first analysis than in all later ones.

``python -m service.dynamics.compiling`` makes it where it is not there yet, after an installation for example.
"""

from __future__ import annotations

import subprocess
import sys

import numpy as np

from service.dynamics.compiled import is_kept
from service.dynamics.driven import simulate
from service.dynamics.driven_kernel import propagate
from service.dynamics.driven_model import Model

LONGEST = 300.0
"""Seconds after which compiling apart is given up; then it is done where it is asked for."""


def compiled_apart() -> None:
    """Have the machine code made by another process, unless it is kept already; where it cannot be kept, or the process
    fails, it is compiled in this one when it is needed."""
    if is_kept(propagate) is False:
        command = [sys.executable, "-m", "service.dynamics.compiling"]
        try:
            subprocess.run(command, check=False, capture_output=True, timeout=LONGEST)
        except (OSError, subprocess.TimeoutExpired):
            return


def compile_all() -> None:
    """Compile the propagation by a machine that stays where it is."""
    model = Model(("X",))
    values = {p.name: np.array([p.typical]) for p in model.parameters}
    simulate(model, values, np.zeros((1, 1, 2, 1, 5)), np.ones(1), np.zeros((1, 1, 1, 2)), 1e-3)


if __name__ == "__main__":
    compile_all()
