"""The result of a run: its summary, and a short report for the console."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

from islandgp.domain import total
from islandgp.evolution.validation import Best, Validation
from islandgp.gp.record import Champion
from islandgp.plain import nan_to_none
from islandgp.records.folder import RunFolder
from islandgp.records.sentences import best_robot, comparisons, constrained, in_lines, reached
from islandgp.records.values import answers, fallback_share, fallback_words
from islandgp.running.totals import RunTotals
from islandgp.scoring.constraints import NO_CONSTRAINTS, Constraints, in_words
from islandgp.text import in_points, title

MOSTLY_FALLBACK: Final = (
    "expected guidance by the language model, found that the fallback gave more of it than"
    " supervisor.policy.most_fallback allows. The reasons are in the notes of the records. Fix them"
    " and run again with resume=never, or raise most_fallback."
)


def summary(
    totals: RunTotals,
    fittest: Champion,
    best: Best,
    milestones: Sequence[str],
    most_fallback: float | None = None,
    *,
    constraints: Constraints = NO_CONSTRAINTS,
    nothing_works: str = "",
    learned: Sequence[str] = (),
) -> dict[str, Any]:
    """The content of summary.json.

    Args:
        totals: of the run.
        fittest: the individual with the highest fitness in training.
        best: the best robot.
        milestones: tiers whose first robots are reported.
        most_fallback: largest accepted share of the fallback's answers; None: any.
        constraints: of the run.
        nothing_works: a sentence on what no individual has ever achieved; "" if all is well.
        learned: sentences on what the search has found out; () if it learns nothing.
    """
    sources, snapshots = answers(totals.decisions), totals.snapshots
    limits = {} if not constraints else {"constraints": in_words(constraints)}
    first = {
        tier: next((s["generation"] for s in snapshots if s["tiers"][tier]), None)
        for tier in milestones
    }
    return {
        "champion": {
            "generation": best.generation,
            "record": dict(best.record),
            "tree": best.tree,
            "text": best.text,
            "validation": None if best.validation is None else _plain(best.validation),
            "front": nan_to_none([asdict(tree) for tree in best.front]),
            "changes": list(best.changes),
            "usage": nan_to_none([asdict(usage) for usage in best.usage]),
            "chosen_in": list(best.chosen_in),
        },
        **limits,
        **({"nothing_works": nothing_works} if nothing_works else {}),
        **({"learned": list(learned)} if learned else {}),
        "fittest": asdict(fittest),
        "first": first,
        "final_fitness_max": snapshots[-1]["fitness_max"],
        "final_fitness_mean": snapshots[-1]["fitness_mean"],
        "mean_diversity": total(s["diversity"] for s in snapshots) / len(snapshots),
        "generations": len(snapshots),
        "answers": sources,
        "mostly_fallback": most_fallback is not None and fallback_share(sources) > most_fallback,
        "seconds": round(totals.curves.seconds, 3),
    }


def _plain(validation: Validation) -> dict[str, Any]:
    """As JSON values, without the fields of constraints if there are none."""
    plain = nan_to_none(asdict(validation))
    without = () if validation.feasible is not None else ("violation", "feasible")
    return {name: value for name, value in plain.items() if name not in without}


def report(target: RunFolder, costs: Sequence[Mapping[str, Any]]) -> str:
    """A finished run in a few lines of text; `costs` are those of its generations."""
    s, agent = target.summary(), target.agent
    best = s["champion"]["record"]
    parts = sorted(best["components"].items(), key=lambda part: -abs(part[1]))
    came_from = ", ".join(f"{name} {in_points(points, '+')}" for name, points in parts if points)
    first = "; ".join(
        f"first {title(tier)} {agent}: {'never' if g is None else f'generation {g}'}"
        for tier, g in s["first"].items()
    )
    return "\n".join(
        (
            *filter(None, (s.get("nothing_works"),)),
            best_robot(s["champion"]),
            *reached(s["champion"]),
            *comparisons(s["champion"]),
            *constrained(s),
            f"Its fitness in training: {in_points(best['fitness'])} ({came_from})",
            f"Highest fitness in training: {in_points(s['fittest']['record']['fitness'])} in"
            f" generation {s['fittest']['generation']}",
            first[:1].upper() + first[1:],
            *_known_episodes(costs),
            *_supervision(costs[-1]["llm"] if costs else {}, s["answers"]),
            f"Results: {target.path}",
            "",
            s["champion"]["text"].rstrip(),
            *(["", *in_lines(s["learned"])] if s.get("learned") else []),
            "",
        )
    )


def is_mostly_fallback(summary: Mapping[str, Any]) -> bool:
    """True if the fallback's share of a finished run exceeds `most_fallback`."""
    return bool(summary["mostly_fallback"])


def _known_episodes(costs: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """A line on the episodes that were not simulated because their outcomes were known."""
    asked_episodes = sum(cost["episodes"] - cost.get("outside_training", 0) for cost in costs)
    if cached := asked_episodes - sum(cost["simulated"] for cost in costs):
        yield f"Episodes in training: {asked_episodes:,}, {cached:,} of them from the cache"


def _supervision(spent: Mapping[str, float], sources: Mapping[str, int]) -> Iterator[str]:
    """Lines on the sources of the guidance and what a language model has `spent`."""
    if share := fallback_words([{"answers": sources}]):
        yield f"Answers of the fallback: {share}"
    if spent.get("requests"):
        tokens = f"{spent['input_tokens']:,.0f} tokens in, {spent['output_tokens']:,.0f} out"
        yield (
            f"Language model: {1 - fallback_share(sources):.0%} of the answers,"
            f" {spent['requests']:,.0f} requests, {tokens}, {_dollars(spent)}"
        )


def _dollars(spent: Mapping[str, float]) -> str:
    if "cost_usd" not in spent:
        return "at an unknown price"
    usd, most = spent["cost_usd"], spent["cost_usd_at_most"]
    more = f" (at most ${most:,.4f}: some answers were lost)" if spent["uncounted_requests"] else ""
    return f"${usd:,.4f}{more}"
