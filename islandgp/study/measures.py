"""Measures of a run: the rows of Tables 9 to 11, diversity (Table 12), overhead (Table 14).

The overhead is the cost of supervision, from the run's costs and records (section 3.9).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from operator import attrgetter
from statistics import fmean
from typing import Final

from islandgp.scoring.classes import Classes
from islandgp.scoring.generation_stats import GenerationStats
from islandgp.study.arms import Comparison, Run
from islandgp.study.emergence import first
from islandgp.study.lineage import first_descendant
from islandgp.text import title


@dataclass(frozen=True, slots=True)
class Span:
    """A part of training in Tables 10 and 12: epochs 1-2, 3-5 and 6-8.

    The paper states generations 1-10, 11-25 and 26-41. Its Tables 9 and 10 are consistent only with
    generations 0-10, 11-25 and 26-40, counted from the initial population (docs/study.md), which
    are used here.
    """

    key: str
    label: str
    after: int  # of 40: the last generation before it
    last: int  # of 40: its last generation

    def generations(self, of: int) -> range:
        """Its generations in a run of `of` generations, with the same shares as in 41."""
        scale = (of - 1) / 40
        return range(_round(self.after * scale) + 1, _round(self.last * scale) + 1)

    def name(self, of: int) -> str:
        """Its name in a table of runs of `of` generations."""
        inside = self.generations(of)
        return f"{self.label} (Gen {inside.start}-{inside.stop - 1})"


def _round(x: float) -> int:
    return int(x + 0.5) if x >= 0 else -1


SPANS: Final = (
    Span("early", "Early", -1, 10),
    Span("mid", "Mid", 10, 25),
    Span("late", "Late", 25, 40),
)


@dataclass(frozen=True, slots=True)
class Measure:
    """A number per run."""

    key: str
    label: str
    unit: str
    of: Callable[[Run], float | None]  # None: censored
    emergence: bool = False  # True: a time to emergence, which may be censored


Value = Callable[[GenerationStats], float]
"""A number of a generation."""

best: Final[Value] = attrgetter("best")  # highest fitness
diversity: Final[Value] = attrgetter("diversity")  # Eq. (3)


def span_mean(run: Run, span: Span, value: Value) -> float:
    """The mean of a value over a span's generations; nan if the run has none of them."""
    snapshots = run.snapshots
    inside = [value(snapshots[g]) for g in span.generations(len(snapshots))]
    return fmean(inside) if inside else float("nan")


def _by_span(key: str, label: str, unit: str, value: Value) -> tuple[Measure, ...]:
    """Measures for the mean of a value over each part of training."""

    def measure(span: Span) -> Measure:
        name = f"{span.label} {label}"
        return Measure(f"{key}_{span.key}", name, unit, lambda run: span_mean(run, span, value))

    return tuple(map(measure, SPANS))


def _mean(key: str, label: str, unit: str, value: Value) -> Measure:
    """A measure for the mean of a value over all generations."""
    return Measure(key, label, unit, lambda run: fmean(map(value, run.snapshots)))


MEAN_MAX: Final = _mean("mean_max", "Mean Max Fitness", "points", best)
TABLE_9: Final = (
    Measure("max_ever", "Max Fitness Ever", "points", lambda r: max(map(best, r.snapshots))),
    Measure("final_max", "Final Max Fitness", "points", lambda r: r.snapshots[-1].best),
    MEAN_MAX,
    Measure("final_mean", "Final Average Fitness", "points", lambda r: r.snapshots[-1].mean),
)
TABLE_10: Final = _by_span("stage", "max fitness", "points", best)


def emergence(tier: str, agent: str = "Robot") -> Measure:
    """A row of Table 11: the generation of a tier's first robot."""
    return Measure(
        f"first_{tier}",
        f"First {title(tier)} {agent}",
        "generation",
        lambda run: first(run, tier),
        emergence=True,
    )


def descendant(tier: str, agent: str = "Robot") -> Measure:
    """The generation of a tier's first robot that is not an advised tree."""
    return Measure(
        f"first_{tier}_descendant",
        f"First {title(tier)} {agent}, advised trees not counted",
        "generation",
        lambda run: first_descendant(run, tier),
        emergence=True,
    )


TABLE_12: Final = (
    *_by_span("diversity", "diversity", "Eq. (3)", diversity),
    _mean("diversity_overall", "Overall diversity", "Eq. (3)", diversity),
)
MUTATION: Final = _mean("mutation_rate", "Mean mutation rate", "rate", attrgetter("rate"))
OVERLAPPING: Final = _mean(
    "diversity_overlapping",
    "Diversity over behaviours that overlap",
    "Eq. (3)",
    attrgetter("overlapping"),
)
UNTESTED_IN_PAPER: Final = (*TABLE_12, OVERLAPPING, MUTATION)
"""Measures that the paper compares without a test; here they form a family of tests."""


def main_family(milestones: Sequence[str], agent: str = "Robot") -> tuple[Measure, ...]:
    """The measures of Tables 9 to 11: one family of tests, of nine in the paper."""
    return (*TABLE_9, *TABLE_10, *(emergence(tier, agent) for tier in milestones))


def all_measures(study: Comparison) -> tuple[Measure, ...]:
    """Every measure of a report, in its order."""
    agent = study.classes.agent
    descendants = (descendant(tier, agent) for tier in study.milestones)
    return (*main_family(study.milestones, agent), *UNTESTED_IN_PAPER, *descendants)


def examined(study: Comparison, requested: Collection[str]) -> tuple[Measure, ...]:
    """The tested measures: all, but those of `descendant` only on request."""
    optional = {descendant(tier).key for tier in study.milestones} - set(requested)
    return tuple(m for m in all_measures(study) if m.key not in optional)


def individuals_with(behaviour: str, s: GenerationStats, classes: Classes) -> int:
    """Table 13: individuals of a behaviour's exclusive class, or with its label if it has none."""
    return (s.specialists if behaviour in classes.specialists.of else s.behaviour_counts)[behaviour]


def _of_model(key: str) -> Callable[[Run], float]:
    """A sum of `supervision.llm.budget` over the run; 0 without a language model."""
    return lambda run: run.costs[-1].llm.get(key, 0)


OVERHEAD: Final[dict[str, Callable[[Run], float | None]]] = {
    "decisions": lambda r: len(r.guidance),  # generations after which a supervisor was asked
    "injected": lambda r: sum(g.injected for g in r.guidance),  # trees put into a population
    "seconds": lambda r: sum(c.supervision for c in r.costs),  # that the run waited for decisions
    "simulation": lambda r: sum(c.evaluation for c in r.costs),  # s
    "operators": lambda r: sum(c.operators for c in r.costs),  # s, everything else in the loop
    "simulated": lambda r: sum(c.simulated for c in r.costs),  # episodes, without the cache
    "requests": _of_model("requests"),  # retries and repairs included
    "latency": _of_model("latency_s"),  # s, all requests together
    "input_tokens": _of_model("input_tokens"),
    "output_tokens": _of_model("output_tokens"),
    # Rates and trees that came from the fallback instead.
    "fallbacks": lambda r: _of_model("fallback_rates")(r) + _of_model("fallback_trees")(r),
    # US dollars; None: the model has no known price.
    "dollars": lambda r: r.costs[-1].llm.get("cost_usd") if r.costs[-1].llm else 0.0,
}
"""Costs of supervision in one run, by the columns of runs.csv."""
