"""Figures 9 and 10: an early injected tree and a late evolved one, drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node, depth, size
from islandgp.bt.export.render import branches, label
from islandgp.study.arms import Arm, Comparison, Run
from islandgp.study.figures.drawing import COLUMN, FAINT, WIDTH, Picture, picture
from islandgp.study.library import library_names
from islandgp.text import title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EARLY: Final = 2  # the generation of the paper's example

INDENT: Final = 0.17  # inches from a node to its children
LETTER: Final = 0.067  # inches a letter of 8 points, monospaced
LINE: Final = 0.185  # inches from a node to the next one below
PADDING: Final = 0.1  # inches left and right of a label together
GAP: Final = 0.15  # inches between columns
EDGE: Final = "#9aa7b3"
LAST: Final = "\N{BOX DRAWINGS LIGHT UP AND RIGHT}"  # leads to the last child, as `branches` has it
LONG: Final = 48  # nodes of a column of 9 inches, beyond which a second one is begun


@dataclass(frozen=True, slots=True)
class Specimen:
    """A tree worth drawing, and what is to be said of it."""

    figure: str  # its key
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
    """The fittest bred tree of the last stage, of the last milestone if there is one in any run.

    A tree that is still as a supervisor gave it comes last: it shows no evolution.
    """
    tier = study.milestones[-1]
    given = {
        (run.seed, arm.name): {r.guidance.tree for r in run.records if r.guidance is not None}
        for arm in study.arms
        for run in arm.runs
    }
    arm, run, generation, best = max(
        (
            (arm, run, generation, i)
            for arm in study.arms
            for run in arm.runs
            for generation in _last_stage(run)
            for i in run.records[generation].individuals
        ),
        key=lambda found: (
            found[3].tree not in given[found[1].seed, found[0].name],
            tier in found[3].tiers,
            found[3].fitness,
        ),
    )
    values = {
        **_values(study, arm, run, best.tree, "late"),
        "what": f"{title(tier)} Robot" if tier in best.tiers else "the fittest individual",
        "generation": generation,
        "fitness": best.fitness,
        "origin": best.origin,
    }
    return Specimen("figure-10", best.tree, values)


def _last_stage(run: Run) -> range:
    """The generations in the last stage that the run reached."""
    last = run.snapshots[-1].stage
    start = next(s.generation for s in run.snapshots if s.stage == last)
    return range(start, len(run.records))


def _values(study: Comparison, arm: Arm, run: Run, tree: str, key: str) -> dict[str, object]:
    """Whose a tree is, its name in the library if it has one, and what a paper draws there."""
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
    """The tree as an outline of a column's width, of a page's in two columns where it is long.

    So its letters have their size where it is printed in a text of two columns.
    """
    rows = list(branches(parse(specimen.tree)))
    columns = 2 if len(rows) > LONG else 1
    each = -(-len(rows) // columns)
    wide = COLUMN if columns == 1 else WIDTH
    room = (wide - GAP * (columns - 1)) / columns
    scale = min(1.0, room / max(_left(before) + _width(node) for before, node in rows))

    def draw(figure: Figure) -> None:
        for k in range(columns):
            axes = figure.add_axes((k * (room + GAP) / wide, 0, room / wide, 1))
            axes.set_xlim(0, room / scale)
            axes.set_ylim(each - 0.5, -0.5)
            axes.axis("off")
            for place, (before, node) in enumerate(rows[k * each : (k + 1) * each]):
                _lines(axes, before, place)
                _node(axes, node, _left(before), place, scale)

    return picture(
        specimen.figure,
        draw,
        height=each * LINE * scale,
        width=wide,
        layout=None,
        more=" It goes on in the second column." if columns > 1 else "",
        **specimen.values,
    )


def _left(before: str) -> float:
    """Where a node begins, in inches; `before` are the lines that lead to it, 3 signs a level."""
    return INDENT * len(before) / 3


def _width(node: Node) -> float:
    return LETTER * len(label(node)) + PADDING


def _lines(axes: Axes, before: str, place: int) -> None:
    """A row's part of the lines from parents to children."""
    for level, sign in enumerate(before[::3]):
        x = INDENT * (level + 0.4)
        end = place if sign == LAST else place + 0.5
        if sign.strip():
            axes.plot([x, x], [place - 0.5, end], color=EDGE, linewidth=0.9, zorder=1)
    if before:
        x = _left(before)
        axes.plot([x - 0.6 * INDENT, x], [place] * 2, color=EDGE, linewidth=0.9)


def _node(axes: Axes, node: Node, left: float, place: int, scale: float) -> None:
    from matplotlib.patches import FancyBboxPatch

    axes.add_patch(
        FancyBboxPatch(
            (left, place - 0.4),
            _width(node),
            0.8,
            boxstyle="round,pad=0,rounding_size=0.04",
            mutation_aspect=0.8 / LINE,
            facecolor=kind_of(node).look.fill,  # its line has an arm's colour
            edgecolor=FAINT,
            linewidth=0.7,
            zorder=2,
        )
    )
    axes.text(
        left + _width(node) / 2,
        place,
        label(node),
        ha="center",
        va="center_baseline",
        fontsize=8 * scale,
        family="DejaVu Sans Mono",
        zorder=3,
    )
