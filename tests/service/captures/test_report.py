"""The JSON of one axis: exactly the published keys, plain types, nothing that JSON cannot say."""

from __future__ import annotations

import json

from service.backlash.results import AxisResult, Reason, StepResult
from service.captures.report import axis_result_to_json


def test_an_answer_has_exactly_the_published_keys() -> None:
    step = StepResult(0, 1, "ok", backlash=5.7e-5, t1=0.3951, t2=0.4068)
    result = AxisResult("X1", "ok", "paper", None, "a note", 5.71e-5, (5.6e-5, 5.82e-5), (step,))
    text = json.dumps(axis_result_to_json(result), allow_nan=False)
    assert json.loads(text) == {
        "axis": "X1",
        "verdict": "ok",
        "reason": None,
        "backlash_m": 5.71e-5,
        "interval_95_m": [5.6e-5, 5.82e-5],
        "method": "paper",
        "steps": [
            {
                "index": 0,
                "direction": 1,
                "verdict": "ok",
                "reason": None,
                "backlash_m": 5.7e-5,
                "t1_s": 0.3951,
                "t2_s": 0.4068,
                "position_m": None,
            }
        ],
        "detail": "a note",
        "by_direction": [],
        "by_place": [],
        "by_products": [],
    }


def test_a_refused_axis_has_null_values_and_its_reason() -> None:
    step = StepResult(3, -1, "refused", Reason.FRAME_LOSS, "…")
    found = axis_result_to_json(AxisResult("X1", "refused", "paper", Reason.FRAME_LOSS, "…", steps=(step,)))
    assert (found["backlash_m"], found["interval_95_m"], found["reason"]) == (None, None, "frame_loss")
    assert found["steps"][0] == {
        "index": 3,
        "direction": -1,
        "verdict": "refused",
        "reason": "frame_loss",
        "backlash_m": None,
        "t1_s": None,
        "t2_s": None,
        "position_m": None,
    }
