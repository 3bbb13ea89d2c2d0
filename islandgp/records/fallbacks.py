"""How many of a run's answers were its fallback's, for whoever reads what the run came to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any


def answers(records: Iterable[Mapping[str, Any]]) -> dict[str, int]:
    """The guidances that were due, and how many of them came from the fallback, and in part."""
    given = [r["guidance"] for r in records if r["guidance"] is not None]
    sources = Counter(g["source"] for g in given if g["asked_at"] is not None)
    fallback = sum(n for source, n in sources.items() if "fallback" in source)
    return {
        "total": sources.total(),
        "fallback": fallback,
        "in_part": fallback - sources["fallback"],
    }


def fallback_share(found: Mapping[str, int]) -> float:
    """The share of the fallback in what `answers` counts; an answer in part counts half."""
    total = found.get("total", 0)
    return (found["fallback"] - found["in_part"] / 2) / total if total else 0.0


def fallback_words(summaries: Iterable[Mapping[str, Any]]) -> str:
    """The same over some runs in words, "" where no answer was the fallback's."""
    found: Counter[str] = Counter()
    for summary in summaries:
        found.update(summary.get("answers", {}))  # a run of an older version lacks them
    if not found["fallback"]:
        return ""
    part = f", {found['in_part']:,} of them in part" if found["in_part"] else ""
    return f"{found['fallback']:,} of {found['total']:,}{part}"
