"""Figures over generations: Figures 4, 5, 7 and 8, components, diversity and classes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from islandgp.scoring.generation_stats import GenerationStats
from islandgp.statistics import mean_sd
from islandgp.study.arms import Arm, Comparison
from islandgp.study.figures import drawing
from islandgp.study.measures import SPANS, best, diversity, span_mean
from islandgp.supervision.base import Pattern
from islandgp.supervision.decisions import decisions
from islandgp.text import title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def figure_4(study: Comparison) -> drawing.Picture:
    """Best fitness by generation."""
    return drawing.curve_picture(
        "figure-4",
        study,
        best,
        "Best fitness of a generation (points)",
        lambda axes: axes.yaxis.set_major_formatter(drawing.THOUSANDS),
        height=3.8,
    )


def figure_5(study: Comparison) -> drawing.Picture:
    """Best fitness by training stage."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for arm, style, k, at, width in drawing.groups(study, len(SPANS)):
            values = [span_mean(run, SPANS[k], best) for run in arm.runs]
            mean, sd = mean_sd(values)
            drawing.bar(axes, at, mean, width, sd, style, drawing.named(arm) if k == 0 else None)
            axes.scatter(
                drawing.sideways(at, len(values), width),
                values,
                s=9,
                marker=style.marker,
                facecolor="white",
                edgecolor=drawing.INK,
                linewidth=0.6,
                zorder=3,
            )
        axes.set_xticks(range(len(SPANS)), [p.name(study.generations) for p in SPANS])
        axes.grid(visible=False, axis="x")
        axes.axhline(0, color=drawing.FAINT, linewidth=0.8)
        axes.set_ylabel("Mean of the best fitness (points)")
        axes.yaxis.set_major_formatter(drawing.THOUSANDS)
        drawing.legend(figure, axes)

    return drawing.picture("figure-5", draw)


def figure_7(study: Comparison) -> drawing.Picture:
    """Mutation rate by generation."""
    return drawing.curve_picture(
        "figure-7",
        study,
        lambda s: s.rate,
        "Mutation rate that made the generation",
        lambda axes: axes.set_ylim(bottom=0),
    )


def figure_8(study: Comparison) -> drawing.Picture | None:
    """Decision patterns; None if no supervisor classifies them."""
    arms = [arm for arm in study.arms if any(g.pattern for run in arm.runs for g in run.guidance)]
    if not arms:
        return None

    def draw(figure: Figure) -> None:
        rows = figure.subplots(len(arms), 2, squeeze=False, width_ratios=(1, 2))
        for (left, right), arm in zip(rows, arms, strict=True):
            _pattern_totals(left, arm)
            left.set_title(drawing.heading(f"{arm.name}: all decisions", 3))
            _patterns_over_time(right, arm, study)
            right.set_title(drawing.heading(f"{arm.name}: over generations", 3))

    return drawing.picture("figure-8", draw, height=0.9 + 2.6 * len(arms))


def _pattern_totals(axes: Axes, arm: Arm) -> None:
    counts = decisions(run.guidance for run in arm.runs)
    for i, pattern in enumerate(Pattern):
        style, share = drawing.nth_style(i, drawing.PALE), counts.patterns[pattern] / counts.total
        axes.barh(i, share, color=style.colour, hatch=style.hatch, edgecolor="white")
        axes.text(share, i, f" {share:.1%}", va="center", ha="left", fontsize=8)
    axes.set_yticks(range(len(Pattern)), [p.replace("_", " ") for p in Pattern])
    axes.invert_yaxis()
    axes.set_xlim(0, max(counts.patterns.values()) / counts.total * 1.35)
    axes.xaxis.set_major_formatter(drawing.PERCENT)
    axes.set_xlabel("Share of all decisions")
    axes.grid(visible=False, axis="y")


def _patterns_over_time(axes: Axes, arm: Arm, study: Comparison) -> None:
    """Stacked bars: the share of the arm's runs with a pattern after each generation."""
    base = np.zeros(study.generations - 1)
    for i, pattern in enumerate(Pattern):
        style = drawing.nth_style(i, drawing.PALE)
        is_pattern = [[g.pattern == pattern for g in run.guidance[: len(base)]] for run in arm.runs]
        row = np.mean(is_pattern, axis=0)
        axes.bar(
            range(len(base)),
            row,
            0.95,
            base,
            color=style.colour,
            hatch=style.hatch,
            edgecolor="white",
            linewidth=0.2,
        )
        base += row
    drawing.epoch_lines(axes, study)
    axes.set_ylim(0, 1)
    axes.yaxis.set_major_formatter(drawing.PERCENT)
    axes.set(xlabel="Generation", ylabel="Share of the runs")


