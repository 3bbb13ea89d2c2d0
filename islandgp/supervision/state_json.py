"""Table 5 as JSON: what a language model is shown of a population (sections 2.4.1 and 2.4.5).

Numbers are rounded, points to whole ones and shares to three places: a prompt
stays short, and the last digits of a sum never change its hash.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final

from islandgp.domain import Schema
from islandgp.scoring.classes import Classes
from islandgp.scoring.snapshot import Snapshot
from islandgp.scoring.state import Crisis, PopulationState

_PLAIN: Final[dict[str, str]] = {
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
    "history[].mutation_rate": "the mutation rate that made it",
    "behaviours.dominant": "the largest class",
    "behaviours.lacking": "the behaviours, the one that fewest individuals do first",
    "diversity.now": "1 minus the share of the largest class; 0 means that all are alike",
    "diversity.change": "against one generation ago",
    "diversity.trend": "slope over the history, a generation",
    "working_ratio": "share of individuals that do any of what the classes are told apart by",
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
}
"""The fields that every domain has, and what they mean."""


def field_meanings(schema: Schema, classes: Classes) -> dict[str, str]:
    """Every field of `state_json` and what it means, in the order in which they stand there."""
    s, counters = classes.specialists, schema.counters
    meaning = {name: counters[counter].meaning for name, counter in classes.behaviours.items()}
    own = {
        **{f"history[].{name}": f"its {title(name)} Robots" for name in classes.milestones},
        f"specialists.{s.idle}": f"individuals that do none of {', '.join(s.of)}",
        **{f"specialists.{name}": f"individuals that mostly do {name}" for name in s.of},
        f"specialists.{s.mixed}": "individuals of which no behaviour dominates",
        **{f"doing.{name}": f"individuals with any {text}" for name, text in meaning.items()},
        **{f"tiers.{name}": f"{title(name)} Robots now" for name in classes.tiers},
        **{
            f"milestones.{name}_seen": f"whether a {title(name)} Robot has ever existed in this run"
            for name in classes.milestones
        },
        **{
            f"activity.{name}": f"mean over the population: {counter.meaning}"
            + (f", {counter.unit}" if counter.unit else "")
            for name, counter in counters.items()
        },
        **{
            f"next_multipliers.{name}": f"factor on {text}, from the next generation on"
            for name, text in schema.components.items()
        },
    }
    groups = dict.fromkeys(name.partition(".")[0] for name in _ORDER)
    found = {**_PLAIN, **own}
    return {n: found[n] for g in groups for n in found if n.partition(".")[0] == g}


_ORDER: Final = (
    "generation", "generations", "epoch", "stage", "fitness", "history[]", "specialists", "doing",
    "behaviours", "diversity", "working_ratio", "tiers", "milestones", "activity", "stagnation",
    "crisis", "parameters", "next_multipliers",
)  # fmt: skip


def state_json(state: PopulationState, crisis: Crisis) -> dict[str, Any]:
    """The state as plain JSON values; `field_meanings` says what each means."""
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
        "history": [_line(s, state.reached) for s in state.history],
        "specialists": dict(now.specialists),
        "doing": dict(now.doing),
        "behaviours": {"dominant": state.dominant, "lacking": list(state.lacking)},
        "diversity": {
            "now": _three(now.diversity),
            "change": _three(state.diversity_change),
            "trend": _three(state.diversity_trend),
        },
        "working_ratio": _three(now.working),
        "tiers": dict(now.tiers),
        "milestones": {f"{name}_seen": seen for name, seen in state.reached.items()},
        "activity": {name: round(value, 1) + 0.0 for name, value in now.counters.items()},
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
    """The dotted paths of a JSON value's leaves, as `field_meanings` spells them."""
    if isinstance(value, Mapping):
        for key, below in value.items():
            yield from fields(below, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list) and value and isinstance(value[0], Mapping):
        yield from fields(value[0], f"{path}[]")
    else:
        yield path


def title(name: str) -> str:
    """A name for people: `full_service` is Full Service."""
    return name.replace("_", " ").title()


def _line(s: Snapshot, milestones: Iterable[str]) -> dict[str, Any]:
    return {
        "generation": s.generation,
        "best": round(s.best),
        "mean": round(s.mean),
        "diversity": _three(s.diversity),
        "working": _three(s.working),
        **{name: s.tiers[name] for name in milestones},
        "mutation_rate": _three(s.rate),
    }


def _three(value: float) -> float:
    """Rounded to three places; never a negative zero."""
    return round(value, 3) + 0.0


def _share(change: float, before: float) -> float:
    """A change as a share of what was before; 0 where there was nothing."""
    return round(change / abs(before), 3) if abs(before) >= 1 else 0.0
