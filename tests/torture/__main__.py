"""`python -m tests.torture [PART ...]`: see `make torture`."""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any, Final

from islandgp.evaluation.processes import cores
from tests.torture import determinism, load, page
from tests.torture.faults import FAULTS
from tests.torture.kills import KILLS
from tests.torture.lab import Lab, Missing
from tests.torture.page import FILE, write_page

PARTS: Final[dict[str, dict[str, Callable[[Lab], Any]]]] = {
    "faults": {name: fault.attempt for name, fault in FAULTS.items()},
    "kills": dict(KILLS),
    "determinism": {name: attempt for name, (attempt, _) in determinism.MATRIX.items()},
    "load": dict(load.LOADS),
}
OWN_MOUNTS: Final = "ISLANDGP_TORTURE_OWN_MOUNTS"  # set in the process that may mount disks


@dataclass(frozen=True, slots=True)
class Result:
    """What became of one row of a table."""

    part: str
    name: str
    cases: int  # commands that met it
    slowest: float  # s, the longest that one of them took to end
    seconds: float  # in all
    figure: str  # what the attempt has measured, if it measures
    missing: str  # why it could not be tried, or ""
    failure: str  # the last line of what went wrong, or ""
    date: str  # ISO 8601
    python: str
    cores: int


def main(arguments: Sequence[str] | None = None) -> int:
    """Tries all rows, prints and saves their results.

    Returns 1 where a promise was broken, and 3 where none was, but a row could not be tried.
    """
    parser = argparse.ArgumentParser(prog="python -m tests.torture", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--only", default="", metavar="TEXT", help="rows whose name has this")
    options = parser.parse_args(arguments)
    if unknown := [part for part in options.parts if part not in PARTS]:
        parser.error(f"there is no part {unknown[0]}; there are {', '.join(PARTS)}")
    with_own_mounts()
    for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)  # else commands inherit that it is ignored
    results = []
    for part in options.parts or PARTS:
        for name, attempt in PARTS[part].items():
            if options.only in name:
                results.append(tried(part, name, attempt))
                print(line(results[-1]), flush=True)
                save(results[-1:])
                write_page()
    print(page.counts([asdict(result) for result in results]))
    if any(result.failure for result in results):
        return 1
    return 3 if any(result.missing for result in results) else 0


def with_own_mounts() -> None:
    """Starts this program again in a separate mount name space, if the system allows it."""
    if OWN_MOUNTS in os.environ:
        return
    os.environ[OWN_MOUNTS] = "1"
    command = ["unshare", "--mount", *([] if os.geteuid() == 0 else ["--user", "--map-root-user"])]
    if (
        shutil.which("unshare") is None
        or subprocess.run([*command, "true"], capture_output=True).returncode
    ):
        return  # rows that need a disk are reported as not tried
    os.execvp(command[0], [*command, sys.executable, "-m", "tests.torture", *sys.argv[1:]])


def tried(part: str, name: str, attempt: Callable[[Lab], Any]) -> Result:
    """Tries a row in a temporary folder."""
    began, figure, missing, failure = monotonic(), "", "", ""
    with TemporaryDirectory(prefix="torture-", ignore_cleanup_errors=True) as folder:
        lab = Lab(Path(folder))
        try:
            figure = attempt(lab) or ""
        except Missing as reason:
            missing = str(reason)
        except Exception as error:  # the other rows are tried after any error
            traceback.print_exc()
            failure = f"{type(error).__name__}: {str(error)[:500]}"
    return Result(
        part=part,
        name=name,
        cases=lab.cases,
        slowest=round(lab.slowest, 1),
        seconds=round(monotonic() - began, 1),
        figure=figure,
        missing=missing,
        failure=failure,
        date=datetime.now(UTC).date().isoformat(),
        python=platform.python_version(),
        cores=cores(),
    )


def line(result: Result) -> str:
    """A row for a terminal."""
    ending = result.failure or result.missing or result.figure or "held"
    return f"{result.part:<12} {result.name:<40} {result.cases:>4}  {result.seconds:>6} s  {ending}"


def save(results: Sequence[Result]) -> None:
    """Writes results down beside those of other rows that the file has, in the tables' order."""
    old = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else []
    rows_by_name = {(plain["part"], plain["name"]): plain for plain in old}
    rows_by_name |= {(r.part, r.name): asdict(r) for r in results}
    plain = [rows_by_name[key] for key in rows() if key in rows_by_name]
    FILE.write_text(json.dumps(plain, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def rows() -> Iterator[tuple[str, str]]:
    """Part and name of every row."""
    return ((part, name) for part, attempts in PARTS.items() for name in attempts)


if __name__ == "__main__":
    sys.exit(main())