def components(study: Comparison) -> drawing.Picture:
    """Fitness of the best individual by component."""

    def fill(axes: Axes, arm: Arm) -> None:
        names = tuple(arm.runs[0].champion.record.components)
        points = np.mean(
            [
                [[i.components[name] for i in run.best[: study.generations]] for name in names]
                for run in arm.runs
            ],
            axis=0,
        )  # components x generations
        drawing.stack(axes, points.clip(min=0), [name.replace("_", " ") for name in names])
        drawing.stack(axes, points.clip(max=0))
        axes.plot(points.sum(axis=0), color=drawing.INK, linewidth=1.4, label="fitness")
        axes.axhline(0, color=drawing.INK, linewidth=0.6)
        axes.yaxis.set_major_formatter(drawing.THOUSANDS)

    label = "Points of the best individual"
    return drawing.panel_picture("components", study, fill, label, height=3.9, columns=5)


def diversity_by_generation(study: Comparison) -> drawing.Picture:
    """Eq. (3) by generation."""
    n = len(study.classes.specialist_names)
    most = 1 - 1 / n

    def dress(axes: Axes) -> None:
        axes.axhline(most, color=drawing.INK, linewidth=0.7, linestyle=":")
        axes.set_ylim(0, most + 0.05)

    label = "Behavioural diversity, Eq. (3)"
    return drawing.curve_picture("diversity", study, diversity, label, dress, n=n, most=n - 1)


def archive_by_generation(study: Comparison) -> drawing.Picture:
    """Coverage and QD score of the archives, which must have the same grid."""

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        for arm, style in drawing.arm_styles(study):
            runs = [run.archives[: study.generations] for run in arm.runs]
            x = range(study.generations)
            drawing.band(left, arm, style, x, [[a.coverage for a in run] for run in runs])
            drawing.band(right, arm, style, x, [[a.qd_score for a in run] for run in runs])
        left.set(title="(a)", ylabel="Coverage")
        left.yaxis.set_major_formatter("{x:.1%}")
        right.set(title="(b)", ylabel="QD score (points)")
        right.yaxis.set_major_formatter(drawing.THOUSANDS)
        for axes in (left, right):
            drawing.epoch_lines(axes, study)
            axes.set(xlabel="Generation")
            axes.set_ylim(bottom=0)
        drawing.legend(figure, left)

    return drawing.picture("archive", draw)


def classes(study: Comparison) -> drawing.Picture:
    """The shares of the exclusive classes and of the labels."""
    exclusive = study.classes.specialists
    labels = [name for name in study.classes.behaviours if name not in exclusive.of]

    def fill(axes: Axes, arm: Arm) -> None:
        names = list(study.classes.specialist_names)
        shares = _shares(arm, study.generations, names, lambda s: s.specialists)
        idle = names.index(exclusive.idle)
        drawing.stack(axes, shares, list(map(title, names)), neutral=idle)
        shares = _shares(arm, study.generations, labels, lambda s: s.behaviour_counts)
        for k, (name, share) in enumerate(zip(labels, shares, strict=True)):
            line = drawing.LINES[k % len(drawing.LINES)]
            axes.plot(share, color="white", linewidth=3.4)
            axes.plot(share, color=drawing.INK, linewidth=1.6, linestyle=line, label=title(name))
        axes.set_ylim(0, 1)
        axes.yaxis.set_major_formatter(drawing.PERCENT)

    lines = f"; lines: the labels {' and '.join(labels)}, which any can carry" if labels else ""
    label = "Share of the population"
    return drawing.panel_picture("classes", study, fill, label, height=3.8, columns=6, lines=lines)


def _shares(
    arm: Arm,
    generations: int,
    names: Sequence[str],
    counts: Callable[[GenerationStats], Mapping[str, int]],
) -> Any:
    """Shares of the population, names x generations: means over an arm's runs."""
    shares = [
        [
            [counts(r.snapshot)[name] / len(r.individuals) for r in run.records[:generations]]
            for name in names
        ]
        for run in arm.runs
    ]
    return np.mean(shares, axis=0)
