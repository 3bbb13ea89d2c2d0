"""Figure 6: when the first robots of the milestones emerged."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from islandgp.statistics import mean_interval
from islandgp.study.arms import Arm, Comparison
from islandgp.study.emergence import band, first, quantile, ranks, still_without
from islandgp.study.figures import drawing
from islandgp.text import title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Firsts = Sequence[int | None]  # the first generation of each run with the tier, or None

PANELS = 3  # most panels in a row
BANDS = 3  # most arms with distinguishable bands
NUMBERED = 4  # most arms whose bars and boxes have room for numbers
HEIGHT, ROW = 2.9, 0.17  # inches, of the curves, and of a row of numbers below them


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
    strip = max(1.0, 0.1 * n)  # height of the strip "never", in generations
    never_y, top = n - 0.5 + 0.3 * strip, n - 0.5 + strip
    missing = False
    for arm, style, k, at, width in drawing.groups(study, len(tiers)):
        firsts = [first(run, tiers[k]) for run in arm.runs]
        _box(axes, at, box(firsts, never_y), width, style)
        axes.scatter(
            drawing.sideways(at, len(firsts), width),
            [never_y if g is None else g for g in firsts],
            s=16,
            zorder=3,
            label=drawing.named(arm) if k == 0 else None,
            **drawing.dots(style),
        )
        if without := firsts.count(None):
            missing = True
            count = f"{without} of {len(firsts)}" if _numbered(study) else str(without)
            height = n - 0.5 + 0.75 * strip
            axes.text(at, height, count, va="center", ha="center", fontsize=7.5, color=drawing.INK)
    if missing:
        axes.axhspan(n - 0.5, top, color="#f1f1f1", zorder=0)
        beside = axes.get_yaxis_transform()
        axes.text(-0.02, never_y, "never", transform=beside, va="center", ha="right", fontsize=8)
    ticks = MaxNLocator(nbins=8, integer=True).tick_values(0, n - 1)
    axes.set_xlim(-0.5, len(tiers) - 0.5)
    axes.set_ylim(-0.5, top if missing else n)
    axes.set_yticks([t for t in ticks if 0 <= t <= n - 1])
    axes.set_xticks(range(len(tiers)), [study.classes.tier_title(tier) for tier in tiers])
    axes.set(title="(a) First emergence", ylabel="Generation")
    axes.grid(visible=False, axis="x")


def box(firsts: Firsts, never_y: float) -> dict[str, float]:
    """Median, quartiles and extremes over all runs; those among censored runs are at `never_y`."""
    shares = {"whislo": 0.0, "q1": 0.25, "med": 0.5, "q3": 0.75, "whishi": 1.0}
    quantiles = {name: quantile(firsts, share) for name, share in shares.items()}
    return {name: never_y if g is None else g for name, g in quantiles.items()}


def _box(
    axes: Axes, at: float, numbers: dict[str, float], width: float, style: drawing.Style
) -> None:
    axes.bxp(
        [numbers],
        positions=[at],
        widths=width * 0.75,
        showfliers=False,
        patch_artist=True,
        manage_ticks=False,
        boxprops={"facecolor": style.colour, "alpha": 0.3, "edgecolor": style.colour},
        medianprops={"color": drawing.INK, "linewidth": 1.6},
        whiskerprops={"color": style.colour},
        capprops={"color": style.colour},
    )


def _bars(axes: Axes, study: Comparison) -> None:
    tiers = study.milestones
    for arm, style, k, at, width in drawing.groups(study, len(tiers)):
        firsts = [first(run, tiers[k]) for run in arm.runs]
        times = ranks(firsts, study.generations)
        mean = mean_interval(times)
        down, up = max(mean.low, 0.0), min(mean.high, float(study.generations))
        error = [[mean.estimate - down], [up - mean.estimate]]
        drawing.bar(axes, at, mean.estimate, width, error, style)
        if _numbered(study):
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


def _numbered(study: Comparison) -> bool:
    return len(study.arms) <= NUMBERED


def emergence_curves(study: Comparison) -> drawing.Picture:
    """Share of runs in which a tier has emerged, by generation, as in the log-rank test."""
    tiers = study.milestones
    rows, columns = -(-len(tiers) // PANELS), min(PANELS, len(tiers))
    below = ROW * (len(study.arms) + 1)

    def draw(figure: Figure) -> None:
        grid = figure.subplots(
            2 * rows, columns, sharey="row", squeeze=False, height_ratios=(HEIGHT, below) * rows
        )
        for axes in grid.flat:
            axes.set_axis_off()
        for k, tier in enumerate(tiers):
            row, column = divmod(k, columns)
            curves, numbers = grid[2 * row : 2 * row + 2, column]
            curves.set_axis_on()
            for place, (arm, style) in enumerate(drawing.arm_styles(study)):
                firsts = [first(run, tier) for run in arm.runs]
                _curve(curves, study, arm, firsts, style)
                _at_risk(numbers, study.generations - 1, firsts, style.colour, place)
                if not column:
                    name = drawing.plain(arm.name)
                    _beside(numbers, -0.05, place, name, color=style.colour, ha="right")
            curves.set_title(study.classes.tier_title(tier))
            curves.set_xlabel("Generation", loc="right")
            curves.set(xlim=(0, study.generations - 1), ylim=(-0.03, 1.03))
            numbers.set(xlim=(0, study.generations - 1), ylim=(len(study.arms) - 0.5, -1.5))
            _beside(numbers, 0, -1, "Runs still without one", ha="left")
            _beside(numbers, 1.09, -1, "never", ha="center")
        for axes in grid[::2, 0]:
            axes.set_ylabel("Share of runs that have had one")
        drawing.legend(figure, grid[0, 0])

    height = rows * (HEIGHT + below + 0.6) + 0.2 * -(-len(study.arms) // 4)
    return drawing.picture("emergence-curves", draw, height=height, robots=_robots(study))


def _robots(study: Comparison) -> str:
    return f"{' and '.join(map(title, study.milestones))} {study.classes.agent}s"


def _curve(axes: Axes, study: Comparison, arm: Arm, firsts: Firsts, style: drawing.Style) -> None:
    share = [1 - s for s in still_without(firsts, study.generations)]
    x = range(study.generations)
    line: dict[str, Any] = {"where": "post", "color": style.colour}
    if len(study.arms) <= BANDS:
        low, high = zip(*(band(p, len(firsts)) for p in share), strict=True)
        axes.fill_between(x, low, high, step="post", color=style.colour, alpha=0.14, linewidth=0)
        for edge in (low, high):
            axes.step(x, edge, alpha=0.45, linewidth=0.5, **line)
    axes.step(x, share, linestyle=style.line, label=drawing.named(arm), **line)


def _at_risk(axes: Axes, last: int, firsts: Firsts, colour: str, row: int) -> None:
    """The numbers of runs at risk before some generations, and of censored runs."""
    for generation in sorted({round(last * k / 4) for k in range(5)}):
        n = sum(g is None or g >= generation for g in firsts)
        _beside(axes, generation / last, row, str(n), color=colour, ha="center")
    _beside(axes, 1.09, row, str(firsts.count(None)), color=colour, ha="center")


def _beside(axes: Axes, x: float, row: int, text: str, **options: Any) -> None:
    """A text in a row of numbers; x is a share of the axes' width."""
    place = axes.get_yaxis_transform()
    axes.text(x, row, text, transform=place, fontsize=7.5, va="center", **options)
