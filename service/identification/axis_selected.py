"""How effects are selected among the trials of an axis' moves: what each must remove, and when the search ends."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from service.dynamics.effects.driven_library import DRIVEN
from service.identification.axis_common import LEFT_BY_ONE
from service.identification.axis_verdict import SMALL
from service.identification.held_out import SEARCHED, Explained
from service.identification.moves_end import ended
from service.identification.moves_finals import may_be_named
from service.identification.moves_search import challenged, without
from service.identification.scene import Scene
from service.identification.selection import LEFT_BY_CLEAN, Limits, Selection, Trial, select

MATERIAL = 0.1
"""Share of the held-out RMS that an effect must remove (chosen)."""
FURTHER = (0.25, 1.6)
"""For a second effect: the share it must remove, and the held-out RMS over the noise that must be left; below it the
residual is that of a friction curve or an impact slightly off, which many effects imitate (chosen)."""
MOST = 2
"""Effects that are named of one axis' moves (chosen): each is searched for as long as the first."""
LIMITS = Limits(MATERIAL, SEARCHED, FURTHER, LEFT_BY_ONE, MOST, SMALL)
BEYOND = replace(LIMITS, material=FURTHER[0], enough=FURTHER[1])
"""Beyond accepted effects the next one is a further one."""
ANOTHER = replace(BEYOND, enough=LEFT_BY_CLEAN, most=1)
"""The same beyond what was found and explains nearly all, but leaves more than next to nothing."""
WITNESSED = replace(LIMITS, material=0.05)
"""Of what there is other evidence for, and little is left, there is less to remove (chosen)."""
SEEN_BESIDE = replace(WITNESSED, enough=0.0, most=1)
"""The same beside what was found."""


def selected(
    scene: Scene,
    before: Trial[Explained],
    proposed: Callable[[Trial[Explained], tuple[str, ...]], Mapping[str, Trial[Explained]]],
    tell: Callable[[str], None],
    limits: Limits,
) -> Selection[Explained]:
    """What is found among the trials that are `proposed` beyond a trial with what was taken already."""
    return select(
        before,
        proposed,
        refine=lambda trial: ended(scene, trial) if may_be_named(before, trial) else trial,
        tell=tell,
        challenge=lambda present, best: challenged(scene, present, best),
        limits=limits,
        size=lambda trial: len(trial.model.fitted.model.parameters),
        contains=lambda name: DRIVEN[name].contains,
        nearly=lambda name: DRIVEN[name].nearly,
        without=lambda trial, name: without(scene, trial, name),
    )
