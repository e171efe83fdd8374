"""A decision about a proposed model revision, and what it says to the axis' alarms.

Reference and tolerance stay as they are configured: they state what gap the machine is meant to have, measured
by hand, and a better model changes only what is believed to have been measured. From the decision on, trend and
alarm go by the new series, whose history is restated first. The decision itself neither raises nor clears an
alarm: it leaves a line in the journal of each that is open, and only values that are measured later, in the new
series, can end it.
"""

from __future__ import annotations

from service.report.words import named
from service.runs.diagnostic_run import Workshop
from service.store.errors import StoreError
from service.store.model_records import RevisionRecord


class AxisGoneError(StoreError):
    """A revision of an axis that the configuration no longer names cannot be accepted: nothing measures it."""


def decide(
    workshop: Workshop, revision_id: int, *, accept: bool, by: str, note: str | None = None
) -> RevisionRecord:
    """Accept or reject a proposed revision.

    Raises
    ------
    UnknownRecordError, AlreadyDecidedError, AxisGoneError
    """
    repository = workshop.repository
    axis = repository.models.revision(revision_id).axis
    if accept and not repository.axis(axis).configured:
        raise AxisGoneError(
            f"axis {axis} is no longer in the configuration, so that no value of it can be computed with "
            f"revision {revision_id}; reject the revision, or put the axis back"
        )
    now = workshop.wall_time()
    decided = repository.models.decide(revision_id, accept=accept, at=now, by=by, note=note)
    repository.remark_alarms(axis, now, _remark(decided), by)
    return decided


def _remark(decided: RevisionRecord) -> str:
    what = f"model revision {decided.id} ({named(decided.effects)})"
    if decided.state == "rejected":
        return f"{what} was rejected: the change is taken for the machine's own"
    return (
        f"{what} was accepted. This alarm was raised by values of the model before and stays; from here on the "
        f"trend goes by series {decided.series}, and only newly measured values of it can end the alarm"
    )
