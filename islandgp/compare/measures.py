"""Measures of a run: the rows of Tables 9 to 12, first robots, and the costs of Table 14."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from operator import attrgetter
from statistics import fmean
from typing import Final

from islandgp.compare.runs import Run
from islandgp.gp.population import Origin
from islandgp.gp.record import IndividualRecord
from islandgp.scoring.classes import Classes
from islandgp.scoring.generation_stats import GenerationStats
from islandgp.text import title

POINTS: Final = "points"


@dataclass(frozen=True, slots=True)
class Span:
    """A part of training in Tables 10 and 12: epochs 1-2, 3-5 and 6-8.

    The paper states generations 1-10, 11-25 and 26-41. Its Tables 9 and 10 are consistent only with
    generations 0-10, 11-25 and 26-40, counted from the initial population (docs/statistics.md),
    which are used here.
    """

    key: str
    label: str
    after: int  # of 40: the last generation before it
    last: int  # of 40: its last generation

    def generations(self, of: int) -> range:
        """Its generations in a run of `of` generations, with the same shares as in 41."""
        scale = (of - 1) / 40
        return range(_round(self.after * scale) + 1, _round(self.last * scale) + 1)


def _round(x: float) -> int:
    return int(x + 0.5) if x >= 0 else -1


SPANS: Final = (
    Span("early", "Early", -1, 10),
    Span("mid", "Mid", 10, 25),
    Span("late", "Late", 25, 40),
)

Value = Callable[[GenerationStats], float]
"""A number of a generation."""


@dataclass(frozen=True, slots=True)
class Measure:
    """A number per run."""

    key: str
    label: str
    unit: str
    of: Callable[[Run], float | None]  # None: censored
    emergence: bool = False  # True: a time to emergence, which may be censored
    main: bool = True  # False: not in the families of tests, but adjusted separately


def _by_span(key: str, label: str, unit: str, value: Value) -> tuple[Measure, ...]:
    """Measures for the mean of a value over each part of training."""

    def measure(span: Span) -> Measure:
        def of(run: Run) -> float:
            inside = [value(run.snapshots[g]) for g in span.generations(len(run.snapshots))]
            return fmean(inside) if inside else float("nan")

        return Measure(f"{key}_{span.key}", f"{span.label} {label}", unit, of)

    return tuple(map(measure, SPANS))


def _mean(key: str, label: str, unit: str, value: Value) -> Measure:
    """A measure for the mean of a value over all generations."""
    return Measure(key, label, unit, lambda run: fmean(map(value, run.snapshots)))


best: Final[Value] = attrgetter("fitness_max")  # highest fitness
diversity: Final[Value] = attrgetter("diversity")  # Eq. (3)
overlapping: Final[Value] = attrgetter("overlapping")
rate: Final[Value] = attrgetter("rate")

MEAN_MAX: Final = _mean("mean_max", "Mean Max Fitness", POINTS, best)
FITNESS: Final = (
    Measure("max_ever", "Max Fitness Ever", POINTS, lambda r: max(map(best, r.snapshots))),
    Measure("final_max", "Final Max Fitness", POINTS, lambda r: r.snapshots[-1].fitness_max),
    MEAN_MAX,
    Measure("final_mean", "Final Average Fitness", POINTS, lambda r: r.snapshots[-1].fitness_mean),
    *_by_span("stage", "max fitness", POINTS, best),
)
"""Tables 9 and 10; each in points of the run's own rewards and curriculum."""

DIVERSITY: Final = (
    *_by_span("diversity", "diversity", "Eq. (3)", diversity),
    _mean("diversity_overall", "Overall diversity", "Eq. (3)", diversity),
    _mean("mutation_rate", "Mean mutation rate", "rate", rate),
    _mean(
        "diversity_overlapping", "Diversity over behaviours that overlap", "Eq. (3)", overlapping
    ),
)
"""Table 12; the paper compares these without a test."""


def first(run: Run, tier: str) -> int | None:
    """The first generation, from 0, with an individual of a tier; None: never."""
    return next((s.generation for s in run.snapshots if s.tiers[tier]), None)


def emergence(tier: str, agent: str = "Robot") -> Measure:
    """A row of Table 11: the generation of a tier's first robot."""
    label = f"First {title(tier)} {agent}"
    return Measure(f"first_{tier}", label, "generation", lambda r: first(r, tier), emergence=True)


