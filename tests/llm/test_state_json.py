"""Table 5 as JSON: one whole state as a literal, and every field of it documented."""

from __future__ import annotations

import json

from hypothesis import given

from islandgp.scoring.state import Crisis
from islandgp.supervision.state_json import OF_RATES, OF_STAGES, state_json, state_text
from tests.llm.samples import state
from tests.strategies import population_states

CRISIS = Crisis(diversity_below=0.15, stagnant_epochs_above=3, emergency_rate=0.5)

WHOLE = {
    "generation": 7,
    "generations": 41,
    "epoch": 2,
    "stage": 1,
    "fitness": {
        "best": 4000,
        "mean": 500,
        "sd": 400,
        "best_change": 1000,
        "best_change_share": 0.333,
        "mean_change": 125,
        "best_trend": 1000,
        "mean_trend": 125,
    },
    "history": [
        {
            "generation": 6,
            "best": 3001,
            "mean": 375,
            "diversity": 0.56,
            "working": 0.6,
            "complete": 0,
            "excellent": 0,
            "mutation_rate": 0.4,
        },
        {
            "generation": 7,
            "best": 4000,
            "mean": 500,
            "diversity": 0.57,
            "working": 0.6,
            "complete": 2,
            "excellent": 0,
            "mutation_rate": 0.4,
        },
    ],
    "specialists": {
        "patrol_only": 12,
        "pickup": 9,
        "humanoid": 5,
        "balanced": 4,
    },
    "doing": {"pickup": 14, "humanoid": 8, "charging": 0, "clearing": 2},
    "behaviours": {
        "dominant": "patrol_only",
        "lacking": ["charging", "clearing", "humanoid", "pickup"],
    },
    "diversity": {"now": 0.57, "change": 0.01, "trend": 0.01},
    "working_ratio": 0.6,
    "tiers": {"excellent": 0, "complete": 2, "full_service": 3, "balanced_elite": 4},
    "milestones": {"complete_seen": True, "excellent_seen": False},
    "activity": {
        "pickups": 1.25,
        "interactions": 0.5,
        "deliveries": 0.1,
        "charges": 0.2,
        "gathered": 2.72,
        "delivered": 1.1,
        "collisions": 0.7,
        "distance": 812,
        "inactive": 96.6,
        "laps": 0.4,
        "battery": 31,
    },
    "stagnation": {"generations": 0, "epochs": 0.0},
    "crisis": {
        "low_diversity": False,
        "diversity_below": 0.15,
        "stagnant_epochs_above": 3.0,
        "now": False,
    },
    "parameters": {
        "mutation_rate": 0.4,
        "crossover_rate": 0.8,
        "population": 30,
        "mean_tree_nodes": 17.2,
    },
    "next_multipliers": {
        "garbage": 2.0,
        "battery": 1.0,
        "humanoid": 1.5,
        "delivery": 1.0,
        "leftover": 0.8,
    },
}


def test_a_whole_state() -> None:
    """Everything that a supervisor is shown, in the order and the rounding it is shown in."""
    document = state_json(state(complete=2), CRISIS)
    assert document == WHOLE
    assert list(document) == list(WHOLE)


def test_fields_can_be_left_out() -> None:
    """Those of rates and stages, in each line of the history too."""
    document = state_json(state(complete=2), CRISIS, (*OF_RATES, *OF_STAGES))
    text = json.dumps(document)
    assert "rate" not in text
    assert {"crisis", "epoch", "stage"}.isdisjoint(document)
    assert document["stagnation"] == {"generations": 0}


@given(population_states())
def test_the_text_is_the_json(population_state: object) -> None:
    """The text of the prompt is the same JSON, for any state."""
    values = population_state
    assert json.loads(state_text(values, CRISIS)) == json.loads(  # type: ignore[arg-type]
        json.dumps(state_json(values, CRISIS))  # type: ignore[arg-type]
    )
