"""Figures 7 and 8: mutation rates, and the pattern of decisions."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from islandgp.study.arms import Arm, Comparison
from islandgp.study.figures.drawing import PALE, Picture, curves, epoch_lines, legend, look, picture
from islandgp.supervision.base import Pattern
from islandgp.supervision.decisions import decisions

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def figure_7(study: Comparison) -> Picture:
    """Mutation rate by generation."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        curves(axes, study, lambda s: s.rate)
        axes.set_ylabel("Mutation rate that made the generation")
        axes.set_ylim(bottom=0)
        legend(figure, axes)

    return picture(
        "figure-7",
        "Figure 7. Mutation rate",
        "The rate in force, a crisis's emergency rate (Eq. 8) included: mean over runs, bands of"
        " ±1 standard deviation. Dashed lines end an epoch.",
        draw,
    )


def figure_8(study: Comparison) -> Picture | None:
    """Patterns of decisions; None when no arm's supervisor names any."""
    named = [arm for arm in study.arms if any(g.pattern for run in arm.runs for g in run.guidance)]
    if not named:
        return None

    def draw(figure: Figure) -> None:
        panels = figure.subplots(len(named), 2, squeeze=False, width_ratios=(1, 2))
        for (left, right), arm in zip(panels, named, strict=True):
            _totals(left, arm)
            _over_time(right, arm, study)
            right.set_title(f"{arm.name}: over generations")
            left.set_title(f"{arm.name}: all decisions")

    return picture(
        "figure-8",
        "Figure 8. Decision patterns",
        "The labels of Table 6 that a supervisor gave to the state of the population: shares of"
        " all decisions, and of the runs after each generation. Arms whose supervisor names no"
        " pattern are not shown.",
        draw,
        height=0.9 + 2.6 * len(named),
    )


def _totals(axes: Axes, arm: Arm) -> None:
    counts = decisions(run.guidance for run in arm.runs)
    for i, pattern in enumerate(Pattern):
        how, share = look(i, PALE), counts.patterns[pattern] / counts.total
        axes.barh(i, share, color=how.colour, hatch=how.hatch, edgecolor="white")
        axes.text(share, i, f" {share:.1%}", va="center", ha="left", fontsize=8)
    axes.set_yticks(range(len(Pattern)), [p.replace("_", " ") for p in Pattern])
    axes.invert_yaxis()
    most = max(counts.patterns.values()) / counts.total
    axes.set_xlim(0, most * 1.35)
    axes.xaxis.set_major_formatter(lambda v, _: f"{v:.0%}")
    axes.set_xlabel("Share of all decisions")
    axes.grid(visible=False, axis="y")


def pattern_shares(arm: Arm, generations: int) -> dict[str, list[float]]:
    """For each pattern, the share of the arm's runs with it after each generation."""
    shares: dict[str, list[float]] = {}
    for run in arm.runs:
        for generation, g in enumerate(run.guidance[:generations]):
            if g.pattern:
                row = shares.setdefault(g.pattern, [0.0] * generations)
                row[generation] += 1 / len(arm.runs)
    return shares


def _over_time(axes: Axes, arm: Arm, study: Comparison) -> None:
    shares = pattern_shares(arm, study.generations)
    x = np.arange(study.generations - 1)
    base = np.zeros(len(x))
    for i, pattern in enumerate(Pattern):
        how = look(i, PALE)
        row = np.asarray(shares.get(pattern, [0.0] * study.generations))[: len(x)]
        axes.bar(
            x,
            row,
            0.95,
            base,
            color=how.colour,
            hatch=how.hatch,
            edgecolor="white",
            linewidth=0.2,
        )
        base = base + row
    epoch_lines(axes, study)
    axes.set_ylim(0, 1)
    axes.yaxis.set_major_formatter(lambda v, _: f"{v:.0%}")
    axes.set(xlabel="Generation", ylabel="Share of the runs")
