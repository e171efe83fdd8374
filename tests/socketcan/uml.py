"""A guest kernel with real SocketCAN for tests: Debian's user-mode-linux, up in about two seconds, no image.

The guest's root is the host's `/`, read-only, so that checkout and interpreter keep their paths; one folder is
shared writable. No hardware time stamps, no arbitration, no wire: the kernel's own code is what is real here.
"""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

KERNEL = "linux.uml"
MODULES = Path("/usr/lib/uml/modules")
_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
NEEDED = ("can-dev", "can", "can-raw", "vcan", "slcan")

_INIT = """#!/bin/sh
mount -t proc proc /proc
mount -t sysfs sysfs /sys
mount -t tmpfs tmpfs /run
mkdir /dev/pts && mount -t devpts devpts /dev/pts
mount -t hostfs -o {share} none /mnt
ip link set lo up
{modules}
ip link add vcan0 type vcan
ip link set vcan0 txqueuelen 1000 up
export HOME=/run TMPDIR=/run PYTHONDONTWRITEBYTECODE=1 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
cd {folder} && {command} > /mnt/output 2>&1
echo $? > /mnt/code
echo o > /proc/sysrq-trigger
sleep 10
"""


@dataclass(frozen=True)
class GuestRun:
    """How the command in the guest ended; ``code`` is None when the guest never got so far."""

    code: int | None
    output: str


def missing() -> str | None:
    """What a guest needs and this machine lacks, None when it lacks nothing."""
    absent = [tool for tool in (KERNEL, "ip", "insmod") if shutil.which(tool, path=_PATH) is None]
    if absent:
        return (
            f"no guest kernel with SocketCAN: {', '.join(absent)} not installed "
            "(apt-get install user-mode-linux kmod iproute2)"
        )
    return None


def run_in_guest(command: Sequence[str], folder: Path, share: Path, patience: float) -> GuestRun:
    """Boot a guest with vcan0, run ``command`` in ``folder`` as root, power off.

    Parameters
    ----------
    share : writable in the guest as /mnt; must be empty
    patience : longest life of the guest [s]; then it is killed
    """
    init = share / "init"
    init.write_text(_init(command, folder, share))
    init.chmod(0o755)
    arguments = [
        *(shutil.which(KERNEL, path=_PATH) or KERNEL, "mem=1G", "root=/dev/root", "rootfstype=hostfs"),
        *("rootflags=/", "ro", f"init={init}", "quiet"),
        *("con=null", "con0=null,fd:1", "con1=null", "ssl=null"),
    ]
    console = share / "console"
    with console.open("wb") as out:
        guest = subprocess.Popen(
            arguments, stdin=subprocess.DEVNULL, stdout=out, stderr=out, start_new_session=True
        )
        try:
            guest.wait(patience)
        except subprocess.TimeoutExpired:
            _kill(guest)
    return _outcome(share, console)


def _init(command: Sequence[str], folder: Path, share: Path) -> str:
    return _INIT.format(
        share=shlex.quote(str(share)),
        folder=shlex.quote(str(folder)),
        command=shlex.join(command),
        modules="\n".join(f"insmod {next(MODULES.rglob(f'{name}.ko'))}" for name in NEEDED),
    )


def _kill(guest: subprocess.Popen[bytes]) -> None:
    """End the guest and the processes that it runs its own in; they share its session."""
    os.killpg(guest.pid, signal.SIGKILL)
    guest.wait()


def _outcome(share: Path, console: Path) -> GuestRun:
    output, code = share / "output", share / "code"
    said = console.read_text(errors="replace")
    said += output.read_text(errors="replace") if output.exists() else ""
    return GuestRun(int(code.read_text()) if code.exists() else None, said)
