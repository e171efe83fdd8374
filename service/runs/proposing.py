"""When a finding becomes a proposed model revision, and when a proposed one is accepted without a person.

Rule: a finding is proposed when **two verdicts of the axis agree on the leading effect, the later one of a
pair of runs that lies wholly after the first one's pair began to be judged**: verdict A of run a, verdict B of
run b > a, fitted to runs not older than a, and no verdict of a run in between says otherwise. When an effect
begins at run k, verdict k rests on a fit to k-1, which straddles the change and may say anything; verdict k+1
rests on the runs k and k+1, which both have it; it or verdict k+2 is the first that can confirm. A name that
was guessed on a straddling pair is not repeated by the next one.

Leading effects agree when they are the same, or when one verdict calls the two indistinguishable.

A revision goes beyond the one in force: a finding that was searched beyond another model, because that one was
accepted after the search had begun, is not proposed; the next runs tell what is missing now.

Nothing is proposed that the axis' accepted revision already holds, that waits for a decision, or that a person
has rejected: whoever rejected it knows of it, and its verdicts stay with the runs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from service.store.model_records import ExplanationRecord, RevisionRecord

Finding = Mapping[str, Any]
"""What an explanation says of one axis: an element of ``axes`` in its JSON."""

CLEAN = 1.3
"""Held-out RMS over the noise up to which a revised model explains the recording."""


def to_propose(
    now: ExplanationRecord,
    others: Sequence[ExplanationRecord],
    axis: str,
    revisions: Sequence[RevisionRecord],
    in_force: RevisionRecord | None,
) -> Finding | None:
    """Return the finding about an axis that is to be proposed after an explanation, None where none is.

    Parameters
    ----------
    now : the explanation that was just made
    others : the axis' other explanations
    revisions : all of the axis
    in_force : the accepted one that its values are computed with
    """
    found = now.of_axis(axis)
    if found is None or not is_effect(found):
        return None
    if in_force is not None and not _is_beyond(found, in_force):
        return None
    settled = [r for r in revisions if r.state in ("proposed", "rejected")]
    if any(set(found["effects"]) <= set(r.effects) for r in settled):
        return None
    return _confirmed_finding(now, _verdicts(others, axis, now.run_id), axis)


def _is_beyond(found: Finding, in_force: RevisionRecord) -> bool:
    """Whether a finding adds to the revision in force, and was searched beyond it, or where it does not show any
    more. Of two axes that move together it was searched beyond what either has."""
    begun_with = {*found.get("accepted", ()), *found.get("absent", ())}
    return begun_with >= set(in_force.effects) and not set(found["effects"]) <= begun_with


def is_effect(found: Finding) -> bool:
    """Whether an effect was named."""
    return found["finding"] == "effect" and bool(found["effects"])


def is_clear(found: Finding) -> bool:
    """Whether nothing about a finding is left to a person: one name for it, and it explains the recording."""
    noise, after = found["noise_rms"], found["after"]
    return (
        not found["indistinguishable"]
        and after["backlash_m"] is not None
        and after["validation_rms"] is not None
        and noise is not None
        and after["validation_rms"] <= CLEAN * noise
    )


def agree(first: Finding, second: Finding) -> bool:
    """Whether two findings name the same leading effect, or one that either calls indistinguishable from it."""
    return second["effects"][0] in _alike(first) or first["effects"][0] in _alike(second)


def _alike(found: Finding) -> set[str]:
    leading = found["effects"][0]
    return {leading}.union(*(group for group in found["indistinguishable"] if leading in group))


def _verdicts(
    others: Iterable[ExplanationRecord], axis: str, run_id: int
) -> list[tuple[ExplanationRecord, Finding]]:
    """The axis' verdicts on other runs, oldest run first; the latest one of each run counts."""
    of_run: dict[int, tuple[ExplanationRecord, Finding]] = {}
    for other in sorted(others, key=lambda one: (one.run_id, one.id)):
        found = other.of_axis(axis)
        if found is not None and other.run_id != run_id:
            of_run[other.run_id] = (other, found)
    return [of_run[number] for number in sorted(of_run)]


def _confirmed_finding(
    now: ExplanationRecord, verdicts: Sequence[tuple[ExplanationRecord, Finding]], axis: str
) -> Finding | None:
    """The later finding of the agreeing pair of verdicts: runs are also explained out of their order."""
    found = now.of_axis(axis)
    assert found is not None
    before = [entry for entry in verdicts if entry[0].run_id < now.run_id][-1:]
    after = [entry for entry in verdicts if entry[0].run_id > now.run_id][:1]
    for earlier, later in [(before, [(now, found)]), ([(now, found)], after)]:
        if earlier and later and _confirms(earlier[0], later[0]):
            return later[0][1]
    return None


def _confirms(earlier: tuple[ExplanationRecord, Finding], later: tuple[ExplanationRecord, Finding]) -> bool:
    (first, its_finding), (second, other) = earlier, later
    wholly_after = min(second.train_run_ids) >= first.run_id
    return wholly_after and is_effect(its_finding) and is_effect(other) and agree(its_finding, other)
