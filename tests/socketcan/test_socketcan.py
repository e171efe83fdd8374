"""The drivers on real SocketCAN: boots a guest kernel once and reports what the tests inside it found.

The tests inside are the ``guest_*.py`` beside this file; on the host pytest does not collect them.
"""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from tests.socketcan.uml import missing, run_in_guest

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
INSIDE = sorted(path.stem for path in HERE.glob("guest_*.py"))
PATIENCE = 300.0

UNFIT = "ptrace set fp regs failed"
"""What user-mode-linux 6.1 says where the processor's extended registers are larger than the room that it has for them,
as AMX makes them: its first process dies. Without them (FXSAVE alone) the guest boots, and its programs go astray."""


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[ET.Element], str]:
    """The test cases that ran in the guest, and what the guest printed."""
    if (why := missing()) is not None:
        pytest.skip(why)
    share = tmp_path_factory.mktemp("guest")
    files = [f"tests/socketcan/{name}.py" for name in INSIDE]
    options = ["-q", "-p", "no:cacheprovider", "--basetemp=/run/pytest", "--junitxml=/mnt/found.xml"]
    guest = run_in_guest([sys.executable, "-m", "pytest", *options, *files], ROOT, share, PATIENCE)
    if guest.code is None and UNFIT in guest.output:
        pytest.skip(
            "the guest kernel cannot keep this processor's extended registers (AMX); run on another machine"
        )
    assert guest.code is not None, f"the guest did not finish:\n{guest.output}"
    return list(ET.parse(share / "found.xml").iter("testcase")), guest.output


@pytest.mark.parametrize("name", INSIDE)
def test_on_real_socketcan(found: tuple[list[ET.Element], str], name: str) -> None:
    """Every test of the file ran in the guest and passed; a skipped one counts as not run."""
    cases, output = found
    mine = [case for case in cases if case.get("classname", "").endswith(name)]
    assert mine, f"nothing ran:\n{output}"
    assert not [case.get("name") for case in mine if len(case)], output
