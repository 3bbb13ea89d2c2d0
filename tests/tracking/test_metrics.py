"""Which numbers become metrics, by hand."""

from __future__ import annotations

from typing import Any

from islandgp.gp.record import record_values
from islandgp.records.values import generation_values, metric_values
from tests.tracking.folders import steps

COST = {
    "evaluation": 1.5,
    "supervision": 0.25,
    "operators": 0.125,
    "episodes": 8,
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


def test_costs_of_a_supervisor_have_a_section() -> None:
    """What a supervisor adds to the costs under its name becomes `llm/...`."""
    values = metrics(
        record_values(steps()[0].record), {**COST, "llm": {"calls": 2, "cost_usd": 0.5}}
    )
    assert (values["llm/calls"], values["llm/cost_usd"]) == (2, 0.5)
