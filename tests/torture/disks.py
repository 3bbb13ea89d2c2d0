"""Faults of disks, folders and limits of the system."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from tests.torture.lab import QUICK, REAL, SLOW, Lab, Missing, assert_refused, start, under_way

POINTS = 20  # sizes of a disk that is too small


@contextmanager
def disk(folder: Path, kib: int) -> Iterator[None]:
    """A file system of some KiB in a folder; raises Missing where none can be mounted.

    `tests.torture` starts itself in a separate mount name space: nobody else sees it.
    """
    command = ["mount", "-t", "tmpfs", "-o", f"size={kib}k", "islandgp-torture", str(folder)]
    if shutil.which("mount") is None or subprocess.run(command, capture_output=True).returncode:
        raise Missing("a file system cannot be mounted here")
    try:
        yield
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def enlarge(folder: Path) -> None:
    """Makes room on such a disk."""
    subprocess.run(["mount", "-o", "remount,size=64m", str(folder)], check=True)


def full_disk(lab: Lab) -> None:
    """Disks from almost nothing to almost enough; then there is room, and the same command."""
    large = lab.folder()
    with disk(large, 65536):
        assert lab.run(large, *QUICK).code == 0
        (page,) = (large / "runs").rglob("run.html")  # a run ends as usual without it
        size = (shutil.disk_usage(large).used - 512 * page.stat().st_blocks) // 1024
    lab.cases -= 1
    for n in range(POINTS):
        home = lab.folder()
        with disk(home, 4 + (size - 8) * n // (POINTS - 1)):
            ending = lab.run(home, *QUICK)
            assert_refused(ending, "No space left on device", "repeat the command")
            enlarge(home)
            lab.assert_finishes(home, QUICK)


def full_disk_tracked(lab: Lab) -> None:
    """The same with MLflow's store on the disk: the run may go on without it."""
    arguments = tuple(word for word in QUICK if word != "tracking=off")
    for kib in (200, 500, 900, 1200):
        home = lab.folder()
        with disk(home, kib):
            ending = lab.run(home, *arguments, "tracking.policy.patience=2")
            assert "Traceback" not in ending.output, ending.output
            assert ending.code in (0, 2), ending.output
            enlarge(home)
            lab.assert_finishes(home, (*arguments, "tracking.policy.patience=2"))


def file_limit(lab: Lab) -> None:
    """`ulimit -f`: no file may grow beyond some KiB."""
    for kib in (1, 2, 8, 16, 32):
        home = lab.folder()
        ending = lab.run(home, *QUICK, prefix=limited(f"ulimit -f {kib}"))
        assert_refused(ending, "File too large")
        lab.assert_finishes(home, QUICK)


def limited(command: str) -> Sequence[str]:
    """The words in front of a command that runs it under a limit of bash's.

    It writes no bytecode: Python keeps a file that a limit has cut short, and trips over it later.
    """
    return ("bash", "-c", f'{command}; PYTHONDONTWRITEBYTECODE=1 exec "$@"', "bash")


def powerless() -> Sequence[str]:
    """The words in front of a command for which permissions hold, although root gives it."""
    if os.geteuid() != 0:
        return ()
    if shutil.which("setpriv") is None:
        raise Missing("root without setpriv may write everywhere")
    return ("setpriv", "--inh-caps=-all", "--bounding-set=-all")


def read_only_folder(lab: Lab) -> None:
    """A folder that may not be written, before the start and in the middle of a run."""
    home = lab.folder()
    home.chmod(0o555)
    ending = lab.run(home, *QUICK, prefix=powerless())
    assert_refused(ending, "Permission denied")
    home.chmod(0o755)
    lab.assert_finishes(home, QUICK)

    home = lab.folder()
    process = start(home, *SLOW, prefix=powerless())
    run = under_way(home, process)
    run.chmod(0o555)
    assert_refused(lab.end(process), "Permission denied")
    run.chmod(0o755)
    lab.assert_finishes(home, SLOW)

    home = lab.folder()
    with disk(home, 4096):
        subprocess.run(["mount", "-o", "remount,ro", str(home)], check=True)
        assert_refused(lab.run(home, *QUICK), "Read-only file system")


def deleted_folder(lab: Lab) -> None:
    """The working folder before the start; the runs' folder in the middle of a run."""
    home = lab.folder()
    deleted = home / "gone"
    deleted.mkdir()
    ending = lab.run(home, *QUICK, prefix=("bash", "-c", 'cd gone; rmdir ../gone; exec "$@"', "x"))
    assert_refused(ending, "deleted")

    for name in ("runs", "runs/default"):
        home = lab.folder()
        process = start(home, *SLOW)
        under_way(home, process)
        (home / name).rename(home / "away")
        shutil.rmtree(home / "away", ignore_errors=True)  # it is being written to
        assert_refused(lab.end(process), "No such file or directory")
        shutil.rmtree(home / "runs", ignore_errors=True)
        lab.assert_finishes(home, SLOW)


def open_files(lab: Lab) -> None:
    """`ulimit -n`: from too few files for the interpreter to enough."""
    for number in (4, 8, 12, 16, 24, 40, 64):
        home = lab.folder()
        arguments = tuple(w for w in QUICK if w not in ("tracking=off",))
        ending = lab.run(home, *arguments, prefix=limited(f"ulimit -n {number}"))
        assert ending.code in (0, 2) or number < 8, (number, ending)
        lab.assert_finishes(home, arguments)


def memory(lab: Lab) -> None:
    """`ulimit -v`: an address space that is too small.

    Not between 300 and 450 MiB: there SciPy's OpenBLAS may never return from being loaded.
    """
    for mib in (200, 600, 800, 1000):
        home = lab.folder()
        ending = lab.run(home, *REAL, prefix=limited(f"ulimit -v {mib * 1024}"))
        if ending.code:
            assert_refused(ending)
        lab.assert_finishes(home, REAL)


def process_limit(lab: Lab) -> None:
    """`ulimit -u`: no process or thread more."""
    if os.geteuid() != 0 or shutil.which("setpriv") is None:
        raise Missing("needs root and setpriv: the limit is one of a whole user")
    power = "+dac_override,+dac_read_search"
    capable = (f"--inh-caps={power}", f"--ambient-caps={power}")
    nobody = ("setpriv", "--reuid", "65534", "--clear-groups", *capable)
    for number in (2, 4, 8, 20):  # with 1, NumPy's OpenBLAS ends the process in its own words
        home = lab.folder()
        ending = lab.run(home, *REAL, prefix=(*nobody, *limited(f"ulimit -u {number}")))
        if ending.code:
            assert ending.code == 2, ending  # a child process may show its own traceback
            assert "islandgp: Expected" in ending.output, ending.output
        lab.assert_finishes(home, REAL)
