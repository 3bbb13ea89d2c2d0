"""Table 14: what supervision costs beside simulation, measured (section 3.9)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate
from statistics import fmean
from typing import Final

from islandgp.scoring.classify import Tier
from islandgp.study import paper
from islandgp.study.arms import Arm, Comparison, Run
from islandgp.study.emergence import first, quantile
from islandgp.study.notation import NONE, number, percent, spread
from islandgp.study.overhead import Supervision, supervision
from islandgp.study.paper import MARK
from islandgp.study.statistics import mean_sd
from islandgp.study.table import Table

Bills = Sequence[Supervision]


def overhead_table(study: Comparison) -> Table:
    """One column an arm."""
    each = [[supervision(run) for run in arm.runs] for arm in study.arms]
    rows: list[tuple[str, ...]] = [
        (label, *(value(bills) for bills in each), paper.TABLE_14.get(key, NONE))
        for label, key, value in _ROWS
    ]
    rows.append(
        ("Time to the first Complete Robot (s)", *(_time_to_complete(a) for a in study.arms), NONE)
    )
    return Table(
        "table-14",
        "Table 14. Computational overhead of a run",
        ("Metric", *(arm.name for arm in study.arms), MARK),
        tuple(rows),
        (
            "Times are wall-clock seconds on the machine that ran the arms: mean ± SD over runs."
            " The time to the first Complete Robot is measured, supervision included, up to the"
            " end of its generation; its median is over all runs, one without it being later than"
            " any.",
            paper.NOTE,
        ),
    )


def _spread(value: Callable[[Supervision], float], digits: int = 0) -> Callable[[Bills], str]:
    return lambda bills: spread(*mean_sd([value(b) for b in bills]), digits)


def _share(bills: Bills) -> str:
    supervised, simulated = fmean(b.seconds for b in bills), fmean(b.simulation for b in bills)
    return percent(supervised / simulated if simulated else None).lstrip("+")


def _decision(bills: Bills) -> str:
    decisions = sum(b.decisions for b in bills)
    return f"{sum(b.seconds for b in bills) / decisions:.2g}" if decisions else NONE


def _response(bills: Bills) -> str:
    requests = sum(b.requests for b in bills)
    return f"{sum(b.latency for b in bills) / requests:.3g}" if requests else NONE


def _dollars(bills: Bills) -> str:
    known = [b.dollars for b in bills if b.dollars is not None]
    return spread(*mean_sd(known), 4) if len(known) == len(bills) else "price unknown"


_ROWS: Final[tuple[tuple[str, str, Callable[[Bills], str]], ...]] = (
    ("Decisions", "", _spread(lambda b: b.decisions)),
    ("Requests to a language model", "calls", _spread(lambda b: b.requests, 1)),
    ("Trees injected", "trees", _spread(lambda b: b.injected, 1)),
    ("Fallbacks", "", _spread(lambda b: b.fallbacks, 1)),
    ("Mean response time of a request (s)", "response", _response),
    ("Mean wait for a decision (s)", "", _decision),
    ("Supervision (s)", "supervision", _spread(lambda b: b.seconds, 2)),
    ("Simulation (s)", "simulation", _spread(lambda b: b.simulation, 1)),
    ("Supervision as a share of simulation", "overhead", _share),
    ("Genetic operators (s)", "", _spread(lambda b: b.operators, 2)),
    ("Episodes simulated", "", _spread(lambda b: b.simulated)),
    ("Input tokens", "", _spread(lambda b: b.input_tokens)),
    ("Output tokens", "", _spread(lambda b: b.output_tokens)),
    ("Cost (US dollars)", "", _dollars),
)
"""Label, key of `paper.TABLE_14`, and how the arms' cells are made."""


def _time_to_complete(arm: Arm) -> str:
    times = [_seconds_to(run, Tier.COMPLETE) for run in arm.runs]
    there = sum(t is not None for t in times)
    middle = quantile(times, 0.5)
    text = "not reached" if middle is None else number(middle, 1)
    return f"median {text}, {there} of {len(times)} runs"


def _seconds_to(run: Run, tier: Tier) -> float | None:
    generation = first(run, tier)
    if generation is None:
        return None
    spent = list(accumulate(c.evaluation + c.supervision + c.operators for c in run.costs))
    return spent[generation]
