"""What every rack and every flank has a little of, in company: each alone may describe nothing, as the other leaves as
much, and much else imitates either of them, but hardly both, in moves that were not fitted, too."""

from __future__ import annotations

from collections.abc import Callable

from service.dynamics.driven_model import DrivenEffect
from service.dynamics.effects.driven_library import DRIVEN
from service.dynamics.effects.driven_ripple import DrivenRipple
from service.dynamics.effects.driven_transmission import DrivenBentContact
from service.identification.explanation import Candidate
from service.identification.held_out import Explained
from service.identification.moves_finals import described
from service.identification.moves_search import roughly
from service.identification.scene import Scene
from service.identification.selection import (
    CHANGED,
    PART,
    Selection,
    Trial,
    gain_p_value,
    gone_from_all,
    most_left,
)

IMPURITIES: tuple[type[DrivenEffect], ...] = (DrivenBentContact, DrivenRipple)
"""In the order in which they are fitted (chosen: the other way round two of seven machines end elsewhere)."""


def with_impurities(
    scene: Scene, before: Trial[Explained], tell: Callable[[str], None]
) -> Selection[Explained]:
    """The selection as if a bent contact, and a mesh error beside it, had been found, where they describe all moves and
    take a `PART` away of what the model before leaves of them; nothing but what was `tried`, the contact first, where
    they leave more, and nothing at all where that model leaves more than impurities do."""
    if most_left(before) > CHANGED:
        return Selection(before, before, (), (), ())
    tell("what every sound machine has a little of: a bent contact, and a mesh error beside it")
    present, said, tried = before, list[Candidate](), list[Trial[Explained]]()
    for kind in IMPURITIES:
        present = roughly(scene, present, kind, tuple(one.effect for one in said))
        tried.append(present)
        p_value = min(1.0, len(DRIVEN) * gain_p_value(before, present))
        why = "every sound machine has a little of it"
        said.append(Candidate(kind.name, present.held_rms, p_value, False, why))
    if not (described(present) and gone_from_all(before, present, PART)):
        return Selection(before, before, (), (), (), tuple(tried))
    return Selection(before, present, tuple(one.effect for one in said), tuple(said), (), tuple(tried))
