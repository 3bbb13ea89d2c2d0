"""Table 5 as JSON: one whole state as a literal, and every field of it documented."""

from __future__ import annotations

import json

from hypothesis import given

from islandgp.supervision.state_json import OF_RATES, OF_STAGES, state_json, state_text
from tests.llm.samples import state
from tests.strategies import population_states

WHOLE = {
    "generation": 7,
    "epoch": 2,
    "stage": 0,
    "fitness_max": 4000,
    "fitness_mean": 500,
    "fitness_sd": 400,
    "diversity": 0.57,
    "working": 0.6,
    "specialists": {"patrol_only": 12, "pickup": 9, "humanoid": 5, "balanced": 4},
    "behaviour_counts": {"pickup": 14, "humanoid": 8, "charging": 0, "clearing": 2},
    "tiers": {"excellent": 0, "complete": 2, "full_service": 3, "balanced_elite": 4},
    "counters": {
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
    "size": 17.2,
    "best_change": 1000,
    "mean_change": 125,
    "best_trend": 1000,
    "mean_trend": 125,
    "diversity_change": 0.01,
    "diversity_trend": 0.01,
    "stagnant_generations": 0,
    "stagnant_epochs": 0,
    "crisis": "",
    "diversity_warning": False,
    "milestones_reached": {"complete": True, "excellent": False},
    "dominant": "patrol_only",
    "rarest_behaviours": ["charging", "clearing", "humanoid", "pickup"],
    "mutation_rate": 0.4,
    "crossover_rate": 0.8,
    "population": 30,
    "generations": 41,
    "multipliers": {
        "garbage": 2.0,
        "battery": 1.0,
        "humanoid": 1.5,
        "delivery": 1.0,
        "leftover": 0.8,
    },
    "history": [
        {
            "generation": 6,
            "fitness_max": 3001,
            "fitness_mean": 375,
            "diversity": 0.56,
            "working": 0.6,
            "rate": 0.4,
            "complete": 0,
            "excellent": 0,
        },
        {
            "generation": 7,
            "fitness_max": 4000,
            "fitness_mean": 500,
            "diversity": 0.57,
            "working": 0.6,
            "rate": 0.4,
            "complete": 2,
            "excellent": 0,
        },
    ],
}


def test_a_whole_state() -> None:
    """Everything that a supervisor is shown, in the order and the rounding it is shown in."""
    document = state_json(state(complete=2))
    assert document == WHOLE
    assert list(document) == list(WHOLE)


def test_fields_can_be_left_out() -> None:
    """Those of rates and stages, in each line of the history too."""
    document = state_json(state(complete=2), (*OF_RATES, *OF_STAGES))
    text = json.dumps(document)
    assert "rate" not in text
    assert {"crisis", "epoch", "stage", "stagnant_epochs"}.isdisjoint(document)
    assert document["stagnant_generations"] == 0


@given(population_states())
def test_the_text_is_the_json(population_state: object) -> None:
    """The text of the prompt is the same JSON, for any state."""
    values = population_state
    assert json.loads(state_text(values)) == json.loads(  # type: ignore[arg-type]
        json.dumps(state_json(values))  # type: ignore[arg-type]
    )
