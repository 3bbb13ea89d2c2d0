"""Table 5 as JSON: the state of a population in prompts (sections 2.4.1 and 2.4.5).

Numbers are rounded: points of at least 100 to whole ones, smaller ones to three digits, shares to
three places. This keeps prompts short and their hashes independent of rounding errors.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable
from typing import Any, Final

from islandgp.scoring.generation_stats import GenerationStats
from islandgp.scoring.state import Crisis, PopulationState
from islandgp.text import rounded

SMALL: Final = 1e-6  # points: relative changes of smaller values are 0
OF_RATES: Final = (
    *("crisis", "stagnation.epochs", "parameters.mutation_rate", "parameters.crossover_rate"),
    "mutation_rate",
)
"""Fields of a search that mutates by a rate; `mutation_rate` is one of the history."""
OF_STAGES: Final = ("epoch", "stage")
"""Fields of a curriculum of several stages."""


def state_json(
    state: PopulationState, crisis: Crisis, without: Collection[str] = ()
) -> dict[str, Any]:
    """The state as plain JSON values, without some fields; `prompts/parts.jinja` describes them."""
    now = state.now
    values: dict[str, Any] = {
        "generation": now.generation,
        "generations": state.generations,
        "epoch": now.epoch,
        "stage": now.stage + 1,
        "fitness": {
            "best": rounded(now.fitness_max),
            "mean": rounded(now.fitness_mean),
            "sd": rounded(now.fitness_sd),
            "best_change": rounded(state.best_change),
            "best_change_share": _share(state.best_change, now.fitness_max - state.best_change),
            "mean_change": rounded(state.mean_change),
            "best_trend": rounded(state.best_trend),
            "mean_trend": rounded(state.mean_trend),
        },
        "history": [_line(s, state.milestones_reached, without) for s in state.history],
        "specialists": dict(now.specialists),
        "doing": dict(now.behaviour_counts),
        "behaviours": {"dominant": state.dominant, "lacking": list(state.rarest_behaviours)},
        "diversity": {
            "now": _three(now.diversity),
            "change": _three(state.diversity_change),
            "trend": _three(state.diversity_trend),
        },
        "working_ratio": _three(now.working),
        "tiers": dict(now.tiers),
        "milestones": {f"{name}_seen": seen for name, seen in state.milestones_reached.items()},
        "activity": {name: rounded(value) for name, value in now.counters.items()},
        "stagnation": {
            "generations": state.stagnant_generations,
            "epochs": round(state.stagnant_epochs, 1),
        },
        "crisis": {
            "low_diversity": state.diversity_warning,
            "diversity_below": crisis.diversity_below,
            "stagnant_epochs_above": crisis.stagnant_epochs_above,
            "now": bool(state.crisis),
        },
        "parameters": {
            "mutation_rate": _three(state.mutation_rate),
            "crossover_rate": _three(state.crossover_rate),
            "population": state.population,
            "mean_tree_nodes": round(now.size, 1),
        },
        **({"next_multipliers": dict(state.multipliers)} if state.multipliers else {}),
    }
    for field in without:
        group, _, key = field.partition(".")
        if key:
            values[group].pop(key, None)
        else:
            values.pop(group, None)
    return values


def state_text(state: PopulationState, crisis: Crisis, without: Collection[str] = ()) -> str:
    """The JSON text of a prompt: one line per group and per generation of the history."""
    lines = []
    for key, value in state_json(state, crisis, without).items():
        if key == "history":
            rows = ",\n  ".join(json.dumps(row) for row in value)
            lines.append(f'"history": [\n  {rows}\n ]')
        else:
            lines.append(f'"{key}": {json.dumps(value)}')
    return "{" + ",\n ".join(lines) + "}"


def _line(
    s: GenerationStats, milestones: Iterable[str], without: Collection[str]
) -> dict[str, Any]:
    rate = {} if "mutation_rate" in without else {"mutation_rate": _three(s.rate)}
    return {
        "generation": s.generation,
        "best": rounded(s.fitness_max),
        "mean": rounded(s.fitness_mean),
        "diversity": _three(s.diversity),
        "working": _three(s.working),
        **{name: s.tiers[name] for name in milestones},
        **rate,
    }


def _three(value: float) -> float:
    """Rounded to three places; never a negative zero."""
    return round(value, 3) + 0.0


def _share(change: float, before: float) -> float:
    """The relative change, rounded; 0 if the value before was about 0."""
    return _three(change / abs(before)) if abs(before) >= SMALL else 0.0
