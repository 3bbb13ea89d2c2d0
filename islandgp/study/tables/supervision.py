"""Supervision: what was decided (section 3.7), and what it cost beside simulation (Table 14)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import accumulate
from statistics import fmean
from typing import Final

from islandgp.study.arms import Arm, Comparison, Run
from islandgp.study.emergence import first, quantile
from islandgp.study.measures import Overhead, overhead
from islandgp.study.paper import MARK, Paper
from islandgp.study.statistics import mean_sd
from islandgp.study.table import NONE, Table, number, percent, spread
from islandgp.study.tables.comparisons import footnotes
from islandgp.supervision.decisions import decisions
from islandgp.supervision.state_json import title

Overheads = Sequence[Overhead]


def decisions_table(study: Comparison) -> Table:
    """Section 3.7: how often each pattern, phase, target and crisis came."""
    each = [decisions(run.guidance for run in arm.runs) for arm in study.arms]
    totals = [d.total for d in each]
    paper = study.paper
    rows: list[tuple[str, ...]] = [("Decisions", *map(number, totals), *_beside(paper, NONE))]
    for heading, kinds in (
        ("Pattern", [d.patterns for d in each]),
        ("Phase", [d.phases for d in each]),
        ("Injected for", [d.targets for d in each]),
    ):
        names = sorted({name for kind in kinds for name in kind})
        rows += [
            (f"{heading}: {_words(name)}", *_shares(name, kinds, totals), *_share(paper, name))
            for name in names
        ]
    rows += [
        (
            f"Crises: {reason}",
            *(f"{d.episodes[reason]} ({d.crises[reason]} generations)" for d in each),
            *_beside(paper, str(paper.crises.get(reason, NONE)) if paper else NONE),
        )
        for reason in ("diversity", "stagnation")
    ]
    rows.append(("Interventions", *(number(d.interventions) for d in each), *_beside(paper, NONE)))
    return Table(
        "decisions",
        "Supervision decisions, all runs together",
        ("Decision", *(arm.name for arm in study.arms), *_beside(paper, MARK)),
        tuple(rows),
        (
            "Shares are of all decisions of the arm. A crisis (Eq. 7) overrides the rate; one that"
            " lasts several generations counts once. An intervention is a decision in which the"
            " supervisor itself says that it has to step in (the expert in the phases crisis"
            " intervention and aggressive exploration); it is no crisis of the run's.",
            *((paper.decisions_note,) if paper and paper.decisions_note else ()),
            *footnotes(paper),
        ),
    )


def _words(name: str) -> str:
    return name.replace("_", " ")


def _beside(paper: Paper | None, cell: str) -> tuple[str, ...]:
    """A cell of the column with published figures, where there is one."""
    return (cell,) if paper else ()


def _share(paper: Paper | None, label: str) -> tuple[str, ...]:
    if paper is None:
        return ()
    return (percent(paper.decisions.get(label)).lstrip("+"),)


def _shares(name: str, kinds: Sequence[Counter[str]], totals: Sequence[int]) -> list[str]:
    """Of all decisions, those without a label included; a dash where an arm names none at all."""
    return [
        percent(kind[name] / total).lstrip("+") if kind else NONE
        for kind, total in zip(kinds, totals, strict=True)
    ]


def overhead_table(study: Comparison) -> Table:
    """One column an arm."""
    each = [[overhead(run) for run in arm.runs] for arm in study.arms]
    rows: list[tuple[str, ...]] = [
        (label, *(value(runs) for runs in each), *_overhead(study.paper, key))
        for label, key, value in _ROWS
    ]
    rows += [
        (
            f"Time to the first {title(tier)} Robot (s)",
            *(_time_to(tier, arm) for arm in study.arms),
            *_beside(study.paper, NONE),
        )
        for tier in study.milestones[:1]
    ]
    return Table(
        "table-14",
        "Table 14. Computational overhead of a run",
        ("Metric", *(arm.name for arm in study.arms), *_beside(study.paper, MARK)),
        tuple(rows),
        (
            "Times are wall-clock seconds on the machine that ran the arms: mean ± SD over runs."
            " The time to a first robot is measured, supervision included, up to the"
            " end of its generation; its median is over all runs, one without it being later than"
            " any.",
            *footnotes(study.paper),
        ),
    )


def _overhead(paper: Paper | None, key: str) -> tuple[str, ...]:
    return _beside(paper, paper.overhead.get(key, NONE) if paper else NONE)


def _spread(value: Callable[[Overhead], float], digits: int = 0) -> Callable[[Overheads], str]:
    return lambda runs: spread(*mean_sd([value(b) for b in runs]), digits)


def _part(runs: Overheads) -> str:
    supervised, simulated = fmean(b.seconds for b in runs), fmean(b.simulation for b in runs)
    return percent(supervised / simulated if simulated else None).lstrip("+")


def _decision(runs: Overheads) -> str:
    decisions = sum(b.decisions for b in runs)
    return f"{sum(b.seconds for b in runs) / decisions:.2g}" if decisions else NONE


def _response(runs: Overheads) -> str:
    requests = sum(b.requests for b in runs)
    return f"{sum(b.latency for b in runs) / requests:.3g}" if requests else NONE


def _dollars(runs: Overheads) -> str:
    known = [b.dollars for b in runs if b.dollars is not None]
    return spread(*mean_sd(known), 4) if len(known) == len(runs) else "price unknown"


_ROWS: Final[tuple[tuple[str, str, Callable[[Overheads], str]], ...]] = (
    ("Decisions", "", _spread(lambda b: b.decisions)),
    ("Requests to a language model", "calls", _spread(lambda b: b.requests, 1)),
    ("Trees injected", "trees", _spread(lambda b: b.injected, 1)),
    ("Fallbacks", "", _spread(lambda b: b.fallbacks, 1)),
    ("Mean response time of a request (s)", "response", _response),
    ("Mean wait for a decision (s)", "", _decision),
    ("Supervision (s)", "supervision", _spread(lambda b: b.seconds, 2)),
    ("Simulation (s)", "simulation", _spread(lambda b: b.simulation, 1)),
    ("Supervision as a share of simulation", "overhead", _part),
    ("Genetic operators (s)", "", _spread(lambda b: b.operators, 2)),
    ("Episodes simulated", "", _spread(lambda b: b.simulated)),
    ("Input tokens", "", _spread(lambda b: b.input_tokens)),
    ("Output tokens", "", _spread(lambda b: b.output_tokens)),
    ("Cost (US dollars)", "", _dollars),
)
"""Label, key of `Paper.overhead`, and how the arms' cells are made."""


def _time_to(tier: str, arm: Arm) -> str:
    times = [_seconds_to(run, tier) for run in arm.runs]
    there = sum(t is not None for t in times)
    middle = quantile(times, 0.5)
    text = "not reached" if middle is None else number(middle, 1)
    return f"median {text}, {there} of {len(times)} runs"


def _seconds_to(run: Run, tier: str) -> float | None:
    generation = first(run, tier)
    if generation is None:
        return None
    spent = list(accumulate(c.evaluation + c.supervision + c.operators for c in run.costs))
    return spent[generation]
