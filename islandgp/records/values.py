"""The figures of a run and of its generations, and sentences on them: one name for all readers.

The name is the key in the records, the column in data frames and the metric in MLflow, where the
first dot is a slash, as MLflow groups charts by it. `columns.yaml` describes them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from operator import itemgetter
from typing import Any, Final

from islandgp.scoring.constraints import NO_CONSTRAINTS, Constraints, merit, violation
from islandgp.text import in_points, title


def validation_mean(summary: Mapping[str, Any]) -> float | None:
    """Mean fitness of a run's best robot in validation worlds, points; None: not validated."""
    validation = summary["champion"]["validation"]
    return None if validation is None else float(validation["mean"])


RUN: Final[Mapping[str, Callable[[Mapping[str, Any]], Any]]] = {
    "validation_mean": validation_mean,
    "champion_fitness": lambda summary: summary["champion"]["record"]["fitness"],
    "fitness_max": lambda summary: summary["fittest"]["record"]["fitness"],
    "generations": itemgetter("generations"),
    "final_fitness_max": itemgetter("final_fitness_max"),
    "final_fitness_mean": itemgetter("final_fitness_mean"),
    "mean_diversity": itemgetter("mean_diversity"),
    "seconds": itemgetter("seconds"),
}
"""The figures of every run, from its summary."""


def run_values(summary: Mapping[str, Any]) -> dict[str, Any]:
    """The figures of a finished run.

    `validation_mean` is None without validation, `first.<milestone>` without such a robot. With
    constraints, `violation` is that of the counters' means in validation worlds, `feasible` the
    share of these worlds in which all are kept.
    """
    validation = summary["champion"]["validation"] or {}
    kept = {name: validation.get(name) for name in ("violation", "feasible")}
    return {
        **{name: of(summary) for name, of in RUN.items()},
        **_nested(summary, "first"),
        **{f"constraints.{name}": value for name, value in kept.items() if value is not None},
    }


GUIDANCE: Final = ("source", "phase", "pattern", "target", "crisis", "intervention", "injected")
"""Fields of the guidance after a generation; None without one."""


def generation_values(
    record: Mapping[str, Any], cost: Mapping[str, Any], constraints: Constraints = NO_CONSTRAINTS
) -> dict[str, Any]:
    """The figures of a generation, from its lines in generations.jsonl and costs.jsonl.

    `cost` may be empty, as a run that was killed may lack the last line.
    """
    snapshot, guidance = record["snapshot"], record["guidance"] or {}
    everyone = record["individuals"]
    violations = [violation(i["counters"], constraints) for i in everyone]
    least, best = max(
        zip(violations, everyone, strict=True), key=lambda p: merit(p[1]["fitness"], p[0])
    )
    limits = {"feasible": violations.count(0.0) / len(violations), "violation_of_best": least}
    return {
        **{name: value for name, value in snapshot.items() if not isinstance(value, dict)},
        "size_of_best": best["nodes"],
        "stagnant_generations": record["stagnant_generations"],
        **{name: guidance.get(name) for name in GUIDANCE},
        **{name: record["archive"][name] for name in ("coverage", "qd_score")},
        **dict(_costs(cost)),
        **_nested(best, "components"),
        **_nested(snapshot, "tiers", "specialists", "behaviour_counts", "counters"),
        **({f"constraints.{name}": v for name, v in limits.items()} if constraints else {}),
    }


def individual_values(
    individual: Mapping[str, Any], constraints: Constraints = NO_CONSTRAINTS
) -> dict[str, Any]:
    """The figures of an individual, from its record."""
    plain = ("id", "origin", "mutation", "fitness", "specialist", "nodes", "depth", "tree")
    limits = {"constraints.violation": violation(individual["counters"], constraints)}
    return {
        **{name: individual[name] for name in plain},
        "parents": " ".join(individual["parents"]),
        "best_tier": individual["tiers"][0] if individual["tiers"] else "",
        "ending": " ".join(individual["endings"]),
        **_nested(individual, "components", "counters"),
        **(limits if constraints else {}),
    }


