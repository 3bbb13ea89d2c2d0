"""The lineage of the best robot on a run's page: the chain of its ancestors, from the records.

The chain follows the first parent of each individual, whose tree was changed, to an individual
without parents. Consecutive individuals with the same tree are one step.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from html import escape
from itertools import accumulate
from statistics import fmean
from typing import Any, Final

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node, size
from islandgp.bt.export.render import label
from islandgp.gate import opened
from islandgp.records.files import generation_lines
from islandgp.records.folder import RunFolder
from islandgp.text import in_points

MAX_INDIVIDUALS: Final = 5_000  # most individuals of a chain that are read
MAX_NODES: Final = 300  # most nodes of trees that are compared
MAX_CHANGES: Final = 40  # most changed nodes of a step that are listed
STEPS: Final = (6, 34)  # numbers of the first and last steps shown of a long lineage
NOTE: Final = 300  # most characters of a supervisor's reason


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
        f"{line.mark} {'  ' * line.level}{'end of ' if line.end else ''}"
        + arrow.join(label(node) for node in (line.old, line.new) if node is not None)
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


def lineage_section(folder: RunFolder, name: str) -> Iterator[str]:
    """The HTML of the lineage of the individual with this id, one list item per tree."""
    chain = lineage(folder, name)
    yield f"<p>{escape(_summary(chain))}</p>"
    first, last = STEPS
    steps = chain.steps
    yield '<ol class="lineage">'
    if (hidden := len(steps) - first - last) > 0:
        yield from map(_item, steps[:first])
        yield f'<li class="gap">{hidden:,} trees between these are not shown.</li>'
        steps = steps[-last:]
    yield from map(_item, steps)
    yield "</ol>"


def _summary(lineage: Lineage) -> str:
    """A paragraph on the lineage as a whole."""
    steps = lineage.steps
    if not steps:
        return "The records of its generation are missing."
    if len(steps) == 1:
        text = f"It was created in one step: {_origin(steps[0])}."
    else:
        text = (
            f"{len(steps):,} trees in {_generation(steps[-1].first['id']) + 1:,} generations, each"
            " derived from the one before. Points of two of them are from different worlds, unless"
            " they are of one generation, so their difference is partly luck."
        )
    if not lineage.is_complete:
        text += " The ancestors of the first one are not in the records."
    return text


def _item(step: LineageStep) -> str:
    period, first = "", step.first
    if step.last != first["id"]:
        period = f", kept until {step.last} (mean of {step.evaluated} evaluations)"
    return (
        f"<li><b>{escape(first['id'])}</b> {escape(_origin(step))}"
        f'<p class="soft">{in_points(step.fitness)} points, {first["nodes"]} nodes{period}</p>'
        f"{_guidance(step)}{_changes(step)}</li>"
    )


def _origin(step: LineageStep) -> str:
    """The origin of a tree, in words."""
    origin, names, mutation = (step.first[key] for key in ("origin", "parents", "mutation"))
    first = names[0] if names else "a tree that is not in the records"
    origins = {
        "random": "drawn at random",
        "crossover": f"a child of {' and '.join(dict.fromkeys(names))}",
        "copy": f"a child of {first}",
        "elite": f"the elite {first}",
        "behavioural_elite": f"the elite {first} of its behaviour",
        "resurrected": f"{first}, brought back",
        "injected": "given at the start",
        "sampled": "a sample of the search's distribution",
    }
    text = origins.get(origin, origin)
    if origin == "injected" and _generation(step.first["id"]):
        text = "injected by the supervisor"
        if step.guidance is not None:
            target = step.guidance.get("target")
            text = f"injected by {step.guidance['source']}" + (f" for {target}" if target else "")
    if origin == "edited":
        kind, _, mutation = mutation.removeprefix("edit:").partition("+")
        text = f"{first}, edited by the supervisor ({kind})"
    return f"{text}, then mutation {mutation}" if mutation else text


def _guidance(step: LineageStep) -> str:
    guidance = step.guidance or {}
    reason = str(guidance.get("rationale") or guidance.get("reasoning") or "")
    reason = reason if len(reason) <= NOTE else f"{reason[:NOTE]} ..."
    return f'<p class="soft">{escape(reason)}</p>' if reason else ""


def _changes(step: LineageStep) -> str:
    if step.changes is None:
        return '<p class="soft">The trees are too large to compare here.</p>'
    if not step.changes:
        tree = escape(step.first["tree"])
        return f"<details><summary>The tree</summary><pre>{tree}</pre></details>"
    marks = {"-": "deleted", "+": "inserted", "~": "changed"}
    lines = [f'<span class="{marks[line[0]]}">{escape(line)}</span>' for line in step.changes]
    if step.left_out:
        lines.append(f"... and {step.left_out} more")
    counts = {word: sum(line[0] == mark for line in step.changes) for mark, word in marks.items()}
    summary = "What changed: " + ", ".join(f"{n} {word}" for word, n in counts.items() if n)
    body = "\n".join(lines)
    return f'<details><summary>{summary}</summary><pre class="diff">{body}</pre></details>'
