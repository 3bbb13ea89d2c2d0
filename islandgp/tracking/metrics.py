"""The MLflow metrics of a generation and of a run; the part before "/" is a section of charts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from islandgp.domain import total
from islandgp.gp.edit_fates import EditFate, edit_fates
from islandgp.gp.record import GenerationRecord, GuidanceRecord
from islandgp.plain import from_plain
from islandgp.records.files import kept_constraints, values
from islandgp.scoring.constraints import NO_CONSTRAINTS, Constraints, merit, violation
from islandgp.supervision.decisions import Decisions, decisions

COSTS = {"evaluation": "evaluation_s", "supervision": "supervision_s", "operators": "operators_s"}
"""Costs whose metrics have the unit in the name."""


def metrics(
    record: Mapping[str, Any], cost: Mapping[str, Any], constraints: Constraints = NO_CONSTRAINTS
) -> dict[str, float]:
    """One generation's metrics, from its lines in generations.jsonl and costs.jsonl."""
    s, guidance = record["snapshot"], record["guidance"] or {}
    individuals, archive = record["individuals"], record["archive"]
    violations = [violation(i["counters"], constraints) for i in individuals]
    least, best = max(
        zip(violations, individuals, strict=True),
        key=lambda pair: merit(pair[1]["fitness"], pair[0]),
    )
    numbers = {
        "fitness/max": s["best"],
        "fitness/mean": s["mean"],
        "fitness/sd": s["sd"],
        "size/best": best["nodes"],
        "size/mean": s["size"],
        "diversity/behavioral": s["diversity"],
        "diversity/working": s["working"],
        "supervisor/mutation_rate": s["rate"],
        "supervisor/crisis": bool(guidance.get("crisis")),
        "supervisor/intervention": bool(guidance.get("intervention")),
        "supervisor/injected": record["origins"].get("injected", 0),
        "supervisor/stagnant_generations": record["stagnant_generations"],
        **_edits(record),
        **dict(_cost(cost)),
    }
    sections = {
        "components": best["components"],
        "tiers": s["tiers"],
        "specialists": s["specialists"],
        "behaviours": s["behaviour_counts"],
        "counters": s["counters"],
        "archive": {name: archive[name] for name in ("coverage", "qd_score") if name in archive},
    }
    if constraints:
        feasible = violations.count(0.0) / len(violations)
        sections["constraints"] = {"feasible": feasible, "violation_of_best": least}
    for section, by_name in sections.items():
        numbers |= {f"{section}/{name}": number for name, number in by_name.items()}
    return numbers


def _edits(record: Mapping[str, Any]) -> dict[str, float]:
    """Edits advised after this generation, and results of those before it; {} for none."""
    advised = (record["guidance"] or {}).get("edits", ())
    trials = record.get("trials", ())
    if not advised and not trials:
        return {}
    return {
        "edits/advised": len(advised),
        "edits/refused": sum(bool(edit["refused"]) for edit in advised),
        "edits/evaluated": len(trials),
        "edits/better": sum(trial["fitness"] > trial["parent_fitness"] for trial in trials),
    }


def _cost(cost: Mapping[str, Any], section: str = "cost") -> Iterator[tuple[str, float]]:
    for key, value in cost.items():
        if isinstance(value, Mapping):
            yield from _cost(value, key)
        elif isinstance(value, (int, float)) and key != "at":
            yield f"{section}/{COSTS.get(key, key)}", value
    if section == "cost":
        yield (
            "cost/cache_hits",
            cost["episodes"] - cost.get("outside_training", 0) - cost["simulated"],
        )


def final_metrics(records: Iterable[Mapping[str, Any]]) -> Iterator[tuple[str, float]]:
    """The metrics of a whole run: emergence of tiers, and the decisions of Fig. 8."""
    first: dict[str, int] = {}
    guidance: list[GuidanceRecord] = []
    diversities: list[float] = []
    edited: list[GenerationRecord] = []
    for record in records:
        if edited or (record["guidance"] or {}).get("edits"):
            edited.append(from_plain(GenerationRecord, record))
        s = record["snapshot"]
        diversities.append(s["diversity"])
        for tier, n in s["tiers"].items():
            if n:
                first.setdefault(tier, s["generation"])
        if record["guidance"] is not None:
            guidance.append(GuidanceRecord(**record["guidance"]))
    yield "run/mean_diversity", total(diversities) / len(diversities)
    yield from ((f"run/first_{tier}", generation) for tier, generation in first.items())
    yield from _fates(edit_fates(edited))
    yield from _decisions(decisions([guidance]))


def summary_metrics(summary: Mapping[str, Any]) -> dict[str, float]:
    """The metrics of a finished run from its summary; without those that it does not have."""
    figures = values(summary)
    known = {name: figures[name] for name in ("validation_mean", "fitness_max")}
    known |= kept_constraints(summary)
    return {f"run/{name}": value for name, value in known.items() if value is not None}


def _fates(fates: Sequence[EditFate]) -> Iterator[tuple[str, float]]:
    """Shares of the run's evaluated edits, in [0, 1]."""
    evaluated = [fate for fate in fates if fate.trial is not None]
    if n := len(evaluated):
        yield "run/edits_better", sum((fate.gain or 0) > 0 for fate in evaluated) / n
        yield "run/edits_with_children", sum(fate.children > 0 for fate in evaluated) / n
        yield "run/edits_lived", sum(fate.lived for fate in evaluated) / n


def _decisions(decisions: Decisions) -> Iterator[tuple[str, float]]:
    """The run's decisions as in Fig. 8.

    phases/<name>, patterns/<name>   share of the decisions with this phase or pattern, in [0, 1]
    decisions/<source>               share of the decisions of a source, e.g. "llm_and_fallback"
    decisions/interventions          decisions that considered an intervention necessary
    decisions/crises                 generations with the emergency rate, Eq. (7)
    decisions/fallbacks              decisions that are wholly or partly the fallback's
    """
    sections = {
        "phases": decisions.phases,
        "patterns": decisions.patterns,
        "decisions": decisions.sources,
    }
    for section, counts in sections.items():
        for name, n in counts.items():
            yield f"{section}/{name.replace(' ', '_')}", n / decisions.total
    yield "decisions/interventions", decisions.interventions
    yield "decisions/crises", decisions.crises.total()
    yield "decisions/fallbacks", sum(n for s, n in decisions.sources.items() if "fallback" in s)
