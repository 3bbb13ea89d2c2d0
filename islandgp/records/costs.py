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


def mend_costs(costs: Lines, done: int, spent: int, warn: Callable[[str], None]) -> None:
    """Truncates the costs file; replaces damaged lines by 0 s and a share of the episodes.

    Args:
        costs: the file.
        done: number of generations to keep.
        spent: their episodes, as in the checkpoint.
        warn: called with one line if costs were lost.
    """
    rows: list[dict[str, Any] | None] = []
    for i, line in enumerate(islice(costs.whole(), done)):
        try:
            rows.append(costs.value(line, i))
        except RunError:
            rows.append(None)
    rows += [None] * (done - len(rows))
    lost = [i for i, cost in enumerate(rows) if cost is None]
    if not lost:
        costs.cut(done)
        return
    rest = max(0, spent - sum(cost["episodes"] for cost in rows if cost is not None))
    at, llm = int(1000 * time()), dict[str, float]()
    lines = []
    for i, cost in enumerate(rows):
        if cost is None:
            share = rest // len(lost) + (i == lost[-1]) * (rest % len(lost))
            cost = {**asdict(Cost(0.0, 0.0, 0.0, share, 0, llm)), "at": at}
        at, llm = cost["at"], cost["llm"]
        lines.append(dump(cost).encode() + b"\n")
    write_atomic(costs.path, b"".join(lines))
    warn(f"{costs.path}: the seconds of {len(lost)} generations are lost.")
