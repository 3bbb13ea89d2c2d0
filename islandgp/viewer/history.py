"""A run's curves over generations, thinned for a picture, and the lineage of its best robot."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import accumulate, groupby
from math import fsum
from operator import itemgetter
from statistics import fmean
from typing import Any, Final

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import size
from islandgp.bt.export.render import label
from islandgp.records.files import generation_lines
from islandgp.records.folder import RunFolder
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import Constraints, Merit, merit, recorded_constraints, violation
from islandgp.text import title

POINTS: Final = 300  # most points of a curve in a picture
TIERS: Final = 8  # most curves of tiers; the best tiers have one
CURVES: Final = ("fitness_max", "fitness_mean", "best_of_stage", "coverage", "qd_score")


@dataclass(slots=True)
class RunRecords:
    """What the end of a run and its page need of all generations so far."""

    constraints: Constraints = field(default_factory=dict)
    snapshots: list[Mapping[str, Any]] = field(default_factory=list)  # by generation
    costs: list[Mapping[str, Any]] = field(default_factory=list)  # by generation
    decisions: list[Mapping[str, Any]] = field(default_factory=list)  # of the supervisor
    worlds: set[int] = field(default_factory=set)  # seeds
    curves: list[dict[str, float]] = field(default_factory=list)
    """By generation: points, the archive's figures, and the share of individuals of each tier."""
    fittest: Mapping[str, Any] | None = None  # record of the best individual of the last stage
    first_best: str = ""  # canonical text of the fittest tree of generation 0
    counted: set[str] = field(default_factory=set)  # counters that were above 0 in any individual

    @property
    def generations(self) -> int:
        """Generations so far."""
        return len(self.snapshots)

    @property
    def stage(self) -> int:
        """The stage of the last generation, as an index into Table 2."""
        return int(self.snapshots[-1]["stage"])

    @property
    def episodes(self) -> int:
        """Episodes so far."""
        return sum(cost["episodes"] for cost in self.costs)

    @property
    def seconds(self) -> float:
        """Seconds spent in the generations."""
        return fsum(
            c[part] for c in self.costs for part in ("evaluation", "supervision", "operators")
        )

    def add(self, record: Mapping[str, Any], cost: Mapping[str, Any]) -> None:
        """Add a generation, given its record and its costs as plain values."""
        snapshot, everyone, archive = record["snapshot"], record["individuals"], record["archive"]
        best = max(everyone, key=self._merit)
        is_new = not self.snapshots or snapshot["stage"] != self.stage
        if self.fittest is None or is_new or self._merit(best) > self._merit(self.fittest):
            self.fittest = best
        self.first_best = self.first_best or max(everyone, key=lambda i: i["fitness"])["tree"]
        self.snapshots.append(snapshot)
        self.costs.append(cost)
        self.curves.append(
            {
                "fitness_max": best["fitness"],
                "best_of_stage": self.fittest["fitness"],
                "fitness_mean": snapshot["fitness_mean"],
                "coverage": archive["coverage"],
                "qd_score": archive["qd_score"],
                **{name: n / max(1, len(everyone)) for name, n in snapshot["tiers"].items()},
            }
        )
        self.worlds.update(record["worlds"])
        if (guidance := record["guidance"]) is not None:
            self.decisions.append({key: guidance[key] for key in ("source", "asked_at")})
        for i in everyone:
            self.counted.update(name for name, value in i["counters"].items() if value > 0)

    def _merit(self, individual: Mapping[str, Any]) -> Merit:
        v = violation(individual["counters"], self.constraints) if self.constraints else 0.0
        return merit(individual["fitness"], v)


def read_history(folder: RunFolder) -> RunRecords:
    """The history of the generations in a run's folder. Raises RunError."""
    history = RunRecords(recorded_constraints(folder.configuration()))
    for record, cost in zip(folder.records(), folder.costs(), strict=False):
        history.add(record, cost)
    return history


MAX_NAMES: Final = 6  # most names in a sentence


def nothing_works(history: RunRecords, classes: Classes) -> str:
    """A sentence on what no individual has achieved, with remedies; "" if something works.

    Something works if an individual has shown a behaviour and one has reached a tier. Points are
    no criterion, as some domains have penalties only.

    Args:
        history: of at least one generation.
        classes: of the run.
    """
    missing = [name for name, key in classes.behaviours.items() if key not in history.counted]
    reached = any(n for snapshot in history.snapshots for n in snapshot["tiers"].values())
    if reached and len(missing) < len(classes.behaviours):
        return ""
    tiers = "" if reached else f"reached a tier ({_listed(map(title, classes.tiers))})"
    behaviours = f"shown a behaviour ({_listed(missing)})" if missing else ""
    return (
        f"No individual has ever {' or '.join(filter(None, (tiers, behaviours)))} in"
        f" {history.episodes:,} episodes: start from a tree (`start=`), add a library, reward a"
        " step before it, or raise `gp.episodes`."
    )


