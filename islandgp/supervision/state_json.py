"""Table 5 as JSON: what a language model is shown of a population (sections 2.4.1 and 2.4.5).

Numbers are rounded, points to whole ones and shares to three places: a prompt
stays short, and the last digits of a sum never change its hash.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, Final

from islandgp.scoring.crisis import Crisis
from islandgp.scoring.snapshot import Snapshot
from islandgp.scoring.state import PopulationState

FIELDS: Final[dict[str, str]] = {
    "generation": "the generation just evaluated, from 0",
    "generations": "generations of the whole run",
    "epoch": "the curriculum's epoch, from 1",
    "stage": "the curriculum's stage, from 1: other multipliers, another scale of fitness",
    "fitness.best": "highest fitness now, points",
    "fitness.mean": "mean fitness now, points",
    "fitness.sd": "standard deviation over the population, points",
    "fitness.best_change": "best now minus best one generation ago, points; 0 in a new stage",
    "fitness.best_change_share": "the same as a share of the best one generation ago",
    "fitness.mean_change": "mean now minus mean one generation ago, points; 0 in a new stage",
    "fitness.best_trend": "slope of the best within the stage, points a generation",
    "fitness.mean_trend": "slope of the mean within the stage, points a generation",
    "history[].generation": "a line for each recent generation, the present one last",
    "history[].best": "its highest fitness, under the multipliers of its stage, points",
    "history[].mean": "its mean fitness, points",
    "history[].diversity": "its behavioural diversity",
    "history[].working": "its working ratio",
    "history[].complete": "its Complete Robots",
    "history[].excellent": "its Excellent Robots",
    "history[].mutation_rate": "the mutation rate that made it",
    "specialists.patrol_only": "individuals without any pickup or humanoid interaction",
    "specialists.pickup": "individuals that mostly pick up garbage from the ground",
    "specialists.humanoid": "individuals that mostly take garbage from humanoids",
    "specialists.balanced": "individuals that do both about as often",
    "specialists.charging": "individuals that charged at least once, of any class",
    "specialists.clearing": "individuals that delivered at least once, of any class",
    "doing.pickup": "individuals with at least one pickup",
    "doing.humanoid": "individuals with at least one humanoid interaction",
    "doing.clearing": "individuals with at least one delivery",
    "doing.charging": "individuals with at least one charging attempt",
    "behaviours.dominant": "the largest class",
    "behaviours.lacking": "the four behaviours, the one that fewest individuals do first",
    "diversity.now": "1 minus the share of the largest class; 0 means that all are alike",
    "diversity.change": "against one generation ago",
    "diversity.trend": "slope over the history, a generation",
    "working_ratio": "share of individuals with a pickup or a humanoid interaction",
    "tiers.excellent": "Excellent Robots now",
    "tiers.complete": "Complete Robots now; the Excellent ones are among them",
    "tiers.full_service": "individuals that did each of the four behaviours at least once",
    "tiers.balanced_elite": "individuals that gathered and earned much",
    "milestones.complete_seen": "whether a Complete Robot has ever existed in this run",
    "milestones.excellent_seen": "whether an Excellent Robot has ever existed in this run",
    "activity.distance_m": "mean distance driven in an episode, m",
    "activity.inactive_s": "mean time since the last action other than moving, s",
    "stagnation.generations": "generations since the best of the stage last rose; 0 in a new stage",
    "stagnation.epochs": "the same in epochs",
    "crisis.low_diversity": "whether diversity is below the warning level",
    "crisis.diversity_below": "diversity below which the emergency rate is enforced",
    "crisis.stagnant_epochs_above": "stagnation above which the emergency rate is enforced, epochs",
    "crisis.now": "whether the emergency rate is enforced now, whatever you answer",
    "parameters.mutation_rate": "the mutation rate now in force",
    "parameters.crossover_rate": "the crossover rate",
    "parameters.population": "individuals of a generation",
    "parameters.mean_tree_nodes": "mean size of a tree, nodes",
    "next_multipliers.garbage": "factor on rewards for picking up, from the next generation on",
    "next_multipliers.battery": "factor on rewards for charging",
    "next_multipliers.humanoid": "factor on rewards for humanoid interactions",
    "next_multipliers.delivery": "factor on rewards for deliveries",
    "next_multipliers.leftover": "factor on the penalty for garbage left lying",
}
"""Every field of `state_json` and what it means; prompts and docs are made from it."""


def state_json(state: PopulationState, crisis: Crisis) -> dict[str, Any]:
    """The state as plain JSON values; FIELDS says what each means."""
    now = state.now
    return {
        "generation": now.generation,
        "generations": state.generations,
        "epoch": now.epoch,
        "stage": now.stage + 1,
        "fitness": {
            "best": round(now.best),
            "mean": round(now.mean),
            "sd": round(now.sd),
            "best_change": round(state.best_change),
            "best_change_share": _share(state.best_change, now.best - state.best_change),
            "mean_change": round(state.mean_change),
            "best_trend": round(state.best_trend),
            "mean_trend": round(state.mean_trend),
        },
        "history": [_line(s) for s in state.history],
        "specialists": {
            **now.specialists,
            "charging": now.doing["charging"],
            "clearing": now.doing["clearing"],
        },
        "doing": dict(now.doing),
        "behaviours": {"dominant": state.dominant, "lacking": list(state.lacking)},
        "diversity": {
            "now": _three(now.diversity),
            "change": _three(state.diversity_change),
            "trend": _three(state.diversity_trend),
        },
        "working_ratio": _three(now.working),
        "tiers": dict(now.tiers),
        "milestones": {
            "complete_seen": state.ever_complete,
            "excellent_seen": state.ever_excellent,
        },
        "activity": {"distance_m": round(now.distance), "inactive_s": round(now.inactive)},
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
        "next_multipliers": dict(state.multipliers),
    }


def state_text(state: PopulationState, crisis: Crisis) -> str:
    """The JSON as a prompt shows it: one line for each group, and for each line of the history."""
    lines = []
    for key, value in state_json(state, crisis).items():
        if key == "history":
            rows = ",\n  ".join(json.dumps(row) for row in value)
            lines.append(f'"history": [\n  {rows}\n ]')
        else:
            lines.append(f'"{key}": {json.dumps(value)}')
    return "{" + ",\n ".join(lines) + "}"


def fields(value: Any, path: str = "") -> Iterator[str]:
    """The dotted paths of a JSON value's leaves, as FIELDS spells them."""
    if isinstance(value, Mapping):
        for key, below in value.items():
            yield from fields(below, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list) and value and isinstance(value[0], Mapping):
        yield from fields(value[0], f"{path}[]")
    else:
        yield path


def _line(s: Snapshot) -> dict[str, Any]:
    return {
        "generation": s.generation,
        "best": round(s.best),
        "mean": round(s.mean),
        "diversity": _three(s.diversity),
        "working": _three(s.working),
        "complete": s.tiers["complete"],
        "excellent": s.tiers["excellent"],
        "mutation_rate": _three(s.rate),
    }


def _three(value: float) -> float:
    """Rounded to three places; never a negative zero."""
    return round(value, 3) + 0.0


def _share(change: float, before: float) -> float:
    """A change as a share of what was before; 0 where there was nothing."""
    return round(change / abs(before), 3) if abs(before) >= 1 else 0.0
