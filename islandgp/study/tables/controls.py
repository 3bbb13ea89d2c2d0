"""What evolution adds to the trees that a supervisor knows."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean

from islandgp.evolution.validation import interval
from islandgp.study.arms import Arm, Comparison
from islandgp.study.generalise import Control, best_of
from islandgp.study.measures import SPANS
from islandgp.study.notation import NONE, number, signed, spread
from islandgp.study.statistics import mean_sd
from islandgp.study.table import Table

HEADINGS = ("Early", "Mid", "Late", "all generations")


def controls_table(study: Comparison, found: Sequence[Control]) -> Table:
    """Highest fitness of each arm, and of the library's trees that nobody evolves."""
    seeds = sorted(found[0].fitness)
    best = {seed: best_of(found, seed) for seed in seeds}
    rows = [_arm(arm, best) for arm in study.arms]
    rows.append(_row("best of the library, not evolved", [best[seed] for seed in seeds]))
    for control in found:
        what = "library" if control.given else "yardstick"
        rows.append(_row(f"{what}: {control.name}", [control.fitness[seed] for seed in seeds]))
    return Table(
        "controls",
        "What evolution adds (points)",
        ("Highest fitness of", *HEADINGS, "paired difference to the best of the library"),
        tuple(rows),
        (
            "Means over runs ± SD of the highest fitness of a generation. A tree that is not"
            " evolved has one episode in each generation's world, under its stage's multipliers."
            " The best of the library is the highest of its trees for targets in each generation."
            " The differences are of all generations' means, seed by seed, with their 95 %"
            " interval (Student's t).",
        ),
    )


def _arm(arm: Arm, best: dict[int, tuple[float, ...]]) -> tuple[str, ...]:
    runs = [run for run in arm.runs if run.seed in best]
    series = [[s.best for s in run.snapshots] for run in runs]
    if not runs or len(runs) < len(arm.runs):
        return _row(arm.name, series or [[]])
    pairs = [fmean(mine) - fmean(best[run.seed]) for run, mine in zip(runs, series, strict=True)]
    mean, low, high = interval(pairs)
    return (*_row(arm.name, series)[:-1], f"{signed(mean)} [{number(low)}, {number(high)}]")


def _row(name: str, series: Sequence[Sequence[float]]) -> tuple[str, ...]:
    """A tree or an arm, by the highest fitness of each generation of each run."""
    whole = [values for values in series if values]
    spans = [[fmean(v[g] for g in span.generations(len(v))) for v in whole] for span in SPANS]
    means = [*spans, [fmean(values) for values in whole]]
    return (name, *(spread(*mean_sd(m)) if m else NONE for m in means), NONE)
