"""The model that answers each part of a generation's guidance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from islandgp.supervision.llm.settings import LLMSettings


def drawn_models(
    settings: LLMSettings,
    gains: Mapping[str, tuple[int, int]],
    parts: Sequence[str],
    rng: np.random.Generator,
) -> dict[str, str]:
    """Draws a model for each part that asks for edits.

    Args:
        settings: with the weights of the models, and how they are chosen. With choice=bandit by
            Thompson sampling on the share of each model's successful edits.
        gains: numbers of successful and of other edits by model.
        parts: of the guidance.
        rng: the generator is consumed.

    Returns:
        The model by part; {} if only `model` is configured.
    """
    weights = settings.edit_models
    if not weights:
        return {}
    names, total = [*weights], sum(weights.values())
    chosen = {}
    for part in [part for part in parts if kind_of(part) == "edits"]:
        if settings.choice == "bandit":
            results = [gains.get(name, (0, 0)) for name in names]
            k = int(np.argmax([rng.beta(1 + won, 1 + lost) for won, lost in results]))
        else:
            k = int(rng.choice(len(names), p=[weights[name] / total for name in names]))
        chosen[part] = names[k]
    return chosen


def kind_of(part: str) -> str:
    """The question of a part: `edits 2` is the second answer to `edits`."""
    return part.partition(" ")[0]
