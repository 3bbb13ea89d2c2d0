"""Figure 6: when the first robots of the milestones emerged."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from islandgp.statistics import mean_interval
from islandgp.study.arms import Comparison
from islandgp.study.emergence import band, first, quantile, ranks, still_without
from islandgp.study.figures import drawing
from islandgp.text import title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Firsts = Sequence[int | None]  # the generation of each run's first one

PANELS = 3  # beside each other
BANDS = 3  # most arms with distinguishable bands
TOP, ROW = -0.27, 0.065  # below the axes, in their heights: numbers at risk, a row for each arm


def figure_6(study: Comparison) -> drawing.Picture:
    """Box plots (a) and mean times (b)."""

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, width_ratios=(3, 2))
        _boxes(left, study)
        _bars(right, study)
        drawing.legend(figure, left)

    return drawing.picture("figure-6", draw, height=3.9, robots=_robots(study))


def _boxes(axes: Axes, study: Comparison) -> None:
    from matplotlib.ticker import MaxNLocator

    n, tiers = study.generations, study.milestones
    strip = max(1.0, 0.1 * n)  # how high the strip 'never' is, in generations
    never, top = n - 0.5 + 0.3 * strip, n - 0.5 + strip
    missing = False
    for arm, how, k, at, width in drawing.groups(study, len(tiers)):
        firsts = [first(run, tiers[k]) for run in arm.runs]
        _box(axes, at, box(firsts, never), width, how)
        axes.scatter(
            drawing.sideways(at, len(firsts), width),
            [never if g is None else g for g in firsts],
            s=16,
            zorder=3,
            label=drawing.named(arm) if k == 0 else None,
            **drawing.dots(how),
        )
        if without := firsts.count(None):
            missing = True
            count = f"{without} of {len(firsts)}"
            height = n - 0.5 + 0.75 * strip
            axes.text(at, height, count, va="center", ha="center", fontsize=7.5, color=drawing.INK)
    if missing:
        axes.axhspan(n - 0.5, top, color="#f1f1f1", zorder=0)
        beside = axes.get_yaxis_transform()
        axes.text(-0.02, never, "never", transform=beside, va="center", ha="right", fontsize=8)
    ticks = MaxNLocator(nbins=8, integer=True).tick_values(0, n - 1)
    axes.set_xlim(-0.5, len(tiers) - 0.5)
    axes.set_ylim(-0.5, top if missing else n)
    axes.set_yticks([t for t in ticks if 0 <= t <= n - 1])
    axes.set_xticks(range(len(tiers)), [study.classes.tier_title(tier) for tier in tiers])
    axes.set(title="(a) First emergence", ylabel="Generation")
    axes.grid(visible=False, axis="x")


def box(firsts: Firsts, never: float) -> dict[str, float]:
    """Median, quartiles and extremes over all runs; one among the runs without is at `never`."""
    shares = {"whislo": 0.0, "q1": 0.25, "med": 0.5, "q3": 0.75, "whishi": 1.0}
    quantiles = {name: quantile(firsts, share) for name, share in shares.items()}
    return {name: never if g is None else g for name, g in quantiles.items()}


def _box(
    axes: Axes, at: float, numbers: dict[str, float], width: float, how: drawing.Style
) -> None:
    axes.bxp(
        [numbers],
        positions=[at],
        widths=width * 0.75,
        showfliers=False,
        patch_artist=True,
        manage_ticks=False,
        boxprops={"facecolor": how.colour, "alpha": 0.3, "edgecolor": how.colour},
        medianprops={"color": drawing.INK, "linewidth": 1.6},
        whiskerprops={"color": how.colour},
        capprops={"color": how.colour},
    )


def _bars(axes: Axes, study: Comparison) -> None:
    tiers = study.milestones
    for arm, how, k, at, width in drawing.groups(study, len(tiers)):
        firsts = [first(run, tiers[k]) for run in arm.runs]
        times = ranks(firsts, study.generations)
        mean = mean_interval(times)
        down, up = max(mean.low, 0.0), min(mean.high, float(study.generations))
        error = [[mean.estimate - down], [up - mean.estimate]]
        drawing.bar(axes, at, mean.estimate, width, error, how)
        axes.text(
            at,
            0.03,
            "never" if firsts.count(None) == len(firsts) else f"{mean.estimate:.1f}",
            transform=axes.get_xaxis_transform(),
            ha="center",
            va="bottom",
            fontsize=8,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.2, "alpha": 0.9},
        )
    axes.set_xticks(range(len(tiers)), map(title, tiers))
    axes.set_ylim(0, study.generations + 1)
    axes.set(title="(b) Without one", ylabel="Generations without one")
    axes.grid(visible=False, axis="x")


def emergence_curves(study: Comparison) -> drawing.Picture:
    """Share of runs that have had one, by generation: the log-rank test's view."""
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    room = 0.03 * max(0, len(study.arms) - 2)  # the layout does not see the rows below the axes
    layout = ConstrainedLayoutEngine(rect=(0, room, 1, 1 - room))

    def draw(figure: Figure) -> None:
        rows = -(-len(study.milestones) // PANELS)
        columns = min(PANELS, len(study.milestones))
        panels = figure.subplots(rows, columns, sharey=True, squeeze=False)
        for axes in panels.flat[len(study.milestones) :]:
            axes.axis("off")
        for axes, tier in zip(panels.flat, study.milestones, strict=False):
            for row, (arm, how) in enumerate(drawing.looks(study)):
                firsts = [first(run, tier) for run in arm.runs]
                _curve(axes, study, arm.name, firsts, how)
                _at_risk(axes, study.generations - 1, firsts, how, row)
            axes.set_title(study.classes.tier_title(tier))
            axes.set_xlabel("Generation", loc="right")
            axes.set_ylim(-0.03, 1.03)
            axes.set_xlim(0, study.generations - 1)
            axes.legend(
                loc="best", facecolor="white", framealpha=0.7, frameon=True, edgecolor="none"
            )
            _below(axes, 0, TOP, "Runs still without one", drawing.INK, ha="left")
        for axes in panels[:, 0]:
            axes.set_ylabel("Share of runs that have had one")

    height = (3.1 + 0.3 * len(study.arms)) * -(-len(study.milestones) // PANELS)
    robots = _robots(study)
    return drawing.picture("emergence-curves", draw, height=height, layout=layout, robots=robots)


def _robots(study: Comparison) -> str:
    return f"{' and '.join(map(title, study.milestones))} {study.classes.agent}s"


def _curve(axes: Axes, study: Comparison, name: str, firsts: Firsts, how: drawing.Style) -> None:
    share = [1 - s for s in still_without(firsts, study.generations)]
    runs, reached = len(firsts), len(firsts) - firsts.count(None)
    x = range(study.generations)
    line: dict[str, Any] = {"where": "post", "color": how.colour}
    if len(study.arms) <= BANDS:
        low, high = zip(*(band(p, runs) for p in share), strict=True)
        axes.fill_between(x, low, high, step="post", color=how.colour, alpha=0.14, linewidth=0)
        for edge in (low, high):
            axes.step(x, edge, alpha=0.45, linewidth=0.5, **line)
    axes.step(
        x, share, linestyle=how.line, label=f"{drawing.plain(name)}: {reached} of {runs}", **line
    )


def _at_risk(axes: Axes, last: int, firsts: Firsts, how: drawing.Style, row: int) -> None:
    """Below the axes: how many runs had none before a tick's generation."""
    for tick in sorted({round(last * k / 4) for k in range(5)}):
        at_risk = sum(g is None or g >= tick for g in firsts)
        _below(axes, tick, TOP - ROW * (row + 1), str(at_risk), how.colour, ha="center")


def _below(axes: Axes, x: float, y: float, text: str, colour: str, *, ha: str) -> None:
    """A text below the axes: x on their scale, y as a share of their height."""
    beside = axes.get_xaxis_transform()
    axes.text(x, y, text, transform=beside, color=colour, fontsize=7.5, ha=ha, va="center")
