"""A run's curves over generations, thinned for a picture, and the lineage of its best robot."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import accumulate, pairwise
from math import fsum
from operator import itemgetter
from statistics import fmean
from typing import Any, Final

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node, size
from islandgp.bt.export.render import label
from islandgp.domain import RewardTable
from islandgp.gate import opened
from islandgp.records.files import generation_lines
from islandgp.records.folder import RunFolder
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import Constraints, Merit, merit, recorded_constraints, violation
from islandgp.text import title

POINTS: Final = 300  # most points of a curve in a picture
TIERS: Final = 8  # most curves of tiers; the best tiers have one
LAST: Final = ("best_of_stage", "coverage", "qd_score")  # of some generations, that of the last one


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
    earned: set[str] = field(default_factory=set)  # components with which any individual won points
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
            self.earned.update(name for name, points in i["components"].items() if points > 0)
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


def nothing_works(history: RunRecords, classes: Classes, rewards: object) -> str:
    """A sentence on what no individual has achieved, with remedies; "" if something works.

    Something works if an individual has shown a behaviour and one has reached a tier. Points are
    no criterion, as some domains have penalties only.

    Args:
        history: of at least one generation.
        classes: of the run.
        rewards: of its domain; if it is a RewardTable, events that never paid are named, except
            those of a component with penalties, which may hide their points.
    """
    table = rewards.events if isinstance(rewards, RewardTable) else {}
    known = history.earned | {row.component for row in table.values() if row.costs}
    unpaid = [event for event, row in table.items() if row.component not in known]
    missing = [name for name, key in classes.behaviours.items() if key not in history.counted]
    reached = any(n for snapshot in history.snapshots for n in snapshot["tiers"].values())
    if reached and len(missing) < len(classes.behaviours):
        return ""
    failures = []
    if not reached:
        failures.append(f"reached a tier ({_listed(map(title, classes.tiers))})")
    if missing:
        failures.append(f"shown a behaviour ({_listed(missing)})")
    if unpaid:
        failures.append(f"earned points for {_listed(unpaid)}")
    return (
        f"No individual has ever {' or '.join(failures)} in {history.episodes:,} episodes:"
        " start from a tree (`start=`), add a library, reward a step before it, or raise"
        " `gp.episodes`."
    )


def _listed(names: Iterable[str]) -> str:
    first = [*names]
    more = [f"{len(first) - MAX_NAMES} more"] if len(first) > MAX_NAMES else []
    return ", ".join([*first[:MAX_NAMES], *more])


def thinned(history: RunRecords, points: int = POINTS) -> dict[str, Any]:
    """The curves with at most `points` points, each of about as many generations."""
    n, k = history.generations, min(history.generations, points)
    places = [*pairwise(i * n // k for i in range(k + 1))] if k else []
    episodes = [*accumulate(cost["episodes"] for cost in history.costs)]
    stages = [snapshot["stage"] for snapshot in history.snapshots]

    def joined(name: str, join: Callable[[Sequence[float]], float] = fmean) -> list[float]:
        values = [row.get(name, 0.0) for row in history.curves]
        return [join(values[first:end]) for first, end in places]

    return {
        "generation": [end - 1 for _, end in places],
        "episodes": [episodes[end - 1] for _, end in places],
        "fitness_max": joined("fitness_max", max),
        "fitness_mean": joined("fitness_mean"),
        **{name: joined(name, itemgetter(-1)) for name in LAST},
        "tiers": {tier: joined(tier) for tier in [*history.snapshots[-1]["tiers"]][:TIERS]}
        if n
        else {},
        "stages": [
            [episodes[g], stages[g] + 1] for g in range(n) if not g or stages[g] != stages[g - 1]
        ],
    }


MAX_INDIVIDUALS: Final = 5_000  # most individuals of a chain that are read
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


@dataclass(frozen=True, slots=True)
class Lineage:
    """A chain of ancestors, oldest first."""

    steps: tuple[LineageStep, ...]
    is_complete: bool  # True: it begins with an individual without parents


def lineage(folder: RunFolder, name: str) -> Lineage:
    """The ancestors of the individual with this id, including itself.

    Raises RunError if a record is damaged.
    """
    reader = _Reader(folder)
    steps: list[LineageStep] = []
    same: list[dict[str, Any]] = []  # individuals with one tree, the newest first
    ancestor = reader.individual(name)
    for _ in range(MAX_INDIVIDUALS):
        if ancestor is None:
            break
        same.append(ancestor)
        parent = reader.parent(ancestor)
        if parent is None or parent["tree"] != ancestor["tree"]:
            steps.append(_step(reader, same, parent))
            same = []
        ancestor = parent
    if same:  # the chain is longer than MAX_INDIVIDUALS
        steps.append(_step(reader, same, None))
    is_complete = bool(steps) and not steps[-1].first["parents"]
    return Lineage(tuple(reversed(steps)), is_complete)


def _step(
    reader: _Reader, same: list[dict[str, Any]], parent: dict[str, Any] | None
) -> LineageStep:
    """The step of the individuals `same`, the newest first, whose first parent is `parent`."""
    first, generation = same[-1], _generation(same[-1]["id"])
    changes = () if parent is None else tree_changes(parent["tree"], first["tree"])
    guidance = None
    if first["origin"] in ("injected", "edited") and generation:
        guidance = (reader.record(generation - 1) or {}).get("guidance")
    return LineageStep(
        first=first,
        last=same[0]["id"],
        fitness=fmean(i["fitness"] for i in same),
        evaluated=len(same),
        changes=None if changes is None else changes[:MAX_CHANGES],
        left_out=max(0, len(changes or ()) - MAX_CHANGES),
        guidance=guidance,
    )


@lru_cache(maxsize=8)  # an ancestor is compared with its parent, and its child with it
def _tree(text: str) -> Node:
    return parse(text)


def tree_changes(old: str, new: str) -> tuple[str, ...] | None:
    """A line for each node that differs between two trees; None if one has over MAX_NODES."""
    from islandgp.bt.analysis.compare import Mark, compare  # only for a tree with a parent

    if max(size(_tree(old)), size(_tree(new))) > MAX_NODES:
        return None
    arrow = " \N{RIGHTWARDS ARROW} "
    return tuple(
        f"{line.mark} {'  ' * line.level}"
        + arrow.join(dict.fromkeys(label(n) for n in (line.old, line.new) if n is not None))
        for line in compare(_tree(old), _tree(new))
        if line.mark is not Mark.SAME
    )


class _Reader:
    """Reads single generations of a long file."""

    def __init__(self, folder: RunFolder) -> None:
        self._lines = generation_lines(folder.path)
        self._offsets = array("Q", accumulate(map(len, self._lines.whole()), initial=0))
        """Of each generation's record, and of the end of the last one."""
        self.record = lru_cache(maxsize=4)(self._record)

    def _record(self, generation: int) -> dict[str, Any] | None:
        """A generation's record; None if there is none."""
        if not 0 <= generation < len(self._offsets) - 1:
            return None
        with opened(self._lines.path) as file:
            file.seek(self._offsets[generation])
            return self._lines.value(file.readline(), generation)

    def individual(self, name: str) -> dict[str, Any] | None:
        """The individual with this id; None if the records have none."""
        generation = name.partition(".")[0]
        record = self.record(int(generation)) if generation.isdecimal() else None
        return next((i for i in (record or {}).get("individuals", ()) if i["id"] == name), None)

    def parent(self, child: Mapping[str, Any]) -> dict[str, Any] | None:
        """The first parent of an individual; None if it has none in an earlier generation."""
        for name in child["parents"][:1]:
            ancestor = self.individual(name)
            if ancestor is not None and _generation(ancestor["id"]) < _generation(child["id"]):
                return ancestor
        return None


def _generation(name: str) -> int:
    return int(name.partition(".")[0])