def _costs(cost: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """`episodes`, other costs as `cost.NAME`, and those of a language model as `llm.NAME`."""
    for name, value in cost.items():
        if name == "llm":
            yield from _nested(cost, "llm").items()
        elif name != "at":
            yield name if name == "episodes" else f"cost.{name}", value


def _nested(record: Mapping[str, Any], *groups: str) -> dict[str, Any]:
    """The values of nested mappings, by dotted names."""
    return {f"{group}.{name}": v for group in groups for name, v in record[group].items()}


def metric_values(values: Mapping[str, Any]) -> dict[str, float]:
    """The figures that are numbers or truth values, by MLflow's names."""
    return {
        name.replace(".", "/", 1): float(value)
        for name, value in values.items()
        if isinstance(value, int | float) and name != "generation"
    }


def answers(decisions: Iterable[Mapping[str, Any]]) -> dict[str, int]:
    """The numbers of decisions: total, by the fallback, and `in_part` by the fallback.

    `decisions`: the `source` and `asked_at` of each guidance.
    """
    sources = Counter(d["source"] for d in decisions if d["asked_at"] is not None)
    fallback = sum(n for source, n in sources.items() if "fallback" in source)
    in_part = fallback - sources["fallback"]
    return {"total": sources.total(), "fallback": fallback, "in_part": in_part}


def fallback_share(sources: Mapping[str, int]) -> float:
    """The fallback's share of the decisions that `answers` counts; a part counts half."""
    total = sources.get("total", 0)
    return (sources["fallback"] - sources["in_part"] / 2) / total if total else 0.0


def fallback_words(summaries: Iterable[Mapping[str, Any]]) -> str:
    """The fallback's share of several runs' decisions, as text; "" if it made none."""
    counts: Counter[str] = Counter()
    for summary in summaries:
        counts.update(summary["answers"])
    if not counts["fallback"]:
        return ""
    part = f", {counts['in_part']:,} of them in part" if counts["in_part"] else ""
    return f"{counts['fallback']:,} of {counts['total']:,}{part}"


def measured(v: Mapping[str, Any], sign: str = "") -> str:
    """Mean points with their 95 % interval, or the reason why there is none."""
    low, high = v["low"], v["high"]
    if low is None or high is None:
        return f"{in_points(v['mean'], sign)} points (no interval: one world)"
    ends = f"{in_points(low, sign)} to {in_points(high, sign)}"
    return f"{in_points(v['mean'], sign)} points (95 %: {ends})"


def best_robot(champion: Mapping[str, Any]) -> str:
    """The best robot's result in unseen worlds, and its differences to other trees there."""
    v = champion["validation"]
    if v is None:
        return f"{_name(champion)}, not validated in other worlds"
    n = len(v["worlds"])
    return f"{_name(champion)}: {measured(v)} in {n} unseen world{'s' * (n != 1)}"


def sentences(summary: Mapping[str, Any]) -> Iterator[str]:
    """The best robot's result in unseen worlds with all comparisons, its tiers and constraints."""
    champion = summary["champion"]
    others = (champion["validation"] or {}).get("comparisons", ())
    against = (f"{measured(other, '+')} against the {other['name']}" for other in others)
    yield ", ".join((best_robot(champion), *against)) + "."
    yield from reached(champion)
    yield from constrained(summary)


def comparisons(champion: Mapping[str, Any]) -> Iterator[str]:
    """One sentence for each tree with which the best robot is compared in these worlds."""
    for other in (champion["validation"] or {}).get("comparisons", ()):
        yield f"Against the {other['name']} in the same worlds: {measured(other, '+')}"


def reached(champion: Mapping[str, Any]) -> Iterator[str]:
    """A sentence on the tiers of the best robot in unseen worlds, if there are any."""
    shares = (champion["validation"] or {}).get("reached", {})
    if texts := [f"{title(tier)} in {share:.0%}" for tier, share in shares.items() if share]:
        yield f"In these worlds it is {', '.join(texts)}"


def constrained(summary: Mapping[str, Any]) -> Iterator[str]:
    """A sentence on the feasibility of the best robot; none without constraints."""
    v = summary["champion"]["validation"]
    if not (limits := summary.get("constraints")):
        return
    if v is None or v.get("feasible") is None:
        yield f"Constraints ({limits}): not tried in other worlds"
        return
    result = "kept" if not v["violation"] else f"broken (violation {v['violation']:.3g})"
    yield f"Constraints ({limits}): {result} on average, and in {v['feasible']:.0%} of these worlds"


def _name(champion: Mapping[str, Any]) -> str:
    """The best robot, with the numbers of nodes before and after the shortening, if any."""
    before = champion["record"]["nodes"]
    after = [tree["nodes"] for tree in champion["front"] if tree["chosen"]]
    short = f", shortened from {before} to {after[0]} nodes" if after and after[0] < before else ""
    short = short or ", not shortened" * (not after and before > 1)
    return f"Best robot: individual {champion['record']['id']}{short}"


def in_lines(learned: Sequence[str]) -> Iterator[str]:
    """What a search has found out about the actions, under a heading."""
    yield "Learned from the episodes: what held before and after successes, not always by them"
    yield from (f"  {sentence}" for sentence in learned)
