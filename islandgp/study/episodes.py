"""Costs of runs in episodes, by generation and in total."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from statistics import fmean
from typing import Any

from islandgp.evolution.single_behaviours import CHILDREN, POOL, ROUNDS, WORLDS
from islandgp.gp.record import Cost, GenerationRecord
from islandgp.study.arms import Arm, Run
from islandgp.study.texts import note


def episodes_until(run: Run) -> tuple[int, ...]:
    """Episodes that a run asked for up to the end of each generation, those from a cache too."""
    each = zip(run.records, run.costs, strict=True)
    return tuple(accumulate(_episodes(record, cost, run.flat) for record, cost in each))


def _episodes(record: GenerationRecord, cost: Cost, flat: Mapping[str, Any]) -> int:
    """The episodes of a generation, by its record, by its costs, else by the configuration."""
    for known in (getattr(record, "episodes", None), cost.episodes):
        if isinstance(known, int) and known > 0:
            return known
    return int(flat["gp.population"]) * int(flat["gp.episodes"])


@dataclass(frozen=True, slots=True)
class EpisodeCost:
    """Episodes of an arm's runs: means over them."""

    generations: float  # asked for in the generations
    supervision: float  # that the supervisor ran for itself, such as trials of candidates
    validation: float  # about, in which the best robot was chosen
    library: int  # about, of the search for a library, once for all runs; 0: there was none

    @property
    def total(self) -> float:
        """Of one run; the search for a library is not one run's."""
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
    """About as many episodes as `gp.validation` allows; 0: it was not validated, or cut."""
    if not run.validation:
        return 0.0
    planned = int(run.flat["gp.population"]) * int(run.flat["gp.episodes"]) * len(run.records)
    return round(float(run.flat.get("gp.validation", 0)) * planned)


def _library(run: Run) -> int:
    """At most as many episodes as the search for single behaviours has."""
    trees = run.flat.get("gp.founders") or any(g.tree for g in run.guidance)
    if run.flat.get("library.folder") is not None or not trees:
        return 0
    return (POOL + len(run.classes.behaviours) * ROUNDS * CHILDREN) * WORLDS


def cost_warnings(arms: Sequence[Arm]) -> Iterator[str]:
    """A sentence for each way in which arms cost differently."""
    costs = {arm.name: episode_cost(arm) for arm in arms}
    if len({round(cost.total) for cost in costs.values()}) > 1:
        first, *others = (f"{arm} {cost.total:,.0f}" for arm, cost in costs.items())
        name, _, n = first.rpartition(" ")
        each = ", ".join([f"arm {name} used {n} episodes a run", *(f"arm {o}" for o in others)])
        yield note("unequal-cost", each=each)
    searched = [(arm, cost.library) for arm, cost in costs.items() if cost.library]
    if 0 < len(searched) < len(costs):
        names = " and ".join(arm for arm, _ in searched)
        yield note("searched-library", arms=names, episodes=f"{searched[0][1]:,}")
