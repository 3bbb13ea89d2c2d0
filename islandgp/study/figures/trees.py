"""Figures 9 and 10: drawings of an early injected tree and a late evolved one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from operator import itemgetter
from typing import Final

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import depth, size
from islandgp.bt.export.render import to_svg
from islandgp.gp.record import IndividualRecord
from islandgp.study.arms import Arm, Comparison, Run
from islandgp.study.figures.drawing import Picture
from islandgp.study.library import library_names
from islandgp.study.texts import title_and_caption

EARLY: Final = 2  # the generation of the paper's example


@dataclass(frozen=True, slots=True)
class Specimen:
    """A tree to draw, with the values of its caption."""

    figure: str  # key of the figure
    tree: str  # canonical text
    values: Mapping[str, object]  # of its caption


def early_injected(study: Comparison) -> Specimen | None:
    """A tree injected in generation 2, as in the paper, or later; None: no arm injects."""
    for arm in study.arms:
        for run in arm.runs:
            for generation, record in enumerate(run.records, 1):
                g = record.guidance
                if g is not None and g.injected and g.tree and generation >= EARLY:
                    values = {
                        **_values(study, arm, run, g.tree, "early"),
                        "generation": generation,
                        "target": g.target or "no stated target",
                    }
                    return Specimen("figure-9", g.tree, values)
    return None


def late_evolved(study: Comparison) -> Specimen:
    """The fittest bred tree of the last stage, preferably one that reaches the last milestone.

    An unchanged tree of a supervisor is used only if there is no other, as it is not evolved.
    """
    tier = study.milestones[-1]
    ranked: list[tuple[tuple[bool, bool, float], Arm, Run, int, IndividualRecord]] = []
    for arm in study.arms:
        for run in arm.runs:
            advised = {g.tree for g in run.guidance}
            for generation in _last_stage(run):
                for i in run.records[generation].individuals:
                    worth = i.tree not in advised, tier in i.tiers, i.fitness
                    ranked.append((worth, arm, run, generation, i))
    _, arm, run, generation, best = max(ranked, key=itemgetter(0))
    values = {
        **_values(study, arm, run, best.tree, "late"),
        "what": study.classes.tier_title(tier) if tier in best.tiers else "the fittest individual",
        "generation": generation,
        "fitness": best.fitness,
        "origin": best.origin,
    }
    return Specimen("figure-10", best.tree, values)


def _last_stage(run: Run) -> range:
    """The generations of the last stage of a run."""
    last = run.snapshots[-1].stage
    start = next(s.generation for s in run.snapshots if s.stage == last)
    return range(start, len(run.records))


def _values(study: Comparison, arm: Arm, run: Run, tree: str, key: str) -> dict[str, object]:
    """Values of a caption: run, name in the library, size, and the corresponding published tree."""
    name, node = library_names(run.config).get(tree), parse(tree)
    figure = study.paper.drawn_after.get(name) if study.paper and name else None
    after = f", modelled on the paper's {figure}" if figure else ""
    published = study.paper.trees.get(key) if study.paper else None
    return {
        "arm": arm.name,
        "seed": run.seed,
        "name": f"library tree {name}{after}, " if name else "",
        "size": f"{size(node)} nodes, depth {depth(node)}",
        "published": f" The paper's: {published}." if published else "",
    }


def drawn(specimen: Specimen) -> Picture:
    """The tree as `islandgp export --to svg` draws it; there is no PNG."""
    heading, caption = title_and_caption(specimen.figure, **specimen.values)
    return Picture(specimen.figure, heading, caption, to_svg(parse(specimen.tree)))
