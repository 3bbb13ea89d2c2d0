"""How the best trees do on worlds that no run has seen.

A champion's fitness is the highest of 1,230 episodes and so partly luck with its
world. Here each run's champion meets the same unseen worlds, in the last stage.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count, islice
from statistics import fmean
from typing import Any, Final

from islandgp.evaluation.base import Evaluator, Job, Setting
from islandgp.island.world import World
from islandgp.scoring.classify import Classes, Tier, tiers
from islandgp.scoring.curriculum import Curriculum
from islandgp.scoring.outcome import Outcome
from islandgp.scoring.rewards import Rewards
from islandgp.study.ancestry import most_injected
from islandgp.study.arms import Comparison, Run
from islandgp.study.library import library

ALL_ROUNDER: Final = "all_rounder"
"""The tree of grammar/examples that was written to be good at everything."""


@dataclass(frozen=True, slots=True)
class Generalisation:
    """One tree on the unseen worlds."""

    arm: str  # or what a yardstick is called
    seed: int | None  # of the run whose champion it is; None: a yardstick, a tree from elsewhere
    trained: float | None  # points, the fitness that made it champion
    unseen: float  # points, mean over the worlds
    worst: float  # points, the least of the worlds
    complete: float  # share of the worlds in which it is a Complete Robot
    excellent: float  # share in which it is an Excellent Robot


def unseen_worlds(study: Comparison, n: int) -> tuple[int, ...]:
    """The first n world seeds from 0 that no run of the study used."""
    used = {w for arm in study.arms for run in arm.runs for r in run.records for w in r.worlds}
    return tuple(islice((seed for seed in count() if seed not in used), n))


def yardsticks(study: Comparison) -> dict[str, str]:
    """The hand-written all_rounder, and the library tree that was injected most often, if any.

    Their names hold a colon, so that no arm can have the same one.
    """
    by_name = {name: text for text, name in library().items()}
    found = {f"hand-written: {ALL_ROUNDER}": by_name[ALL_ROUNDER]}
    often = most_injected(study.arms)
    if often is not None:
        name, text, times = often
        found[f"injected {times:,} times: {name}"] = text
    return found


def setting_of(run: Run) -> tuple[Setting, Classes]:
    """The world and the rules in which a run's trees were evaluated."""
    config: Any = run.config
    setting = Setting(
        World(**config["world"]), Rewards(**config["rewards"]), Curriculum(**config["curriculum"])
    )
    return setting, Classes(**config["classes"])


def generalise(
    study: Comparison,
    make: Callable[[Setting], Evaluator],
    *,
    worlds: int,
    yardsticks: Mapping[str, str],
) -> tuple[Generalisation, ...]:
    """Each run's champion, and trees from elsewhere, on the same unseen worlds.

    `yardsticks` are those trees' canonical texts by what they are called. Every arm's trees
    meet the first arm's world, so that they can be compared even where the worlds of arms
    differ.

    Raises:
        EvaluationError: an episode cannot be run.
    """
    setting, classes = setting_of(study.arms[0].runs[0])
    seeds, stage = unseen_worlds(study, worlds), len(setting.curriculum.stages) - 1
    trees: list[tuple[str, int | None, float | None, str]] = [
        (arm.name, run.seed, run.champion.record.fitness, run.champion.record.tree)
        for arm in study.arms
        for run in arm.runs
    ]
    trees += [(name, None, None, text) for name, text in yardsticks.items()]
    evaluator = make(setting)
    try:
        jobs = list(dict.fromkeys(Job(t, stage, seed) for *_, t in trees for seed in seeds))
        outcomes = dict(zip(jobs, evaluator.evaluate(jobs), strict=True))
    finally:
        evaluator.close()
    return tuple(
        _summary(arm, seed, trained, [outcomes[Job(t, stage, w)] for w in seeds], classes)
        for arm, seed, trained, t in trees
    )


def _summary(
    arm: str,
    seed: int | None,
    trained: float | None,
    outcomes: Sequence[Outcome],
    classes: Classes,
) -> Generalisation:
    reached = [tiers(o, classes) for o in outcomes]
    return Generalisation(
        arm=arm,
        seed=seed,
        trained=trained,
        unseen=fmean(o.fitness for o in outcomes),
        worst=min(o.fitness for o in outcomes),
        complete=fmean(Tier.COMPLETE in t for t in reached),
        excellent=fmean(Tier.EXCELLENT in t for t in reached),
    )
