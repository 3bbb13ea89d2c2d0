"""Tables of supervision: decisions (section 3.7), and costs in episodes and time (Table 14)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import accumulate
from typing import Any, Final

from islandgp.statistics import mean_sd
from islandgp.study.arms import Arm, Comparison
from islandgp.study.emergence import first, quantile
from islandgp.study.episodes import episode_cost
from islandgp.study.measures import OVERHEAD
from islandgp.study.table import NONE, Row, Table, labelled, number, percent, spread
from islandgp.study.texts import note
from islandgp.supervision.decisions import decisions

Overheads = Mapping[str, Sequence[Any]]
"""The values of OVERHEAD, by run."""


def decisions_table(study: Comparison) -> Table:
    """Section 3.7: the frequencies of patterns, phases, targets and crises."""
    each = [decisions(run.guidance for run in arm.runs) for arm in study.arms]
    row = partial(_row, study, "Decision")
    rows = [row("Decisions", (number(d.total) for d in each))]
    for heading, kinds in (
        ("Pattern", [d.patterns for d in each]),
        ("Phase", [d.phases for d in each]),
        ("Injected for", [d.targets for d in each]),
    ):
        for name in sorted({name for kind in kinds for name in kind}):
            shares = [
                _share(kind[name] / d.total if kind else None)
                for kind, d in zip(kinds, each, strict=True)
            ]
            rows.append(row(f"{heading}: {name.replace('_', ' ')}", shares))
    for reason in ("diversity", "stagnation"):
        counts = [f"{d.episodes[reason]} ({d.crises[reason]} generations)" for d in each]
        rows.append(row(f"Crises: {reason}", counts))
    rows.append(row("Interventions", (number(d.interventions) for d in each)))
    return Table.of(
        "decisions",
        "Supervision decisions, all runs together",
        rows,
        note("decisions"),
    )


def _share(share: float | None) -> str:
    """A share in percent, or a dash."""
    return percent(share).lstrip("+")


def overhead_table(study: Comparison) -> Table:
    """Table 14, with a column per arm."""
    each = [
        {name: [of(run) for run in arm.runs] for name, of in OVERHEAD.items()} for arm in study.arms
    ]
    row = partial(_row, study, "Metric")
    rows = [row(label, [_cell(o, value, n) for o in each]) for label, value, n in _ROWS]
    tier = study.milestones[0]
    times = (_time_to(tier, arm) for arm in study.arms)
    rows.append(row(f"Time to the first {study.classes.tier_title(tier)} (s)", times))
    heading = "Table 14. Computational overhead of a run"
    return Table.of("table-14", heading, rows, note("overhead"))


def _row(study: Comparison, heading: str, label: str, cells: Iterable[str]) -> Row:
    """A row with a cell for each arm."""
    return labelled(heading, label, study.names, cells)


def _cell(o: Overheads, value: str | Callable[[Overheads], str], digits: int) -> str:
    return spread(*mean_sd(o[value]), digits) if isinstance(value, str) else value(o)


def episodes_table(study: Comparison) -> Table:
    """Costs of a run of each arm in episodes."""
    rows = map(_episodes, study.arms)
    return Table.of("episodes", "Episodes of a run", rows, note("episodes"))


def _episodes(arm: Arm) -> Row:
    cost = episode_cost(arm)
    yield "Arm", arm.name
    yield "generations", number(cost.generations)
    yield "supervisor", number(cost.supervision)
    yield "validation", number(cost.validation)
    yield "in all", number(cost.total)
    yield "library, once", number(cost.library) if cost.library else NONE


def _ratio(a: str, b: str, write: Callable[[float], str]) -> Callable[[Overheads], str]:
    """The ratio of two sums over all runs; a dash if the second is 0."""
    return lambda o: write(sum(o[a]) / sum(o[b])) if sum(o[b]) else NONE


def _dollars(o: Overheads) -> str:
    return "price unknown" if None in o["dollars"] else spread(*mean_sd(o["dollars"]), 4)


_ROWS: Final[tuple[tuple[str, str | Callable[[Overheads], str], int], ...]] = (
    ("Decisions", "decisions", 0),
    ("Requests to a language model", "requests", 1),
    ("Trees injected", "injected", 1),
    ("Fallbacks", "fallbacks", 1),
    (
        "Mean response time of a request (s)",
        _ratio("latency", "requests", "{:.3g}".format),
        0,
    ),
    ("Mean wait for a decision (s)", _ratio("seconds", "decisions", "{:.2g}".format), 0),
    ("Supervision (s)", "seconds", 2),
    ("Simulation (s)", "simulation", 1),
    (
        "Supervision as a share of simulation",
        _ratio("seconds", "simulation", _share),
        0,
    ),
    ("Genetic operators (s)", "operators", 2),
    ("Episodes simulated", "simulated", 0),
    ("Input tokens", "input_tokens", 0),
    ("Output tokens", "output_tokens", 0),
    ("Cost (US dollars)", _dollars, 0),
)
"""Label, name in OVERHEAD or function for the cell, decimals."""


def _time_to(tier: str, arm: Arm) -> str:
    times: list[float | None] = []
    for run in arm.runs:
        spent = list(accumulate(c.evaluation + c.supervision + c.operators for c in run.costs))
        generation = first(run, tier)
        times.append(None if generation is None else spent[generation])
    reached, middle = sum(t is not None for t in times), quantile(times, 0.5)
    text = "not reached" if middle is None else number(middle, 1)
    return f"median {text}, {reached} of {len(times)} runs"
