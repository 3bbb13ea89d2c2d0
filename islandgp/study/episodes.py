"""Costs of runs in episodes, by generation and in total."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate
from statistics import fmean

from islandgp.evolution.single_behaviours import CHILDREN, POOL, ROUNDS, WORLDS
from islandgp.study.arms import Arm, Run
from islandgp.study.texts import note


def episodes_until(run: Run) -> tuple[int, ...]:
    """Cumulative episodes of a run after each generation, including those from the cache.

    A generation whose costs are lost counts with those of the configuration.
    """
    planned = _planned_episodes(run)
    return tuple(accumulate(cost.episodes or planned for cost in run.costs))


def _planned_episodes(run: Run) -> int:
    """The episodes of a generation by the configuration."""
    return int(run.flat["gp.population"]) * int(run.flat["gp.episodes"])


@dataclass(frozen=True, slots=True)
class EpisodeCost:
    """Mean episodes of an arm's runs, by purpose."""

    generations: float  # requested in the generations
    supervision: float  # of the supervisor, such as trials of candidates
    validation: float  # approximate number, for the choice of the best robot
    library: int  # approximate number, of the search for a library, once for all runs; or 0

    @property
    def total(self) -> float:
        """Episodes of a run, without the search for a library."""
        return self.generations + self.supervision + self.validation


def episode_cost(arm: Arm) -> EpisodeCost:
    """Costs of an arm's runs."""
    return EpisodeCost(
        generations=fmean(episodes_until(run)[-1] for run in arm.runs),
        supervision=fmean(run.costs[-1].llm.get("episodes", 0) for run in arm.runs),
        validation=fmean(map(_validation, arm.runs)),
        library=max(map(_library, arm.runs)),
    )


def _validation(run: Run) -> float:
    """The approximate number of validation episodes; 0 for a run without validation, or cut."""
    if not run.validation:
        return 0.0
    planned = _planned_episodes(run) * len(run.records)
    return round(float(run.flat.get("gp.validation", 0)) * planned)


def _library(run: Run) -> int:
    """The approximate number of episodes of the search for single behaviours."""
    trees = run.flat.get("gp.founders") or any(g.tree for g in run.guidance)
    if run.flat.get("library.folder") is not None or not trees:
        return 0
    return (POOL + len(run.classes.behaviours) * ROUNDS * CHILDREN) * WORLDS


def cost_warnings(arms: Sequence[Arm]) -> Iterator[str]:
    """A sentence for each difference in the costs of arms."""
    costs = {arm.name: episode_cost(arm) for arm in arms}
    if len({round(cost.total) for cost in costs.values()}) > 1:
        (first, n), *others = ((arm, f"{cost.total:,.0f}") for arm, cost in costs.items())
        each = [f"arm {first} used {n} episodes a run", *(f"arm {a} {m}" for a, m in others)]
        yield note("unequal-cost", each=", ".join(each))
    searched = [(arm, cost.library) for arm, cost in costs.items() if cost.library]
    if 0 < len(searched) < len(costs):
        names = " and ".join(arm for arm, _ in searched)
        yield note("searched-library", arms=names, episodes=f"{searched[0][1]:,}")
