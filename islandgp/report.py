"""What a run came to: for its folder, and in a few lines for people."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from islandgp.evolution.record import Champion
from islandgp.evolution.validation import Best
from islandgp.supervision.state_json import title
from islandgp.tracking.fallbacks import answers, fallback_words
from islandgp.tracking.folder import RunFolder


def summary(
    target: RunFolder, fittest: Champion, best: Best, milestones: Sequence[str]
) -> dict[str, Any]:
    """What a run came to, from its records; `seconds` are those spent in its generations."""
    first: dict[str, int | None] = dict.fromkeys(milestones)
    snapshots = [record["snapshot"] for record in target.records()]
    seconds = (c["evaluation"] + c["supervision"] + c["operators"] for c in target.costs())
    for tier in first:
        first[tier] = next((s["generation"] for s in snapshots if s["tiers"][tier]), None)
    return {
        "champion": {
            "generation": best.generation,
            "record": dict(best.record),
            "validation": None if best.validation is None else asdict(best.validation),
        },
        "fittest": asdict(fittest),
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
            *validated(s["champion"]),
            f"Its fitness in training: {best['fitness']:,.0f} ({came_from})",
            f"Highest fitness in training: {s['fittest']['record']['fitness']:,.0f} in generation"
            f" {s['fittest']['generation']}",
            _sentence("; ".join(first)),
            *([f"Supervision: {fallback} answers were the fallback's"] if fallback else []),
            f"Results: {target.path}",
            "",
            best["tree"].rstrip(),
            "",
        )
    )


def validated(champion: Mapping[str, Any]) -> Iterator[str]:
    """What the run's best robot is worth in worlds that trained nobody, in lines for people."""
    best = f"Best robot: individual {champion['record']['id']}"
    v = champion["validation"]
    if v is None:
        yield f"{best}, not validated in other worlds"
        return
    yield (
        f"{best}: {v['mean']:,.0f} points on {len(v['worlds'])} unseen worlds"
        f" (95 %: {v['low']:,.0f} to {v['high']:,.0f})"
    )
    shares = [f"{title(tier)} in {share:.0%}" for tier, share in v["reached"].items() if share]
    if shares:
        yield f"In these worlds it is {', '.join(shares)}"
    if v["yardstick"]:
        yield (
            f"Against the tree {v['yardstick']} in the same worlds: {v['difference']:+,.0f} points"
            f" (95 %: {v['difference_low']:+,.0f} to {v['difference_high']:+,.0f})"
        )


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
