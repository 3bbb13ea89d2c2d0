"""`python -m tests.llm.demo`: a complete run with a language model, without a key.

A run with supervisor=llm against a server with a mock model, with a fault in every
third answer; then the same run again from its transcript, with no server.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

from islandgp.records.folder import RunFolder
from islandgp.running.app import main
from tests.llm.faults import Fault, every
from tests.llm.server import MessagesServer

INTRODUCTION: Final = """\
This shows supervision by a language model without one: the answers below are a mock's.
A server on this machine gives them by rules, and spoils every third one on purpose.
"""
FAULTS: Final = (
    Fault.OVERLOADED,
    Fault.UNKNOWN_ACTION,
    Fault.HTML,
    Fault.OUT_OF_RANGE,
    Fault.CUT,
    Fault.REFUSAL,
    Fault.DRIP,
    Fault.BRACKETS,
    Fault.RETRY_LATER,
    Fault.TOO_LARGE,
    Fault.UNAUTHORISED,
)
QUICK: Final = (
    "supervisor.policy.retry.attempts=2",
    "supervisor.policy.retry.deadline=0.5",
    "supervisor.policy.retry.first_wait=0.05",
)


def demo(overrides: Sequence[str]) -> int:
    """Runs, repeats, compares; returns the exit code."""
    print(INTRODUCTION)
    home = Path(tempfile.mkdtemp(prefix="islandgp-demo-llm-"))
    common = [
        "experiment=smoke",
        "search=paper",  # which asks for rates and trees
        "gp.generations=11",
        "tracking=off",
        "progress=off",
        *overrides,
    ]
    os.environ.pop("ANTHROPIC_API_KEY", None)  # it must not be sent to the mock server
    with MessagesServer(every(3, FAULTS)) as server:
        url = f"supervisor.policy.base_url={server.url}"
        code = main(["supervisor=llm", url, *QUICK, f"runs={home / 'live'}", *common])
        requests = len(server.requests)
    if code:
        return code
    live = _folder(home / "live")
    *_, cost = RunFolder(live).costs()
    _tell(RunFolder(live).records(), cost["llm"], requests)
    print(f"\nEvery question and answer: {live / 'transcript.jsonl'}")
    print("\nThe same run again from that transcript, with the server gone:\n")
    record = f"supervisor.policy.transcript='{live}'"  # quoted: the path has a "=" in it
    code = main(["supervisor=replay", record, f"runs={home / 'second_run'}", *common])
    if code:
        return code
    second_run = _folder(home / "second_run") / "generations.jsonl"
    same = second_run.read_bytes() == (live / "generations.jsonl").read_bytes()
    print(f"The two records are {'identical, byte for byte' if same else 'DIFFERENT'}.")
    return 0 if same else 1


def _folder(runs: Path) -> Path:
    return next(runs.glob("*/*/generations.jsonl")).parent


def _tell(records: Iterable[dict[str, Any]], spent: dict[str, float], requests: int) -> None:
    """The source and the costs of each generation's guidance."""
    print("generation  rate  guidance")
    for record in records:
        if (guidance := record["guidance"]) is not None:
            notes = guidance["notes"]
            print(f"{record['snapshot']['generation']:10}  {guidance['applied_rate']:.2f}", end="")
            print(f"  rate: {_first(notes['rate'])}\n{'':18}tree: {_first(notes['tree'])}")
    print(f"\n{requests} requests reached the server. The ledger, a token being four characters:")
    print("  " + ", ".join(f"{name} {value:g}" for name, value in spent.items() if value))


def _first(note: str) -> str:
    """A note's first line, short."""
    line = note.splitlines()[0]
    return line if len(line) <= 78 else line[:78] + "..."


if __name__ == "__main__":
    sys.exit(demo(sys.argv[1:]))
