"""Diversity and classes over time, and the lineage of newcomers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from islandgp.evolution.population import Origin
from islandgp.scoring.classify import Specialist
from islandgp.study.arms import Arm, Comparison
from islandgp.study.figures.drawing import curves, epoch_lines, legend, named
from islandgp.study.figures.style import FAINT, INK, LINES, Picture, look, looks, picture
from islandgp.study.generalise import Generalisation
from islandgp.study.lineage import alive, newcomers
from islandgp.study.notation import number
from islandgp.study.specialists import SPECIALISTS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def diversity(study: Comparison) -> Picture:
    """Eq. (3) by generation."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        curves(axes, study, lambda s: s.diversity)
        axes.axhline(0.75, color=INK, linewidth=0.7, linestyle=":")
        axes.set_ylim(0, 0.8)
        axes.set_ylabel("Behavioural diversity, Eq. (3)")
        legend(figure, axes)

    return picture(
        "diversity",
        "Behavioural diversity by generation",
        "Mean over runs, bands of ±1 standard deviation; the dotted line is the most that four"
        " classes allow, 3/4.",
        draw,
    )


def classes(study: Comparison) -> Picture:
    """The shares of the exclusive classes, and of the two labels."""

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(study.arms), sharey=True, squeeze=False)[0]
        for axes, arm in zip(panels, study.arms, strict=True):
            _classes(axes, arm, study.generations)
            epoch_lines(axes, study)
            axes.set(title=arm.name, xlabel="Generation")
            axes.set_ylim(0, 1)
        panels[0].yaxis.set_major_formatter(lambda v, _: f"{v:.0%}")
        panels[0].set_ylabel("Share of the population")
        legend(figure, panels[0], 6)

    return picture(
        "classes",
        "Diversity by class over generations",
        "Areas: the exclusive classes of section 2.3.3; lines: the labels charging and clearing,"
        " which any individual can carry. Mean over runs.",
        draw,
        height=3.8,
    )


def _classes(axes: Axes, arm: Arm, generations: int) -> None:
    sizes = [len(run.records[0].individuals) for run in arm.runs]
    runs = [run.snapshots[:generations] for run in arm.runs]
    base = np.zeros(generations)
    x = np.arange(generations)
    for i, name in enumerate(Specialist):
        share = np.mean(
            [[s.specialists[name] / n for s in run] for run, n in zip(runs, sizes, strict=True)],
            axis=0,
        )
        how = look(i)
        axes.fill_between(
            x,
            base,
            base + share,
            facecolor="#dddddd" if name is Specialist.PATROL_ONLY else how.colour,
            edgecolor="white",
            linewidth=0.3,
            hatch=how.hatch,
            alpha=0.75,
            label=name.value.replace("_", "-"),
        )
        base = base + share
    for k, label in enumerate(("charging", "clearing")):
        count = SPECIALISTS[label]
        share = np.mean(
            [[count(s) / n for s in run] for run, n in zip(runs, sizes, strict=True)], axis=0
        )
        axes.plot(x, share, color="white", linewidth=3.4)
        axes.plot(x, share, color=INK, linewidth=1.6, linestyle=LINES[k], label=label)


def lineage(study: Comparison) -> Picture | None:
    """How long newcomers' lines last; None when no arm has any newcomer."""
    curves: list[tuple[str, int, int, list[float]]] = []
    for i, arm in enumerate(study.arms):
        found = [n for run in arm.runs for n in newcomers(run)]
        for k, origin in enumerate((Origin.INJECTED, Origin.RANDOM)):
            mine = [n for n in found if n.origin == origin]
            if mine:
                label = f"{arm.name}: {origin.value} (n = {len(mine):,})"
                curves.append((label, i, k, alive(mine, study.generations - 1)))
    if not curves:
        return None

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for label, i, k, shares in curves:
            how = look(i)
            axes.plot(
                range(len(shares)),
                shares,
                color=how.colour,
                linestyle=LINES[0] if k == 0 else LINES[3],
                marker=how.marker,
                markevery=5,
                markersize=4,
                label=label,
            )
        axes.set_ylim(0, 1.03)
        axes.set_xlim(left=0)
        axes.yaxis.set_major_formatter(lambda v, _: f"{v:.0%}")
        axes.set(xlabel="Generations after it came", ylabel="Share with a living descendant")
        legend(figure, axes)

    return picture(
        "lineage",
        "Survival of newcomers",
        "Solid: trees that a supervisor injected; dotted: random trees of the diversity slots."
        " Kaplan-Meier estimate: a newcomer whose line lives at the end of its run is censored.",
        draw,
    )


def generalisation(found: tuple[Generalisation, ...], study: Comparison) -> Picture:
    """Champions' fitness in training against their mean on unseen worlds."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for arm, how in looks(study):
            mine = [g for g in found if g.arm == arm.name and g.seed is not None]
            axes.scatter(
                [g.trained or 0.0 for g in mine],
                [g.unseen for g in mine],
                color=how.colour,
                marker=how.marker,
                s=26,
                edgecolor="white",
                linewidth=0.4,
                label=named(arm),
            )
        for k, g in enumerate(g for g in found if g.seed is None):
            colour, line = (INK, FAINT)[k % 2], LINES[3 - k % 2]
            axes.axhline(g.unseen, color=colour, linestyle=line, linewidth=1.2, label=g.arm)
        low, high = axes.get_xlim()
        axes.plot([low, high], [low, high], color="#bbbbbb", linewidth=0.9, zorder=0.5)
        axes.set_xlim(low, high)
        axes.set(xlabel="Fitness that made it champion", ylabel="Mean fitness, unseen worlds")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter(lambda v, _: number(v))
        legend(figure, axes, 2)

    return picture(
        "generalisation",
        "Champions on unseen worlds",
        "Each point is a run's champion; on the grey line it would do as well in unseen worlds as"
        " in the one that made it champion. Lines across: trees of grammar/examples.",
        draw,
        height=4.0,
    )