def descendant(tier: str, agent: str = "Robot") -> Measure:
    """The generation of a tier's first robot that is not an advised tree."""
    return Measure(
        f"first_{tier}_descendant",
        f"First {title(tier)} {agent}, advised trees not counted",
        "generation",
        lambda run: first_descendant(run, tier),
        emergence=True,
        main=False,
    )


def training_measures(classes: Classes) -> tuple[Measure, ...]:
    """The measures that a run's records have."""
    tiers, agent = classes.milestones, classes.agent
    firsts = (emergence(tier, agent) for tier in tiers)
    return (*FITNESS, *firsts, *DIVERSITY, *(descendant(tier, agent) for tier in tiers))


def first_descendant(run: Run, tier: str) -> int | None:
    """The first generation with an individual of a tier that is not an advised tree; None: never.

    An advised tree is one that a supervisor injected or edited, and that has not changed since.
    """
    by_id = {i.id: i for record in run.records for i in record.individuals}
    for generation, record in enumerate(run.records):
        sources = (original(i, by_id) for i in record.individuals if tier in i.tiers)
        if not all(advised(i) for i in sources):
            return generation
    return None


def advised(i: IndividualRecord) -> bool:
    """True for a tree that a supervisor injected or edited, and that was not mutated."""
    if i.origin == Origin.EDITED:
        return "+" not in i.mutation  # "edit:KIND+OPERATOR" if it was
    return i.origin == Origin.INJECTED and not i.mutation


def original(i: IndividualRecord, by_id: Mapping[str, IndividualRecord]) -> IndividualRecord:
    """The individual of which one is an unchanged copy; or itself."""
    while len(i.parents) == 1 and not i.mutation and i.parents[0] in by_id:
        parent = by_id[i.parents[0]]
        if parent.tree != i.tree:
            break
        i = parent
    return i


def with_advised_ancestor(run: Run) -> set[str]:
    """Ids of the injected and edited individuals, and of their descendants."""
    heirs: set[str] = set()
    for record in run.records:
        heirs |= {
            i.id
            for i in record.individuals
            if i.origin in (Origin.INJECTED, Origin.EDITED) or not heirs.isdisjoint(i.parents)
        }
    return heirs


def episodes_until(run: Run) -> Sequence[int]:
    """Cumulative episodes of a run after each generation, including those from the cache."""
    planned = int(run.flat["gp.population"]) * int(run.flat["gp.episodes"])
    return tuple(accumulate(cost.episodes or planned for cost in run.costs))


def episode_cost(run: Run) -> int:
    """Episodes of a run's generations and of its supervisor."""
    return episodes_until(run)[-1]


def _of_model(*keys: str) -> Callable[[Run], float]:
    """A sum of `supervision.llm.budget` over the run; 0 without a language model."""
    return lambda run: sum(run.costs[-1].llm.get(key, 0) for key in keys)


OVERHEAD: Final[dict[str, tuple[str, Callable[[Run], float | None]]]] = {
    "episodes": ("Episodes, with those of the supervisor", episode_cost),
    "simulated": ("Episodes simulated, not cached", lambda r: sum(c.simulated for c in r.costs)),
    "decisions": ("Decisions of the supervisor", lambda r: len(r.guidance)),
    "injected": ("Trees injected", lambda r: sum(g.injected for g in r.guidance)),
    "seconds": ("Supervision (s)", lambda r: sum(c.supervision for c in r.costs)),
    "simulation": ("Simulation (s)", lambda r: sum(c.evaluation for c in r.costs)),
    "operators": ("Genetic operators (s)", lambda r: sum(c.operators for c in r.costs)),
    "requests": ("Requests to a language model", _of_model("requests")),
    "latency": ("Response times of a language model (s)", _of_model("latency_s")),
    "input_tokens": ("Input tokens", _of_model("input_tokens")),
    "output_tokens": ("Output tokens", _of_model("output_tokens")),
    "fallbacks": ("Fallbacks", _of_model("fallback_rates", "fallback_trees")),
    "dollars": (
        "Cost (US dollars; unknown prices left out)",
        lambda r: r.costs[-1].llm.get("cost_usd") if r.costs[-1].llm else 0.0,
    ),
}
"""Costs of supervision in one run (Table 14): label and value, by column of runs.csv."""
