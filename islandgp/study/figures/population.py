"""Diversity and classes over time, and the lineage of newcomers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from islandgp.evolution.population import Origin
from islandgp.study.arms import Arm, Comparison
from islandgp.study.figures.drawing import (
    FAINT,
    INK,
    LINES,
    NEUTRAL,
    PALE,
    Picture,
    curves,
    epoch_lines,
    legend,
    look,
    looks,
    named,
    picture,
    sideways,
    thousands,
)
from islandgp.study.generalise import Generalisation
from islandgp.study.lineage import alive, newcomers
from islandgp.study.measures import shown
from islandgp.study.statistics import mean_interval
from islandgp.study.table import number
from islandgp.supervision.state_json import title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def diversity(study: Comparison) -> Picture:
    """Eq. (3) by generation."""
    n = len(study.classes.specialist_names)
    most = 1 - 1 / n

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        curves(axes, study, lambda s: s.diversity)
        axes.axhline(most, color=INK, linewidth=0.7, linestyle=":")
        axes.set_ylim(0, most + 0.05)
        axes.set_ylabel("Behavioural diversity, Eq. (3)")
        legend(figure, axes)

    return picture(
        "diversity",
        "Behavioural diversity by generation",
        f"Mean over runs, bands of ±1 standard deviation; the dotted line is the most that {n}"
        f" classes allow, {n - 1}/{n}.",
        draw,
    )


def classes(study: Comparison) -> Picture:
    """The shares of the exclusive classes, and of the labels beside them."""
    labels = [b for b in study.classes.behaviours if b not in study.classes.specialists.of]
    lines = f"; lines: the labels {' and '.join(labels)}, which any can carry" if labels else ""

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(study.arms), sharey=True, squeeze=False)[0]
        for axes, arm in zip(panels, study.arms, strict=True):
            _classes(axes, arm, study)
            epoch_lines(axes, study)
            axes.set(title=arm.name, xlabel="Generation")
            axes.set_ylim(0, 1)
        panels[0].yaxis.set_major_formatter(lambda v, _: f"{v:.0%}")
        panels[0].set_ylabel("Share of the population")
        legend(figure, panels[0], 6)

    return picture(
        "classes",
        "Diversity by class over generations",
        f"Areas: the exclusive classes of section 2.3.3{lines}. Mean over runs.",
        draw,
        height=3.8,
    )


def _classes(axes: Axes, arm: Arm, study: Comparison) -> None:
    generations, classes = study.generations, study.classes
    sizes = [len(run.records[0].individuals) for run in arm.runs]
    runs = [run.snapshots[:generations] for run in arm.runs]
    base = np.zeros(generations)
    x = np.arange(generations)
    for i, name in enumerate(classes.specialist_names):
        share = np.mean(
            [[s.specialists[name] / n for s in run] for run, n in zip(runs, sizes, strict=True)],
            axis=0,
        )
        how = look(i, PALE)
        axes.fill_between(
            x,
            base,
            base + share,
            facecolor=NEUTRAL if name == classes.specialists.idle else how.colour,
            edgecolor="white",
            linewidth=0.3,
            hatch=how.hatch,
            label=title(name),
        )
        base = base + share
    labels = (name for name in classes.behaviours if name not in classes.specialists.of)
    for k, name in enumerate(labels):
        share = np.mean(
            [
                [shown(name, s, classes) / n for s in run]
                for run, n in zip(runs, sizes, strict=True)
            ],
            axis=0,
        )
        line = LINES[k % len(LINES)]
        axes.plot(x, share, color="white", linewidth=3.4)
        axes.plot(x, share, color=INK, linewidth=1.6, linestyle=line, label=title(name))


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
    """Champions in unseen worlds, by arm and against their fitness in training."""
    yardsticks = [g for g in found if g.seed is None]

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, sharey=True, width_ratios=(2, 3))
        for place, (arm, how) in enumerate(looks(study)):
            mine = [g for g in found if g.arm == arm.name and g.seed is not None]
            if not mine:
                continue
            unseen = [g.unseen for g in mine]
            points: dict[str, Any] = {
                "color": how.colour,
                "marker": how.marker,
                "edgecolor": "white",
            }
            left.scatter(
                sideways(place, len(mine), 0.8), unseen, s=16, linewidth=0.4, alpha=0.8, **points
            )
            mean = mean_interval(unseen)
            left.errorbar(
                place,
                mean.estimate,
                yerr=mean.high - mean.estimate,
                color=INK,
                marker="_",
                markersize=14,
                capsize=4,
                linewidth=1.4,
                zorder=4,
            )
            trained = [g.trained or 0.0 for g in mine]
            right.scatter(trained, unseen, s=22, linewidth=0.4, label=named(arm), **points)
        for axes in (left, right):
            for k, g in enumerate(yardsticks):
                shade, line = (INK, FAINT)[k % 2], LINES[3 - k % 3]
                name = g.arm if axes is right else None
                axes.axhline(g.unseen, color=shade, linestyle=line, linewidth=1.2, label=name)
            thousands(axes)
        left.set_xticks(range(len(study.arms)), [arm.name for arm in study.arms], rotation=20)
        left.set_xlim(-0.6, len(study.arms) - 0.4)
        left.grid(visible=False, axis="x")
        left.set(title="(a) By arm", ylabel="Mean fitness in unseen worlds (points)")
        low, high = right.get_xlim()
        bottom, top = right.get_ylim()
        right.plot([low, high], [low, high], color="#bbbbbb", linewidth=0.9, zorder=0.5)
        right.set_xlim(low, high)
        right.set_ylim(bottom, top)
        right.xaxis.set_major_formatter(lambda v, _: number(v))
        right.set(title="(b) Against training", xlabel="Fitness in training, one episode (points)")
        legend(figure, right, 2)

    return picture(
        "generalisation",
        "Champions on unseen worlds",
        "Each point is a run's champion, its mean over unseen worlds. (a) Points are set apart"
        " sideways by seed; bars: mean over runs with Student's t 95 % interval. (b) On the grey"
        " line it would do as well in unseen worlds as it did in training. Lines across: trees"
        " of the library.",
        draw,
        height=4.2,
    )
