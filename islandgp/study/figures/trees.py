"""Figures 9 and 10: an early injected tree and a late evolved one, drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from islandgp.bt.language import parse
from islandgp.bt.node import Node, depth, size
from islandgp.bt.render.label import label
from islandgp.bt.render.layout import BOX, Box, lay_out
from islandgp.bt.render.svg import COLOURS, to_svg
from islandgp.scoring.classify import Tier
from islandgp.study.arms import Comparison, Run
from islandgp.study.figures.style import Picture, picture
from islandgp.study.library import library

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INCH = 96.0  # px
EARLY = 2  # the generation of the paper's example


@dataclass(frozen=True, slots=True)
class Specimen:
    """A tree worth drawing, and what is to be said of it."""

    tree: str  # canonical text
    caption: str


def early_injected(study: Comparison) -> Specimen | None:
    """A tree injected in generation 2, as in the paper, or later; None: no arm injects."""
    for arm in study.arms:
        for run in arm.runs:
            for generation, record in enumerate(run.records, 1):
                g = record.guidance
                if g is not None and g.injected and g.tree and generation >= EARLY:
                    return Specimen(
                        g.tree,
                        f"{arm.name}, seed {run.seed}: {_named(g.tree)}injected into generation"
                        f" {generation} for {g.target or 'no stated target'}; {_size(g.tree)}."
                        " The paper's: 22 nodes, depth 5, injected in generation 2. It is shown as"
                        " the supervisor gave it, before mutation.",
                    )
    return None


def late_evolved(study: Comparison) -> Specimen:
    """The fittest bred tree of the last stage, an Excellent Robot if there is one in any run.

    A tree that is still as a supervisor gave it comes last: it shows no evolution.
    """
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
            Tier.EXCELLENT in found[3].tiers,
            found[3].fitness,
        ),
    )
    what = "Excellent Robot" if Tier.EXCELLENT in best.tiers else "the fittest individual"
    return Specimen(
        best.tree,
        f"{arm.name}, seed {run.seed}: {what} of generation {generation}, fitness"
        f" {best.fitness:,.0f}, {_named(best.tree)}{best.origin}; {_size(best.tree)}."
        " The paper's: 70 nodes, depth 11.",
    )


def _last_stage(run: Run) -> range:
    """The generations under the last multipliers that the run came to."""
    last = run.snapshots[-1].stage
    start = next(s.generation for s in run.snapshots if s.stage == last)
    return range(start, len(run.records))


def _named(tree: str) -> str:
    """Which example tree it is, by its file's name; nothing for any other tree."""
    name = library().get(tree)
    if name is None:
        return ""
    after = ", modelled on the paper's Figure 9" if name == "paper_fig9" else ""
    return f"library tree {name}{after}, "


def _size(tree: str) -> str:
    node = parse(tree)
    return f"{size(node)} nodes, depth {depth(node)}"


def drawn(key: str, title: str, specimen: Specimen) -> Picture:
    """The tree as a picture."""
    tree = parse(specimen.tree)
    boxes, width, height = lay_out(tree)

    def draw(figure: Figure) -> None:
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set_xlim(0, width)
        axes.set_ylim(height, 0)
        axes.axis("off")
        for box in boxes:
            _edge(axes, box, boxes)
        for box in boxes:
            _node(axes, box)

    done = picture(
        key,
        title,
        specimen.caption,
        draw,
        width=width / INCH,
        height=height / INCH,
        layout=None,
    )
    return Picture(key, title, specimen.caption, to_svg(tree), done.png)


def _edge(axes: Axes, box: Box, boxes: list[Box]) -> None:
    if box.parent < 0:
        return
    above = boxes[box.parent]
    start, end = above.x + above.width, box.x
    middle = (start + end) / 2
    axes.plot(
        [start, middle, middle, end], [above.y, above.y, box.y, box.y], color="#9aa7b3", linewidth=1
    )


def _node(axes: Axes, box: Box) -> None:
    from matplotlib.patches import FancyBboxPatch

    node: Node = box.node
    fill, stroke = COLOURS[node.kind]
    round_ = BOX / 2 - 1 if node.kind == "action" else 3
    axes.add_patch(
        FancyBboxPatch(
            (box.x, box.y - BOX / 2),
            box.width,
            BOX,
            boxstyle=f"round,pad=0,rounding_size={round_}",
            facecolor=fill,
            edgecolor=stroke,
            linewidth=0.9,
        )
    )
    axes.text(
        box.x + box.width / 2,
        box.y,
        label(node),
        ha="center",
        va="center_baseline",
        fontsize=8,
        family="DejaVu Sans Mono",
    )
