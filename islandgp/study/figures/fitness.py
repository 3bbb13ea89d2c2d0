"""Figures 4 and 5, and fitness by component."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from islandgp.study.arms import Arm, Comparison
from islandgp.study.figures.drawing import (
    FAINT,
    INK,
    PALE,
    Picture,
    bar,
    curves,
    epoch_lines,
    groups,
    legend,
    look,
    named,
    picture,
    sideways,
    thousands,
)
from islandgp.study.measures import SPANS, best, span_mean
from islandgp.study.statistics import mean_sd

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def figure_4(study: Comparison) -> Picture:
    """Best fitness by generation."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        curves(axes, study, best)
        axes.set_ylabel("Best fitness of a generation (points)")
        thousands(axes)
        legend(figure, axes)

    return picture(
        "figure-4",
        "Figure 4. Fitness by generation",
        "Highest fitness of each generation: mean over runs, bands of ±1 standard deviation."
        " Dashed lines end an epoch, darker ones a stage of the curriculum.",
        draw,
        height=3.8,
    )


def figure_5(study: Comparison) -> Picture:
    """Best fitness by training stage."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for arm, how, k, at, width in groups(study, len(SPANS)):
            values = [span_mean(run, SPANS[k], best) for run in arm.runs]
            mean, sd = mean_sd(values)
            bar(axes, at, mean, width, sd, how, named(arm) if k == 0 else None)
            axes.scatter(
                sideways(at, len(values), width),
                values,
                s=9,
                marker=how.marker,
                facecolor="white",
                edgecolor=INK,
                linewidth=0.6,
                zorder=3,
            )
        axes.set_xticks(range(len(SPANS)), [p.name(study.generations) for p in SPANS])
        axes.grid(visible=False, axis="x")
        axes.axhline(0, color=FAINT, linewidth=0.8)
        axes.set_ylabel("Mean of the best fitness (points)")
        thousands(axes)
        legend(figure, axes)

    return picture(
        "figure-5",
        "Figure 5. Fitness by training stage",
        "Mean over a stage's generations of the highest fitness; bars: mean over runs, whiskers:"
        " ±1 standard deviation, points: runs.",
        draw,
    )


def components(study: Comparison) -> Picture:
    """Where the best individual's fitness comes from."""

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(study.arms), sharey=True, squeeze=False)[0]
        for axes, arm in zip(panels, study.arms, strict=True):
            _stack(axes, arm, study.generations)
            epoch_lines(axes, study)
            axes.set(title=arm.name, xlabel="Generation")
            thousands(axes)
        panels[0].set_ylabel("Points of the best individual")
        legend(figure, panels[0], 5)

    return picture(
        "components",
        "Fitness by component over generations",
        "The terms of Eq. (1) for the best individual of each generation, mean over runs;"
        " penalties are stacked below zero, the line is their sum.",
        draw,
        height=3.9,
    )


def _stack(axes: Axes, arm: Arm, generations: int) -> None:
    import numpy as np

    names = tuple(arm.runs[0].champion.record.components)
    points = np.mean(
        [
            [[i.components[name] for name in names] for i in run.best[:generations]]
            for run in arm.runs
        ],
        axis=0,
    )  # generations x components
    x = np.arange(generations)
    up, down = np.zeros(generations), np.zeros(generations)
    for k, name in enumerate(names):
        how, column = look(k, PALE), points[:, k]
        positive, negative = column.clip(min=0), column.clip(max=0)
        kind: dict[str, Any] = {
            "facecolor": how.colour,
            "edgecolor": "white",
            "linewidth": 0.3,
            "hatch": how.hatch,
        }
        axes.fill_between(x, up, up + positive, label=name.replace("_", " "), **kind)
        axes.fill_between(x, down, down + negative, **kind)
        up, down = up + positive, down + negative
    axes.plot(x, points.sum(axis=1), color=INK, linewidth=1.4, label="fitness")
    axes.axhline(0, color=INK, linewidth=0.6)
