"""The whole loop on the running service: an undeclared effect begins at run 6 of 12, over the virtual CAN bus.

    python -m tests.benchmarks.close_the_loop             the product's own analysis; minutes per verdict
    python -m tests.benchmarks.close_the_loop --quick     an analysis that knows asymmetric friction only: the flow

Prints each run's value by the declared model and by the revised one beside the simulated truth, when the finding
was proposed and accepted over REST, and every alarm.
"""

from __future__ import annotations

import argparse
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from fastapi.testclient import TestClient

from service.app import House, house
from service.demo import TRUTH, demo_settings, open_demo
from service.dynamics.effects.bodies import HungMassMode
from service.dynamics.effects.carriage import AsymmetricFriction
from service.dynamics.effects.effect import Effect
from service.runs.analysis import Analysis

RUNS, FROM_RUN, AXIS = 12, 6, "Y"
EFFECTS: dict[str, Effect] = {
    "asymmetric_friction": AsymmetricFriction(400.0),
    "hung_mass_mode": HungMassMode(40.0, 14.0, 0.02),
}


def check_and_wait(opened: House, api: TestClient, axis: str, verdict: bool = True) -> int:
    """Ask for a check over REST and wait for its value and, with ``verdict``, for all that is computed of it."""
    accepted = api.post("/api/v1/checks", json={"axis": axis})
    assert accepted.status_code == 202, accepted.text
    run_id = int(accepted.json()["run_id"])
    opened.box.wait(run_id, 120)
    opened.refinement.wait_idle()
    if verdict:
        opened.workbench.wait_idle()
    return run_id


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--effect", choices=EFFECTS, default="hung_mass_mode")
    chosen = parser.parse_args()
    began = time.monotonic()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory(prefix="flankwatch-loop-")))
        machine = partial(open_demo, effects={AXIS: (EFFECTS[chosen.effect],)}, from_run=FROM_RUN)
        opened = stack.enter_context(
            house(demo_settings(folder), machine, analysis=_quick() if chosen.quick else Analysis)
        )
        api = stack.enter_context(TestClient(opened.web(), base_url="http://localhost"))
        print(f"{chosen.effect} begins at run {FROM_RUN} of {RUNS}; true backlash {TRUTH[AXIS] * 1e6:.1f} um")
        for number in range(1, RUNS + 1):
            run_id = check_and_wait(opened, api, AXIS, verdict=number >= FROM_RUN - 1)
            _tell_run(api, run_id)
            _accept_what_is_proposed(opened, api)
        _tell_end(api)
    print(f"{time.monotonic() - began:.0f} s in all")


def _quick() -> Any:
    from tests.system.pull import PullAnalysis

    return PullAnalysis


def _tell_run(api: TestClient, run_id: int) -> None:
    run = api.get(f"/api/v1/runs/{run_id}").json()
    said = "no verdict yet"
    if run["model_checks"]:
        check = run["model_checks"][0]
        said = check["in_words"].get(AXIS) or f"{check['state']}: {check['detail']}"
    print(f"run {run_id:2d} {run['state']}: {said}")


def _accept_what_is_proposed(opened: House, api: TestClient) -> None:
    for revision in api.get("/api/v1/revisions?state=proposed").json()["items"]:
        print(
            f"    proposed: revision {revision['id']}: {', '.join(revision['effects'])}; accepted over REST"
        )
        answer = api.post(f"/api/v1/revisions/{revision['id']}/accept", json={"by": "benchmark"})
        assert answer.status_code == 200, answer.text
        opened.workbench.wait_idle()


def _tell_end(api: TestClient) -> None:
    print("run  declared um  error um   revised um  error um")
    for run in reversed(api.get("/api/v1/runs").json()["items"]):
        results = api.get(f"/api/v1/runs/{run['id']}").json()["results"]
        shown = {one["series"].split("-")[0]: one for one in results if one["reported"]}
        print(f"{run['id']:3d}  {_cells(shown.get('declared'))}  {_cells(shown.get('revision'))}")
    alarms = api.get("/api/v1/alarms?all=true").json()["items"]
    print(f"alarms: {len(alarms)}")
    for alarm in alarms:
        print(f"    {alarm['axis']} {alarm['kind']}: {alarm['detail']}")


def _cells(value: dict[str, Any] | None) -> str:
    if value is None:
        return f"{'-':>11}  {'-':>8}"
    if value["backlash_m"] is None:
        return f"{'refused':>11}  {value['reason']:>8}"
    return f"{value['backlash_m'] * 1e6:11.2f}  {(value['backlash_m'] - TRUTH[AXIS]) * 1e6:+8.2f}"


if __name__ == "__main__":
    main()
