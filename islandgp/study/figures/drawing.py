"""What several figures draw: curves and bars of the arms, epochs, legends."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from islandgp.scoring.curriculum import Curriculum
from islandgp.scoring.snapshot import Snapshot
from islandgp.study.arms import Arm, Comparison
from islandgp.study.figures.style import INK, Look, looks
from islandgp.study.notation import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def curves(axes: Axes, study: Comparison, of: Callable[[Snapshot], float]) -> None:
    """A number by generation: each arm's mean with a band of ±1 SD over its runs."""
    for arm, how in looks(study):
        _band(axes, arm, how, [[of(s) for s in r.snapshots[: study.generations]] for r in arm.runs])
    epoch_lines(axes, study, stages=True)
    axes.set_xlabel("Generation")


def _band(axes: Axes, arm: Arm, how: Look, rows: Sequence[Sequence[float]]) -> None:
    import numpy as np

    a = np.asarray(rows, float)  # runs x generations
    mean = a.mean(axis=0)
    x = np.arange(a.shape[1])
    if len(a) > 1:
        sd = a.std(axis=0, ddof=1)
        axes.fill_between(x, mean - sd, mean + sd, color=how.colour, alpha=0.16, linewidth=0)
        for edge in (mean - sd, mean + sd):
            axes.plot(x, edge, color=how.colour, alpha=0.45, linewidth=0.6, linestyle=how.line)
    axes.plot(
        x,
        mean,
        color=how.colour,
        linestyle=how.line,
        marker=how.marker,
        markevery=5,
        markersize=4,
        label=named(arm),
    )


def named(arm: Arm) -> str:
    """An arm's label in a legend."""
    return f"{arm.name} (n = {len(arm.runs)})"


def groups(study: Comparison, n: int) -> Iterator[tuple[Arm, Look, int, float, float]]:
    """The arms side by side in each of `n` groups: arm, look, group, place on the x axis, width."""
    width = 0.8 / len(study.arms)
    for i, (arm, how) in enumerate(looks(study)):
        for k in range(n):
            yield arm, how, k, k + (i - (len(study.arms) - 1) / 2) * width, width


def sideways(at: float, n: int, width: float) -> list[float]:
    """Places for `n` points around `at`, in their order, so that they do not hide each other."""
    return [at + ((i + 0.5) / n - 0.5) * width * 0.6 for i in range(n)]


def bar(
    axes: Axes,
    at: float,
    height: float,
    width: float,
    error: float | list[list[float]],
    how: Look,
    label: str | None = None,
) -> None:
    """A bar with whiskers: `error` is their length, or [[down], [up]]."""
    axes.bar(
        at,
        height,
        width * 0.92,
        yerr=error,
        color=how.colour,
        alpha=0.75,
        hatch=how.hatch,
        edgecolor="white",
        error_kw={"ecolor": INK, "capsize": 3, "elinewidth": 1},
        label=label,
    )


def curriculum(study: Comparison) -> Curriculum:
    """The staged training of the first arm."""
    return Curriculum(**study.arms[0].runs[0].config["curriculum"])


def epoch_lines(axes: Axes, study: Comparison, *, stages: bool = False) -> None:
    """Dashed lines where an epoch ends; with `stages`, the curriculum's stages by name on top."""
    plan, n = curriculum(study), study.generations
    starts = [0]
    for g in range(1, n):
        if plan.epoch(g) != plan.epoch(g - 1):
            new_stage = plan.stage(g) != plan.stage(g - 1)
            axes.axvline(
                g - 0.5,
                color="#7d7d7d" if new_stage else "#bdbdbd",
                linestyle=(0, (4, 3)),
                linewidth=0.9 if new_stage else 0.6,
                zorder=0.5,
            )
            if new_stage:
                starts.append(g)
    axes.set_xlim(-0.5, n - 0.5)
    if stages and len(starts) > 1:
        for i, (start, end) in enumerate(zip(starts, [*starts[1:], n], strict=True), 1):
            axes.text(
                (start + end - 1) / 2,
                1.01,
                f"stage {i}",
                transform=axes.get_xaxis_transform(),
                ha="center",
                va="bottom",
                fontsize=8,
                color="#555555",
            )


def legend(figure: Figure, axes: Axes, columns: int = 4) -> None:
    """The legend of a figure's axes below them, where it hides no data."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)


def thousands(axes: Axes) -> None:
    """Ticks such as 30,000 on the y axis."""
    from matplotlib.ticker import FuncFormatter

    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: number(v)))
