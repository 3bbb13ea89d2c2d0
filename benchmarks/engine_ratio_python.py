"""An episode without compiled code over the bare physics; see `engine_ratio`."""

from __future__ import annotations

from collections.abc import Callable
from unittest.mock import patch

from benchmarks.engine_ratio import endless_world, episode_of, pairs
from benchmarks.figure import Effort, Figure, at_most
from benchmarks.turns import medians, ratio
from islandgp.domains.island import episode
from islandgp.domains.island.world import IslandWorld


def measure(effort: Effort) -> list[Figure]:
    """Pairs of an episode of the all-rounder in Python and as many bare steps in its world."""
    rows = pairs(effort, endless_world(effort), _in_python)
    in_python, _ = medians(rows)
    return [
        Figure(
            "engine_ratio_python",
            ratio(rows, 0, 1),
            "",
            "the episode without compiled code / the bare steps; median over pairs",
            at_most(1.8),
        ),
        Figure("episode_python_ms", 1000 * in_python, "ms", "the same without compiled code"),
    ]


def _in_python(world: IslandWorld, seed: int) -> Callable[[], object]:
    """An episode without compiled code."""
    run = episode_of(world, seed)

    def in_python() -> None:
        with patch.object(episode, "compiled_for", return_value=None):
            run()

    return in_python
