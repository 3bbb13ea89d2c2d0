"""Figure 6: when Complete and Excellent Robots first emerged."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from islandgp.scoring.classify import Tier
from islandgp.study.arms import Arm, Comparison
from islandgp.study.emergence import Summary, first, ranks, still_without, summary
from islandgp.study.figures.drawing import bar, groups, legend, named, sideways
from islandgp.study.figures.style import INK, Look, Picture, looks, picture
from islandgp.study.statistics import bootstrap

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TIERS: Final = (Tier.COMPLETE, Tier.EXCELLENT)


def figure_6(study: Comparison) -> Picture:
    """Box plots (a) and mean times (b)."""

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, width_ratios=(3, 2))
        _boxes(left, study)
        _bars(right, study)
        legend(figure, left)

    return picture(
        "figure-6",
        "Figure 6. First emergence of Complete and Excellent Robots",
        "(a) Generation of the first one, run by run; boxes: quartiles and median of the runs in"
        " which there was one, whiskers to the extremes; runs without one are drawn in the strip"
        " 'never' and are in no box. (b) Mean number of generations lived through without one;"
        " a run without one counts with the generations it lived (restricted mean); whiskers:"
        " 95 % bootstrap interval.",
        draw,
        height=3.9,
    )


def _boxes(axes: Axes, study: Comparison) -> None:
    top = study.generations + 2.5
    never = False
    for arm, how, k, at, width in groups(study, len(TIERS)):
        firsts = [first(run, TIERS[k]) for run in arm.runs]
        there = [g for g in firsts if g is not None]
        if there:
            _box(axes, at, there, width, how)
        never = never or len(there) < len(firsts)
        axes.scatter(
            sideways(at, len(firsts), width),
            [top if g is None else g for g in firsts],
            s=16,
            marker=how.marker,
            color=how.colour,
            edgecolor="white",
            linewidth=0.4,
            zorder=3,
            label=named(arm) if k == 0 else None,
        )
    if never:
        axes.axhspan(study.generations + 0.5, study.generations + 4.5, color="#f1f1f1", zorder=0)
        axes.text(-0.48, top, "never", va="center", ha="left", fontsize=8, color="#555555")
    axes.set_xlim(-0.5, len(TIERS) - 0.5)
    axes.set_ylim(-1, study.generations + (4.5 if never else 1))
    axes.set_xticks(range(len(TIERS)), [f"{t.value.capitalize()} Robot" for t in TIERS])
    axes.set(title="(a) First emergence", ylabel="Generation")
    axes.grid(visible=False, axis="x")


def _box(axes: Axes, at: float, there: list[int], width: float, how: Look) -> None:
    axes.boxplot(
        [there],
        positions=[at],
        widths=width * 0.75,
        whis=(0, 100),
        patch_artist=True,
        manage_ticks=False,
        boxprops={"facecolor": how.colour, "alpha": 0.3, "edgecolor": how.colour},
        medianprops={"color": INK, "linewidth": 1.6},
        whiskerprops={"color": how.colour},
        capprops={"color": how.colour},
    )


def _bars(axes: Axes, study: Comparison) -> None:
    import numpy as np

    for arm, how, k, at, width in groups(study, len(TIERS)):
        times = ranks([first(run, TIERS[k]) for run in arm.runs], study.generations)
        mean = bootstrap([times], lambda x: np.mean(x, axis=-1))
        error = [[mean.estimate - mean.low], [mean.high - mean.estimate]]
        bar(axes, at, mean.estimate, width, error, how)
        axes.text(
            at,
            0.03,
            f"{mean.estimate:.1f}",
            transform=axes.get_xaxis_transform(),
            ha="center",
            va="bottom",
            fontsize=8,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.2, "alpha": 0.9},
        )
    axes.set_xticks(range(len(TIERS)), [t.value.capitalize() for t in TIERS])
    axes.set_ylim(0, study.generations + 1)
    axes.set(title="(b) Generations without one")
    axes.grid(visible=False, axis="x")


def emergence_curves(study: Comparison) -> Picture:
    """Share of runs that have had one, by generation: the log-rank test's view."""

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(TIERS), sharey=True)
        for axes, tier in zip(panels, TIERS, strict=True):
            for arm, how in looks(study):
                _curve(axes, study, arm, tier, how)
            axes.set(title=f"{tier.value.capitalize()} Robot", xlabel="Generation")
            axes.set_ylim(-0.03, 1.03)
            axes.set_xlim(0, study.generations - 1)
        panels[0].set_ylabel("Share of runs that have had one")
        panels[0].legend(loc="best")

    return picture(
        "emergence-curves",
        "Share of runs with a Complete or Excellent Robot so far",
        "One minus the Kaplan-Meier estimate: every run is watched to the last generation, so a"
        " curve that ends below 1 shows the runs that never had one. This is what the log-rank"
        " test compares.",
        draw,
        height=3.2,
    )


def _curve(axes: Axes, study: Comparison, arm: Arm, tier: Tier, how: Look) -> None:
    firsts = [first(run, tier) for run in arm.runs]
    share = [1 - s for s in still_without(firsts, study.generations)]
    s: Summary = summary(firsts, study.generations)
    axes.step(
        range(study.generations),
        share,
        where="post",
        color=how.colour,
        linestyle=how.line,
        label=f"{arm.name}: {s.emerged} of {s.runs}",
    )
