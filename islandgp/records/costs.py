"""`costs.jsonl`: seconds and episodes of each generation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from itertools import islice
from time import time
from typing import Any

from islandgp.atomic_files import write_atomic
from islandgp.errors import RunError
from islandgp.gp.record import Cost
from islandgp.records.checkpoint import dump
from islandgp.records.lines import Lines


def mend_costs(costs: Lines, done: int, spent: int, tell: Callable[[str], None]) -> None:
    """Cuts the costs; lines that cannot be read get no seconds and a share of the episodes.

    Args:
        costs: the file.
        done: generations before the state to go on from.
        spent: their episodes, which the checkpoint knows.
        tell: gets a line for people where costs were lost.
    """
    found: list[dict[str, Any] | None] = []
    for i, line in enumerate(islice(costs.whole(), done)):
        try:
            found.append(costs.value(line, i))
        except RunError:
            found.append(None)
    found += [None] * (done - len(found))
    lost = [i for i, cost in enumerate(found) if cost is None]
    if not lost:
        costs.cut(done)
        return
    left = max(0, spent - sum(cost["episodes"] for cost in found if cost is not None))
    at, llm = int(1000 * time()), dict[str, float]()
    lines = []
    for i, cost in enumerate(found):
        if cost is None:
            share = left // len(lost) + (i == lost[-1]) * (left % len(lost))
            cost = {**asdict(Cost(0.0, 0.0, 0.0, share, 0, llm)), "at": at}
        at, llm = cost["at"], cost["llm"]
        lines.append(dump(cost).encode() + b"\n")
    write_atomic(costs.path, b"".join(lines))
    tell(f"{costs.path}: the seconds of {len(lost)} generations are lost.")
