"""Tables 11, 13 and 14 with one column or row for each arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate
from statistics import fmean
from typing import Final

from islandgp.scoring.classify import Tier
from islandgp.scoring.state import Snapshot
from islandgp.study import paper
from islandgp.study.arms import Arm, Comparison, Run
from islandgp.study.emergence import first
from islandgp.study.notation import NONE, number, percent, spread
from islandgp.study.overhead import Supervision, supervision
from islandgp.study.paper import MARK
from islandgp.study.statistics import mean_sd
from islandgp.study.table import Table

SPECIALISTS: Final[dict[str, Callable[[Snapshot], int]]] = {
    "pickup": lambda s: s.specialists["pickup"],
    "humanoid": lambda s: s.specialists["humanoid"],
    "charging": lambda s: s.charging,
    "clearing": lambda s: s.clearing,
}
"""The rows of Table 13: two classes and two labels."""


def runs_table(study: Comparison) -> Table:
    """Table 11: the generation of the first Complete and Excellent Robot in each run."""
    tiers = (Tier.COMPLETE, Tier.EXCELLENT)
    seeds = sorted({seed for arm in study.arms for seed in arm.seeds})
    rows = [
        (str(seed), *(_firsts(arm, seed, tier) for arm in study.arms for tier in tiers))
        for seed in seeds
    ]
    columns = [f"{arm.name}: {tier.value}" for arm in study.arms for tier in tiers]
    theirs = [
        f"{MARK} {who}: {tier}"
        for who in ("proposed", "baseline")
        for tier in ("complete", "excellent")
    ]
    complete, excellent = paper.TABLE_11["first_complete"], paper.TABLE_11["first_excellent"]
    printed = list(zip(complete[0], excellent[0], complete[1], excellent[1], strict=True))
    padded = [*(tuple(map(str, row)) for row in printed), *[("",) * 4] * len(rows)]
    return Table(
        "table-11-runs",
        "Table 11. Generation of the first Complete and the first Excellent Robot, run by run",
        ("Seed", *columns, *theirs),
        tuple((*row, *beside) for row, beside in zip(rows, padded, strict=False)),
        (
            "Generations count from 0, the initial population. 'never': none up to the last"
            f" generation, {study.generations - 1}; such a run is censored, not dropped.",
            "The paper's five runs stand beside the first rows in its order; they share nothing"
            " with the seeds there.",
            paper.NOTE,
        ),
    )


def _firsts(arm: Arm, seed: int, tier: Tier) -> str:
    found = [first(run, tier) for run in arm.runs if run.seed == seed]
    return ", ".join("never" if g is None else str(g) for g in found) or NONE


def specialists_table(study: Comparison) -> Table:
    """Table 13: how many individuals show a behaviour, over all generations of all runs."""
    rows = []
    for name, count in SPECIALISTS.items():
        cells = [name.capitalize()]
        for arm in study.arms:
            counts = [count(s) for run in arm.runs for s in run.snapshots]
            mean, sd = mean_sd(counts)
            cells += [spread(mean, sd, 1), f"{min(counts)}–{max(counts)}"]
        mean, sd, (low, high) = paper.TABLE_13[name]
        rows.append((*cells, spread(mean, sd, 1), f"{low}–{high}"))
    columns = [f"{arm.name}{what}" for arm in study.arms for what in (" mean ± SD", " range")]
    sizes = " and ".join(
        sorted({str(run.flat.get("gp.population")) for arm in study.arms for run in arm.runs})
    )
    return Table(
        "table-13",
        f"Table 13. Specialists in a population of {sizes}",
        ("Type", *columns, f"{MARK} mean ± SD", f"{MARK} range"),
        tuple(rows),
        (
            "Pickup and humanoid specialists are exclusive classes; charging and clearing are"
            " labels that any individual can carry. SD over all generations of all runs.",
            paper.NOTE,
        ),
    )


def overhead_table(study: Comparison) -> Table:
    """Table 14: what supervision costs beside simulation, measured."""
    each = [[supervision(run) for run in arm.runs] for arm in study.arms]
    beside = iter(paper.TABLE_14.values())
    rows: list[tuple[str, ...]] = []
    for label, value in _OVERHEAD:
        theirs = next(beside, NONE) if len(rows) < len(paper.TABLE_14) else NONE
        rows.append((label, *(value(runs) for runs in each), theirs))
    rows.append(
        ("Time to the first Complete Robot (s)", *(_time_to_complete(a) for a in study.arms), NONE)
    )
    return Table(
        "table-14",
        "Table 14. Computational overhead, a run",
        ("Metric", *(arm.name for arm in study.arms), MARK),
        tuple(rows),
        (
            "Times are wall-clock seconds on the machine that ran the arms: mean ± SD over runs."
            " The time to the first Complete Robot is measured, supervision included, up to the"
            " end of its generation; runs without one are counted, not averaged.",
            paper.NOTE,
        ),
    )


def _spread(value: Callable[[Supervision], float], digits: int) -> Callable[..., str]:
    return lambda runs: spread(*mean_sd([value(s) for s in runs]), digits)


def _share(runs: Sequence[Supervision]) -> str:
    supervised, simulated = fmean(s.seconds for s in runs), fmean(s.simulation for s in runs)
    return percent(supervised / simulated if simulated else None).lstrip("+")


def _response(runs: Sequence[Supervision]) -> str:
    decisions = sum(s.decisions for s in runs)
    return f"{sum(s.seconds for s in runs) / decisions:.3g} s" if decisions else NONE


def _dollars(runs: Sequence[Supervision]) -> str:
    known = [s.dollars for s in runs if s.dollars is not None]
    return f"{fmean(known):.4f}" if len(known) == len(runs) else NONE


_OVERHEAD: Final[tuple[tuple[str, Callable[[Sequence[Supervision]], str]], ...]] = (
    ("Decisions", _spread(lambda s: s.decisions, 1)),
    ("Trees injected", _spread(lambda s: s.injected, 1)),
    ("Mean time of a decision", _response),
    ("Supervision (s)", _spread(lambda s: s.seconds, 2)),
    ("Simulation (s)", _spread(lambda s: s.simulation, 1)),
    ("Supervision as a share of simulation", _share),
    ("Genetic operators (s)", _spread(lambda s: s.operators, 2)),
    ("Episodes simulated", _spread(lambda s: s.simulated, 0)),
    ("Cost (US dollars)", _dollars),
)
"""The rows; the first six are the paper's, in the order of `paper.TABLE_14`."""


def _time_to_complete(arm: Arm) -> str:
    times = [t for run in arm.runs if (t := _seconds_to(run, Tier.COMPLETE)) is not None]
    if not times:
        return f"never in {len(arm.runs)} runs"
    left = len(arm.runs) - len(times)
    return spread(*mean_sd(times), 1) + (f" (never in {left} runs)" if left else "")


def _seconds_to(run: Run, tier: Tier) -> float | None:
    generation = first(run, tier)
    if generation is None:
        return None
    spent = list(accumulate(c.evaluation + c.supervision + c.operators for c in run.costs))
    return spent[generation]
