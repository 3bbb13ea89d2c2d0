"""Table 5 as JSON: the state of a population in prompts (sections 2.4.1 and 2.4.5).

The fields are those of `PopulationState` and of its `GenerationStats`, as in a run's records.
Numbers are rounded, which keeps prompts short and their hashes independent of rounding errors.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import asdict
from typing import Any, Final

from islandgp.scoring.state import PopulationState
from islandgp.text import rounded

OF_RATES: Final = (
    *("crisis", "diversity_warning", "stagnant_epochs"),
    *("mutation_rate", "crossover_rate", "rate"),
)
"""Fields of a search that mutates by a rate; `rate` is one of the history."""
OF_STAGES: Final = ("epoch", "stage")  # fields of a curriculum of several stages
OF_HISTORY: Final = ("generation", "fitness_max", "fitness_mean", "diversity", "working", "rate")
"""Fields of a generation of the history, besides the tiers that are milestones."""
LEFT_OUT: Final = ("now", "history", "rate", "overlapping", "best_rose", "best_rise", "targets")
"""Fields of the present that no prompt has."""


def state_json(state: PopulationState, without: Collection[str] = ()) -> dict[str, Any]:
    """The state as plain JSON values, without some fields; `prompts/parts.jinja` describes them."""
    values = asdict(state.now) | asdict(state)
    kept = {n: v for n, v in values.items() if n not in (*LEFT_OUT, *without) and v != {}}
    lines = [
        {n: getattr(s, n) for n in OF_HISTORY if n not in without}
        | {milestone: s.tiers[milestone] for milestone in state.milestones_reached}
        for s in state.history
    ]
    return {name: _short(value) for name, value in {**kept, "history": lines}.items()}


def state_text(state: PopulationState, without: Collection[str] = ()) -> str:
    """The JSON text of a prompt: one line per field and per generation of the history."""
    values = state_json(state, without)
    rows = ",\n  ".join(map(json.dumps, values.pop("history")))
    lines = [f'"{name}": {json.dumps(value)}' for name, value in values.items()]
    return "{" + ",\n ".join([*lines, f'"history": [\n  {rows}\n ]']) + "}"


def _short(value: Any) -> Any:
    """A value with its numbers rounded."""
    if isinstance(value, Mapping):
        return {name: _short(below) for name, below in value.items()}
    if isinstance(value, list | tuple):
        return [_short(below) for below in value]
    return rounded(value) if isinstance(value, float) else value
