"""Which numbers become metrics, by hand."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

from islandgp.gp.record import GuidanceRecord, record_values
from islandgp.records.values import generation_values, metric_values
from islandgp.tracking.upload import final_metrics
from tests.compare.fake_runs import guidance
from tests.tracking.folders import steps

COST = {
    "evaluation": 1.5,
    "supervision": 0.25,
    "operators": 0.125,
    "episodes": 8,
    "simulated": 6,
    "at": 1_700_000_000_000,
}


def metrics(record: dict[str, Any], cost: dict[str, Any]) -> dict[str, float]:
    """The metrics of a generation."""
    return metric_values(generation_values(record, cost))


def test_metrics_are_the_records_numbers() -> None:
    """The names of data frames in their sections, and values that are in the record."""
    step = steps()[2]
    s = step.record.snapshot
    best = max(step.record.individuals, key=lambda line: line.fitness)
    values = metrics(record_values(step.record), COST)
    assert {name.partition("/")[0] for name in values if "/" in name} == {
        "behaviour_counts",
        "components",
        "cost",
        "counters",
        "specialists",
        "tiers",
    }
    for name in ("fitness_max", "fitness_mean", "diversity", "working", "rate"):
        assert values[name] == getattr(s, name)
    assert values["tiers/complete"] == s.tiers["complete"]
    assert values["specialists/patrol_only"] == s.specialists["patrol_only"]
    assert values["components/garbage"] == best.components["garbage"]
    assert values["behaviour_counts/charging"] == s.behaviour_counts["charging"]
    assert values["counters/distance"] == s.counters["distance"]
    assert values["size_of_best"] == best.nodes
    assert values["cost/evaluation"] == 1.5
    assert values["episodes"] == 8
    assert values["cost/cache_hits"] == 2


def test_costs_of_a_supervisor_have_a_section() -> None:
    """What a supervisor adds to the costs under its name becomes `llm/...`."""
    values = metrics(
        record_values(steps()[0].record), {**COST, "llm": {"calls": 2, "cost_usd": 0.5}}
    )
    assert (values["llm/calls"], values["llm/cost_usd"]) == (2, 0.5)


def record(generation: int, best: float, complete: int, answer: GuidanceRecord | None) -> Any:
    """A generation's line, as far as it matters for the whole run."""
    return {
        "snapshot": {
            "generation": generation,
            "fitness_max": best,
            "tiers": {"complete": complete, "excellent": 0},
        },
        "guidance": None if answer is None else asdict(answer),
    }


def test_metrics_of_a_whole_run() -> None:
    """Shares of decisions."""
    fallback = guidance(source="llm and fallback", phase="exploitation", crisis="diversity")
    records = [
        record(0, -5.0, 0, guidance(source="llm", phase="refinement", pattern="stagnation")),
        record(1, 9.0, 2, fallback),
        record(2, 7.0, 1, replace(fallback, crisis="", intervention=True)),
        record(3, 8.0, 0, guidance(source="none")),
        record(4, 8.0, 0, None),
    ]
    assert dict(final_metrics(records)) == {
        "phases/refinement": 0.25,
        "phases/exploitation": 0.5,
        "patterns/stagnation": 0.25,
        "decisions/llm": 0.25,
        "decisions/llm_and_fallback": 0.5,
        "decisions/none": 0.25,
        "decisions/interventions": 1,
        "decisions/crises": 1,
        "decisions/fallbacks": 2,
    }


def test_a_run_of_one_generation_has_no_decisions() -> None:
    """Nothing is divided by nothing."""
    values = dict(final_metrics([record(0, 1.0, 0, None)]))
    assert {name: n for name, n in values.items() if name.startswith("decisions/")} == {
        "decisions/interventions": 0,
        "decisions/crises": 0,
        "decisions/fallbacks": 0,
    }