def _listed(names: Iterable[str]) -> str:
    first = [*names]
    more = [f"{len(first) - MAX_NAMES} more"] if len(first) > MAX_NAMES else []
    return ", ".join([*first[:MAX_NAMES], *more])


def thinned(history: RunRecords, points: int = POINTS) -> dict[str, Any]:
    """The curves with at most `points` points: of generations at equal distances, and the last."""
    n = history.generations
    places = sorted({(i + 1) * n // points - 1 for i in range(points)} - {-1})
    episodes = [*accumulate(cost["episodes"] for cost in history.costs)]
    stages = [snapshot["stage"] for snapshot in history.snapshots]
    tiers = [*history.snapshots[-1]["tiers"]][:TIERS] if n else []

    def curve(name: str) -> list[float]:
        return [history.curves[place].get(name, 0.0) for place in places]

    return {
        "generation": places,
        "episodes": [episodes[place] for place in places],
        **{name: curve(name) for name in CURVES},
        "tiers": {tier: curve(tier) for tier in tiers},
        "stages": [
            [episodes[g], stages[g] + 1] for g in range(n) if not g or stages[g] != stages[g - 1]
        ],
    }


MAX_NODES: Final = 300  # most nodes of trees that are compared
MAX_CHANGES: Final = 40  # most changed nodes of a step that are listed


@dataclass(frozen=True, slots=True)
class LineageStep:
    """A tree in the chain."""

    first: Mapping[str, Any]  # record of the first individual with this tree
    last: str  # id of the last one
    fitness: float  # points, mean over the individuals with this tree
    evaluated: int  # number of individuals with this tree
    changes: tuple[str, ...] | None
    """Lines with a mark (-, + or ~) for nodes that differ from the first parent's tree, MAX_CHANGES
    at most; None: the trees are too large."""
    left_out: int  # number of changes that are not listed
    guidance: Mapping[str, Any] | None  # with the tree, if a supervisor injected or edited it


def lineage(folder: RunFolder, name: str) -> list[LineageStep]:
    """The ancestors of the individual with this id, including itself, the oldest first.

    Each is the first parent of the next one. Raises RunError if a record is damaged.
    """
    lines = generation_lines(folder.path)
    whole = [*lines.whole()]

    @lru_cache(maxsize=4)
    def record(generation: int) -> dict[str, Any]:
        return lines.value(whole[generation], generation)

    def individual(name: str, end: int) -> dict[str, Any] | None:
        """The individual with this id if the generations before `end` have it."""
        if not name.partition(".")[0].isdecimal() or _generation(name) >= end:
            return None
        everyone = record(_generation(name))["individuals"]
        return next((i for i in everyone if i["id"] == name), None)

    chain: list[dict[str, Any]] = []  # the newest first
    ancestor = individual(name, len(whole))
    while ancestor is not None:
        chain.append(ancestor)
        parents = ancestor["parents"]
        ancestor = individual(parents[0], _generation(ancestor["id"])) if parents else None
    steps: list[LineageStep] = []
    for tree, same in groupby(reversed(chain), itemgetter("tree")):
        first, *others = same
        changes = tree_changes(steps[-1].first["tree"], tree) if steps else ()
        generation = _generation(first["id"])
        is_supervised = first["origin"] in ("injected", "edited") and generation
        step = LineageStep(
            first=first,
            last=[first, *others][-1]["id"],
            fitness=fmean(i["fitness"] for i in (first, *others)),
            evaluated=1 + len(others),
            changes=None if changes is None else changes[:MAX_CHANGES],
            left_out=max(0, len(changes or ()) - MAX_CHANGES),
            guidance=record(generation - 1)["guidance"] if is_supervised else None,
        )
        steps.append(step)
    return steps


def tree_changes(old: str, new: str) -> tuple[str, ...] | None:
    """A line for each node that differs between two trees; None if one has over MAX_NODES."""
    from islandgp.bt.analysis.compare import Mark, compare  # only for a tree with a parent

    before, after = parse(old), parse(new)
    if max(size(before), size(after)) > MAX_NODES:
        return None
    arrow = " \N{RIGHTWARDS ARROW} "
    return tuple(
        f"{line.mark} {'  ' * line.level}"
        + arrow.join(dict.fromkeys(label(n) for n in (line.old, line.new) if n is not None))
        for line in compare(before, after)
        if line.mark is not Mark.SAME
    )


def _generation(name: str) -> int:
    return int(name.partition(".")[0])
