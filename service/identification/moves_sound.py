"""What every rack and every flank has a little of, in company: each alone may describe nothing, as the other leaves as
much."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from service.dynamics.effects.driven_ripple import DrivenRipple
from service.dynamics.effects.driven_transmission import DrivenBentContact
from service.identification.held_out import Explained
from service.identification.moves_search import propose
from service.identification.scene import Scene
from service.identification.selection import CHANGED, LEFT_BY_CLEAN, Selection, Trial, distance, most_left


def with_impurities(
    scene: Scene, before: Trial[Explained], found: Selection[Explained], tell: Callable[[str], None]
) -> Selection[Explained]:
    """The selection as if a bent contact and a mesh error had been found, where they leave next to nothing: the one of
    them that comes nearer is begun with, and if that leads nowhere, the other, since what the first leaves of the moves
    that were fitted may be too little to go by. The selection as it is where they leave more, or the model before more
    than impurities do."""
    if most_left(before) > CHANGED:
        return found
    kinds = {kind.name: kind for kind in (DrivenBentContact, DrivenRipple)}
    alone = {trial.model.fitted.model.effects[-1].name: trial for trial in found.tried}
    if len(found.effects) == 1:
        alone[found.effects[0]] = found.after
    for name in sorted(kinds.keys() & alone.keys(), key=lambda name: distance(alone[name])):
        (other,) = kinds.keys() - {name}
        tell(f"{name} may be all there is, with {other} beside it")
        beside = propose(scene, (kinds[other],), alone[name], (name,), tell)
        after = beside.get(other, before)
        if most_left(after) <= LEFT_BY_CLEAN:
            return replace(found, after=after, effects=(name, other), rivals=())
    return found
