"""`python -m benchmarks [NAME ...] [--quick] [--out FILE] [--write-docs]`: see `make bench`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from time import perf_counter
from typing import Final

from benchmarks import results
from benchmarks.figure import Effort, Missing
from benchmarks.pages import write_pages
from benchmarks.table import as_text, conditions

BENCHMARKS: Final = (
    "engine_ratio",
    "peer_ratio",
    "tick_us",
    "run_s",
    "remote_overhead",
    "overhead_share",
    "startup_s",
    "growth",
    "profile_share",
    "worlds_ratio",
)
"""Modules of this package with `measure(effort)`, in the order of the table."""

BUSY: Final = 0.5  # load average above which wall times mean little
WALL: Final = ("peer_ratio", "run_s", "remote_overhead", "overhead_share", "startup_s")
"""Benchmarks of several processes, which measure wall time; the others measure CPU time."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures, prints the table, writes the results down."""
    parser = _parser()
    options = parser.parse_args(arguments)
    unknown = [name for name in options.names if name not in BENCHMARKS]
    if unknown:
        parser.error(f"there is no benchmark {unknown[0]}; there are {', '.join(BENCHMARKS)}")
    if options.write_docs:
        return _write_docs(options.out or results.FILE)
    effort = Effort.TINY if options.tiny else Effort.QUICK if options.quick else Effort.FULL
    load = results.load_average()
    rows = [_measured(name, effort, load) for name in options.names or BENCHMARKS]
    print(as_text(rows))
    print(f"\n{conditions(rows[-1])}; {sum(r.seconds for r in rows):.0f} s in all")
    if load > BUSY:
        print("Other programs were at work: measure again when the machine is quiet.")
    print(f"A busy machine spoils {', '.join(WALL)}: their wall times, and less their ratios.")
    out = options.out or (results.FILE if effort is Effort.FULL else None)
    if out is not None:
        results.save(rows, out)
        print(f"written to {out}; python -m benchmarks --write-docs puts them into the pages")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(BENCHMARKS))
    effort = parser.add_mutually_exclusive_group()
    effort.add_argument(
        "--quick", action="store_true", help="a first look; nothing is written down"
    )
    effort.add_argument("--tiny", action="store_true", help="for tests: the figures mean nothing")
    parser.add_argument("--out", type=Path, help=f"where results go (default: {results.FILE.name})")
    parser.add_argument(
        "--write-docs", action="store_true", help="put the written results into the pages"
    )
    return parser


def _measured(name: str, effort: Effort, load: float) -> results.Result:
    print(f"{name} ...", file=sys.stderr, flush=True)
    began, missing = perf_counter(), ""
    try:
        figures = import_module(f"benchmarks.{name}").measure(effort)
    except Missing as reason:
        figures, missing = [], str(reason)
    return results.result(
        name, figures, effort=effort, seconds=perf_counter() - began, load=load, missing=missing
    )


def _write_docs(file: Path) -> int:
    if not file.exists():
        print(f"Expected results in {file}, found none; run python -m benchmarks first.")
        return 2
    for page in write_pages(results.load(file)):
        print(f"wrote the figures into {page}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
