"""What a run came to: for its folder, and in a few lines for people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from islandgp.evolution.record import Champion
from islandgp.supervision.state_json import title
from islandgp.tracking.fallbacks import answers, fallback_words
from islandgp.tracking.folder import RunFolder


def summary(target: RunFolder, champion: Champion, milestones: Sequence[str]) -> dict[str, Any]:
    """What a run came to, from its records; `seconds` are those spent in its generations."""
    first: dict[str, int | None] = dict.fromkeys(milestones)
    snapshots = [record["snapshot"] for record in target.records()]
    seconds = (c["evaluation"] + c["supervision"] + c["operators"] for c in target.costs())
    for tier in first:
        first[tier] = next((s["generation"] for s in snapshots if s["tiers"][tier]), None)
    return {
        "champion": asdict(champion),
        "first": first,
        "final_best": snapshots[-1]["best"],
        "final_mean": snapshots[-1]["mean"],
        "mean_diversity": sum(s["diversity"] for s in snapshots) / len(snapshots),
        "generations": len(snapshots),
        "answers": answers(target.records()),
        "seconds": round(sum(seconds), 3),
    }


def report(target: RunFolder) -> str:
    """A finished run in a few lines for people."""
    s = target.summary()
    best = s["champion"]["record"]
    parts = sorted(best["components"].items(), key=lambda part: -abs(part[1]))
    came_from = ", ".join(f"{name} {points:+,.0f}" for name, points in parts if points)
    fallback = fallback_words([s])
    first = [
        f"first {title(tier)} Robot: {'never' if g is None else f'generation {g}'}"
        for tier, g in s["first"].items()
    ]
    return "\n".join(
        (
            f"Best fitness {best['fitness']:,.0f} in generation {s['champion']['generation']}:"
            f" {came_from}",
            _sentence("; ".join(first)),
            *([f"Supervision: {fallback} answers were the fallback's"] if fallback else []),
            f"Results: {target.path}",
            "",
            best["tree"].rstrip(),
            "",
        )
    )


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
