"""The loop on stored runs: verdicts, proposals, decisions, restated histories, alarms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from threading import Event

import pytest

from service.backlash.results import AxisResult, Reason
from service.monitoring.alarm import AlarmEvent
from service.runs.deciding import AxisGoneError
from service.runs.pairs import NothingToExplain, training_runs
from service.runs.proposing import to_propose
from service.runs.refinement import refine
from service.runs.workbench import MOST_WAITING, Workbench
from service.store.errors import AlreadyDecidedError, UnknownRecordError
from service.store.model_records import ExplanationRecord, RevisionRecord
from service.store.records import DECLARED, StepParameters
from tests.service.runs.bench import TRUE_B, WRONG_B, Bench, NoteReader

EFFECT = "sensor_latency"


def night(bench: Bench, workbench: Workbench, note: str | None = None, reason: Reason | None = None) -> int:
    """One run and what is computed of it before the next."""
    run_id = bench.run(note, reason=reason)
    workbench.submit(run_id)
    assert workbench.wait_idle(20)
    return run_id


def nights(bench: Bench, workbench: Workbench, *notes: str | None) -> list[int]:
    return [night(bench, workbench, note) for note in notes]


def verdict(bench: Bench, run_id: int) -> ExplanationRecord:
    return bench.repository.models.explanations(run_id=run_id)[0]


def proposed(bench: Bench) -> list[RevisionRecord]:
    return list(bench.repository.models.revisions("Y", "proposed"))


def test_the_first_run_has_nothing_to_be_compared_with_and_says_so(
    bench: Bench, workbench: Workbench
) -> None:
    first = verdict(bench, night(bench, workbench))
    assert first.state == "cannot_tell"
    assert "no earlier sound run" in (first.detail or "")


def test_a_clean_machine_is_told_clean_and_nothing_is_proposed(bench: Bench, workbench: Workbench) -> None:
    last = nights(bench, workbench, None, None, None)[-1]
    found = verdict(bench, last).of_axis("Y")
    assert found is not None
    assert found["finding"] == "none"
    assert proposed(bench) == []


def test_each_run_is_judged_by_the_one_before_it(bench: Bench, workbench: Workbench) -> None:
    nights(bench, workbench, None, None, None)
    assert bench.analysis.pairs == [("night-1", "night-2"), ("night-2", "night-3")]


def test_a_pair_that_straddles_the_change_is_not_told_and_two_that_agree_are(
    bench: Bench, workbench: Workbench
) -> None:
    nights(bench, workbench, None, None, EFFECT)
    straddling = verdict(bench, 3).of_axis("Y")
    assert straddling is not None
    assert straddling["finding"] == "unknown"
    night(bench, workbench, EFFECT)
    assert proposed(bench) == []
    night(bench, workbench, EFFECT)
    (revision,) = proposed(bench)
    assert (revision.effects, revision.run_id) == ((EFFECT,), 5)
    assert verdict(bench, 5).id == revision.explanation_id


def test_what_waits_or_was_rejected_is_not_proposed_again(bench: Bench, workbench: Workbench) -> None:
    nights(bench, workbench, EFFECT, EFFECT, EFFECT, EFFECT)
    (revision,) = proposed(bench)
    workbench.decide(revision.id, accept=False, by="A. Smith", note="a test weight")
    nights(bench, workbench, EFFECT, EFFECT)
    assert proposed(bench) == []
    assert bench.repository.axis("Y").series == DECLARED
    assert bench.repository.models.revision(revision.id).note == "a test weight"


def test_another_effect_after_an_accepted_one_is_proposed(bench: Bench, workbench: Workbench) -> None:
    nights(bench, workbench, EFFECT, EFFECT, EFFECT)
    workbench.decide(proposed(bench)[0].id, accept=True, by="A. Smith", note=None)
    nights(bench, workbench, "hung_mass_mode", "hung_mass_mode", "hung_mass_mode")
    assert [revision.effects for revision in proposed(bench)] == [("hung_mass_mode",)]


def test_what_is_found_beyond_an_accepted_revision_is_proposed_beside_it(
    bench: Bench, workbench: Workbench
) -> None:
    """The verdicts begin with what is accepted, and with its numbers; both effects are in the revision that follows."""
    nights(bench, workbench, EFFECT, EFFECT, EFFECT)
    workbench.decide(proposed(bench)[0].id, accept=True, by="A. Smith", note=None)
    (night,) = nights(bench, workbench, EFFECT)
    again = verdict(bench, night).of_axis("Y")
    assert again is not None
    assert (again["finding"], again["accepted"]) == ("none", [EFFECT])
    assert bench.analysis.accepted[0] == {}
    assert bench.analysis.accepted[-1]["Y"] == {"latency_s": 0.0017}
    nights(bench, workbench, *[f"{EFFECT}, hung_mass_mode"] * 3)
    (revision,) = proposed(bench)
    assert revision.effects == (EFFECT, "hung_mass_mode")
    assert revision.finding["effects"] == ["hung_mass_mode"]


def test_a_finding_beyond_another_model_than_the_one_in_force_is_not_proposed(
    bench: Bench, workbench: Workbench
) -> None:
    """It was searched while the revision waited for its decision, and says nothing of what is in there."""
    nights(bench, workbench, EFFECT, EFFECT, EFFECT)
    (first,) = proposed(bench)
    workbench.decide(first.id, accept=True, by="A. Smith", note=None)
    in_force = bench.repository.models.in_force("Y")
    runs = nights(bench, workbench, *[f"{EFFECT}, hung_mass_mode"] * 3)
    *others, last = (verdict(bench, number) for number in runs)
    found = last.of_axis("Y")
    assert found is not None
    declared = replace(last, found={"axes": [{**found, "accepted": [], "absent": []}]})
    assert to_propose(last, others, "Y", (), in_force) is not None
    assert to_propose(declared, others, "Y", (), in_force) is None
    of_both = replace(last, found={"axes": [{**found, "accepted": [EFFECT, "sensor_gain"]}]})
    assert to_propose(of_both, others, "Y", (), in_force) is not None, (
        "what its partner has is in the model, too"
    )


def test_an_accepted_revision_restates_history_beside_the_old_one(bench: Bench, workbench: Workbench) -> None:
    runs = nights(bench, workbench, None, None, EFFECT, EFFECT, EFFECT)
    declared = bench.repository.history("Y").b
    workbench.decide(proposed(bench)[0].id, accept=True, by="A. Smith", note=None)
    assert workbench.wait_idle(20)
    axis = bench.repository.axis("Y")
    assert axis.series == "revision-1"
    restated = bench.repository.history("Y")
    assert list(restated.b) == [TRUE_B] * len(runs)
    assert list(bench.repository.history("Y", series=DECLARED).b) == list(declared)
    assert max(declared) == pytest.approx(WRONG_B, abs=1e-6)
    night(bench, workbench, EFFECT)
    assert len(bench.repository.history("Y").b) == len(bench.repository.history("Y", series=DECLARED).b) == 6


def test_a_run_that_the_revision_does_not_explain_is_refused_in_its_series(
    bench: Bench, workbench: Workbench
) -> None:
    nights(bench, workbench, EFFECT, EFFECT, EFFECT)
    workbench.decide(proposed(bench)[0].id, accept=True, by="A. Smith", note=None)
    other = night(bench, workbench, "hung_mass_mode")
    latest = bench.repository.values("Y", limit=1)[0]
    assert (latest.run_id, latest.outcome.result.verdict) == (other, "refused")
    assert "does not explain" in (latest.outcome.result.detail or "")


def test_a_run_is_not_refused_for_what_the_declared_model_lacks_once_a_revision_has_it(
    bench: Bench, workbench: Workbench
) -> None:
    class Refuses(NoteReader):
        def refined(self, path: Path, sha256: str) -> Sequence[AxisResult]:
            return (AxisResult("Y", "refused", "another_fit", Reason.MISFIT, "the model lacks something"),)

    nights(bench, workbench, EFFECT, EFFECT, EFFECT)
    workbench.decide(proposed(bench)[0].id, accept=True, by="A. Smith", note=None)
    after = night(bench, workbench, EFFECT)
    refine(replace(bench.workshop, analysis=Refuses()), after)
    assert bench.repository.run(after).state == "ok"
    latest = bench.repository.values("Y", limit=1)[0]
    assert (latest.run_id, latest.outcome.result.backlash) == (after, TRUE_B)


def test_no_drift_alarm_for_the_effect_alone_once_it_is_accepted(bench: Bench, workbench: Workbench) -> None:
    nights(bench, workbench, *[None] * 5, EFFECT, EFFECT, EFFECT)
    workbench.decide(proposed(bench)[0].id, accept=True, by="A. Smith", note=None)
    nights(bench, workbench, *[EFFECT] * 10)
    assert bench.repository.alarms(all_ever=True) == ()


def test_an_alarm_tells_of_an_undecided_finding_and_outlives_the_decision(
    bench: Bench, workbench: Workbench
) -> None:
    nights(bench, workbench, *[None] * 3, *[EFFECT] * 6)
    (alarm,) = bench.repository.alarms()
    assert "waits for a decision" in alarm.detail
    workbench.decide(proposed(bench)[0].id, accept=True, by="A. Smith", note=None)
    assert workbench.wait_idle(20)
    (still,) = bench.repository.alarms()
    assert still.state.active
    assert "stays" in bench.repository.alarm_events(alarm.id)[-1].detail
    night(bench, workbench, EFFECT)
    events = bench.repository.alarm_events(alarm.id)
    assert [line.event for line in events] == [AlarmEvent.RAISED, AlarmEvent.REMARKED, AlarmEvent.CLEARED]
    assert "model revision 1" in events[-1].detail
    (over,) = bench.repository.alarms()
    assert not over.state.acknowledged, "a person still has to see it"


def test_the_policy_accepts_what_is_clear(bench: Bench) -> None:
    with Workbench(bench.workshop, is_busy=lambda: False, policy="accept_when_clear") as workbench:
        nights(bench, workbench, EFFECT, EFFECT, EFFECT)
        (revision,) = bench.repository.models.revisions("Y")
        assert (revision.state, revision.decided_by) == ("accepted", "policy accept_when_clear")
        assert len(bench.repository.history("Y").b) == 3


def test_a_refused_recording_of_a_sound_sensor_is_explained_too(bench: Bench, workbench: Workbench) -> None:
    first = night(bench, workbench, EFFECT, Reason.MISFIT)
    second = night(bench, workbench, EFFECT, Reason.MISFIT)
    assert verdict(bench, second).train_run_ids == (first,)
    assert verdict(bench, second).state == "done"


def test_a_run_of_a_dead_sensor_is_passed_over_and_told_as_such(bench: Bench, workbench: Workbench) -> None:
    first = night(bench, workbench)
    dead = night(bench, workbench, "flat", Reason.SENSOR_FLAT)
    assert verdict(bench, dead).state == "cannot_tell"
    assert "unplugged" in (verdict(bench, dead).detail or "")
    assert verdict(bench, night(bench, workbench)).train_run_ids == (first,)


def test_under_pressure_the_oldest_verdicts_are_skipped_with_the_reason(bench: Bench) -> None:
    at_rest = Event()
    with Workbench(bench.workshop, is_busy=lambda: not at_rest.is_set()) as workbench:
        runs = [bench.run() for _ in range(MOST_WAITING + 3)]
        for run_id in runs:
            workbench.submit(run_id)
        at_rest.set()
        assert workbench.wait_idle(20)
    states = [verdict(bench, run_id).state for run_id in runs]
    assert states == ["cannot_tell", "skipped", "skipped", *["done"] * MOST_WAITING]
    assert "newer runs" in (verdict(bench, runs[1]).detail or "")
    assert [validate for _, validate in bench.analysis.pairs] == ["night-6", "night-5", "night-4"]


def test_nothing_is_computed_while_the_machine_is_busy_and_what_is_left_is_skipped(bench: Bench) -> None:
    with Workbench(bench.workshop, is_busy=lambda: True) as workbench:
        runs = [bench.run() for _ in range(2)]
        workbench.submit(runs[1])
        assert not workbench.wait_idle(0.7)
        assert bench.analysis.pairs == []
    assert verdict(bench, runs[1]).state == "skipped"
    assert bench.analysis.stopped


def test_a_restart_goes_on_restating(bench: Bench) -> None:
    with Workbench(bench.workshop, is_busy=lambda: False) as workbench:
        nights(bench, workbench, EFFECT, EFFECT, EFFECT)
    with Workbench(bench.workshop, is_busy=lambda: True) as workbench:
        workbench.decide(proposed(bench)[0].id, accept=True, by="A. Smith", note=None)
    assert len(bench.repository.history("Y").b) == 0
    with Workbench(bench.workshop, is_busy=lambda: False) as workbench:
        assert workbench.wait_idle(20)
    assert list(bench.repository.history("Y").b) == [TRUE_B] * 3


def test_a_person_may_ask_for_any_pair(bench: Bench, workbench: Workbench) -> None:
    runs = [bench.run(EFFECT) for _ in range(3)]
    number = workbench.explain(runs[0], train=[runs[2]])
    assert workbench.wait_idle(20)
    asked = bench.repository.models.explanation(number)
    assert (asked.state, asked.kind, asked.train_run_ids) == ("done", "on_demand", (runs[2],))
    path = bench.captures / (asked.predictions_path or "")
    assert path.is_file()


def broken(bench: Bench, how: str) -> int:
    """A run that cannot be explained."""
    bench.run()
    run_id = bench.run(capture=how != "no-capture")
    path = bench.captures / f"night-{bench.day}.parquet"
    if how == "capture-missing":
        path.unlink()
    if how == "capture-changed":
        path.write_bytes(path.read_bytes() + b"x")
    return run_id


@pytest.mark.parametrize("how", ["no-capture", "capture-missing", "capture-changed"])
def test_a_run_whose_capture_is_not_there_is_refused_by_name(
    bench: Bench, workbench: Workbench, how: str
) -> None:
    run_id = broken(bench, how)
    with pytest.raises(NothingToExplain) as refused:
        workbench.explain(run_id)
    assert refused.value.kind == how
    later = bench.run()
    assert bench.repository.models.explanation(workbench.explain(later)).train_run_ids == (1,)


def test_pairs_that_make_no_sense_are_refused(bench: Bench, workbench: Workbench) -> None:
    run_id = bench.run()
    with pytest.raises(NothingToExplain, match="no earlier sound run"):
        workbench.explain(run_id)
    with pytest.raises(NothingToExplain, match="fitted to itself"):
        workbench.explain(run_id, train=[run_id])
    with pytest.raises(UnknownRecordError):
        workbench.explain(99)


def test_a_capture_that_is_lost_while_it_waits_is_told(bench: Bench) -> None:
    at_rest = Event()
    with Workbench(bench.workshop, is_busy=lambda: not at_rest.is_set()) as workbench:
        runs = [bench.run() for _ in range(2)]
        workbench.submit(runs[1])
        (bench.captures / "night-2.parquet").unlink()
        at_rest.set()
        assert workbench.wait_idle(20)
    assert verdict(bench, runs[1]).state == "cannot_tell"
    assert "cannot be read" in (verdict(bench, runs[1]).detail or "")


def test_a_decision_is_made_once_and_for_an_axis_that_is_there(bench: Bench, workbench: Workbench) -> None:
    nights(bench, workbench, EFFECT, EFFECT, EFFECT)
    (revision,) = proposed(bench)
    bench.repository.declare_axes([])
    with pytest.raises(AxisGoneError, match="no longer in the configuration"):
        workbench.decide(revision.id, accept=True, by="A. Smith", note=None)
    workbench.decide(revision.id, accept=False, by="A. Smith", note=None)
    with pytest.raises(AlreadyDecidedError):
        workbench.decide(revision.id, accept=False, by="B. Jones", note=None)


def test_a_run_of_other_steps_is_judged_by_two_ordinary_ones(bench: Bench, workbench: Workbench) -> None:
    runs = nights(bench, workbench, EFFECT, EFFECT, EFFECT)
    special = replace(bench.repository.run(runs[2]), steps=StepParameters(8e-3, 50.0))
    train = training_runs(bench.repository, bench.captures, special)
    assert [run.id for run in train] == runs[:2]
