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
from service.identification.selection import CHANGED, LEFT_BY_CLEAN, Selection, Trial, most_left


def with_impurities(
    scene: Scene, before: Trial[Explained], found: Selection[Explained], tell: Callable[[str], None]
) -> Selection[Explained]:
    """The selection as if a bent contact and, beside it, a mesh error had been found, where they leave next to nothing;
    as it is where they leave more, or the model before more than impurities do, or where the contact was not tried."""
    alone = {trial.model.fitted.model.effects[-1].name: trial for trial in found.tried}
    bent = alone.get(DrivenBentContact.name)
    if bent is None or most_left(before) > CHANGED:
        return found
    tell("nothing explains it alone: a mesh error beside a bent contact")
    beside = propose(scene, (DrivenRipple,), bent, (DrivenBentContact.name,), tell)
    after = beside.get(DrivenRipple.name, before)
    if most_left(after) > LEFT_BY_CLEAN:
        return found
    return replace(found, after=after, effects=(DrivenBentContact.name, DrivenRipple.name), rivals=())
