"""Figures of newcomers' lineages, and of best robots in unseen worlds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from islandgp.gp.population import Origin
from islandgp.statistics import mean_interval
from islandgp.study.arms import Comparison
from islandgp.study.figures import drawing
from islandgp.study.generalise import Generalisation, champions_by_arm
from islandgp.study.lineage import alive, newcomers

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Champions = Mapping[str, Sequence[Generalisation]]  # by arm


def lineage(study: Comparison) -> drawing.Picture | None:
    """Survival of newcomers' lineages; None if no arm has a newcomer."""
    curves: list[tuple[str, int, int, list[float]]] = []
    for i, arm in enumerate(study.arms):
        all_newcomers = [n for run in arm.runs for n in newcomers(run)]
        for k, origin in enumerate((Origin.INJECTED, Origin.RANDOM, Origin.EDITED)):
            of_origin = [n for n in all_newcomers if n.origin == origin]
            if of_origin:
                label = f"{drawing.plain(arm.name)}: {origin.value} (n = {len(of_origin):,})"
                curves.append((label, i, k, alive(of_origin, study.generations - 1)))
    if not curves:
        return None

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for label, i, k, shares in curves:
            style = drawing.nth_style(i)
            axes.plot(
                range(len(shares)),
                shares,
                color=style.colour,
                linestyle=drawing.LINES[(0, 3, 1)[k]],
                label=label,
                **drawing.marks(style),
            )
        axes.set_ylim(0, 1.03)
        axes.set_xlim(left=0)
        axes.yaxis.set_major_formatter(drawing.PERCENT)
        axes.set(xlabel="Generations after it came", ylabel="Share with a living descendant")
        drawing.legend(figure, axes)

    return drawing.picture("lineage", draw, height=3.2 + 0.1 * len(curves))


def generalisation(results: Sequence[Generalisation], study: Comparison) -> drawing.Picture:
    """Best robots in unseen worlds, by arm and against their fitness in training."""
    champions = champions_by_arm(results)

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, sharey=True, width_ratios=(2, 3))
        _by_arm(left, study, champions)
        _against_training(right, study, champions)
        for k, g in enumerate(g for g in results if g.seed is None):
            across: dict[str, Any] = {
                "color": (drawing.INK, drawing.FAINT)[k % 2],
                "linestyle": drawing.LINES[3 - k % 3],
                "linewidth": 1.2,
            }
            left.axhline(g.unseen, **across)
            right.axhline(g.unseen, label=drawing.plain(g.arm), **across)
        left.yaxis.set_major_formatter(drawing.THOUSANDS)
        low, high = right.get_xlim()
        bottom, top = right.get_ylim()
        right.plot([low, high], [low, high], color="#bbbbbb", linewidth=0.9, zorder=0.5)
        right.set(xlim=(low, high), ylim=(bottom, top))
        drawing.legend(figure, right, 2)

    entries = len(study.arms) + sum(g.seed is None for g in results)
    legend = 0.21 * max(0, -(-entries // 2) - 3)
    names = 0 if len(study.arms) <= drawing.MAX_COLUMNS else 1
    return drawing.picture("generalisation", draw, height=4.2 + legend + names)


def _by_arm(axes: Axes, study: Comparison, champions: Champions) -> None:
    for place, (arm, style) in enumerate(drawing.arm_styles(study)):
        unseen = [g.unseen for g in champions.get(arm.name, ())]
        if not unseen:
            continue
        axes.scatter(
            drawing.sideways(place, len(unseen), 0.8),
            unseen,
            s=16,
            alpha=0.8,
            **drawing.dots(style),
        )
        mean = mean_interval(unseen)
        axes.errorbar(
            place,
            mean.estimate,
            yerr=mean.high - mean.estimate,
            color=drawing.INK,
            marker="_",
            markersize=14,
            capsize=4,
            linewidth=1.4,
            zorder=4,
        )
    names = [drawing.plain(arm.name) for arm in study.arms]
    axes.set_xticks(
        range(len(names)), names, rotation=20 if len(names) <= drawing.MAX_COLUMNS else 90
    )
    axes.set_xlim(-0.6, len(study.arms) - 0.4)
    axes.grid(visible=False, axis="x")
    axes.set(title="(a) By arm", ylabel="Mean in unseen worlds (points)")


def _against_training(axes: Axes, study: Comparison, champions: Champions) -> None:
    for arm, style in drawing.arm_styles(study):
        if points := champions.get(arm.name):
            trained, unseen = [g.trained or 0.0 for g in points], [g.unseen for g in points]
            axes.scatter(trained, unseen, s=22, label=drawing.named(arm), **drawing.dots(style))
    axes.xaxis.set_major_formatter(drawing.THOUSANDS)
    axes.set(title="(b) Against training", xlabel="Fitness in training, one episode (points)")
