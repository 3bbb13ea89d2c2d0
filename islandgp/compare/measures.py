"""Measures of a run: the rows of Tables 9 to 12, first robots, and the costs of Table 14.

`read_runs` makes two frames from the folders of runs, by the names of `records.values`: one of
generations and one of runs. A measure is a column of the second.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from islandgp.compare.arms import Arm, Run
from islandgp.errors import RunError
from islandgp.gp.population import Origin
from islandgp.records.folder import RunFolder
from islandgp.records.values import generation_values, run_values
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import recorded_constraints
from islandgp.text import title

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart

POINTS: Final = "points"


@dataclass(frozen=True, slots=True)
class Span:
    """A part of training in Tables 10 and 12: epochs 1-2, 3-5 and 6-8.

    The paper states generations 1-10, 11-25 and 26-41. Its Tables 9 and 10 are consistent only with
    generations 0-10, 11-25 and 26-40, counted from the initial population (docs/statistics.md),
    which are used here.
    """

    key: str
    after: int  # of 40: the last generation before it
    last: int  # of 40: its last generation

    def generations(self, of: int) -> range:
        """Its generations in a run of `of` generations, with the same shares as in 41."""
        scale = (of - 1) / 40
        return range(_round(self.after * scale) + 1, _round(self.last * scale) + 1)


def _round(x: float) -> int:
    return int(x + 0.5) if x >= 0 else -1


SPANS: Final = (Span("early", -1, 10), Span("mid", 10, 25), Span("late", 25, 40))


@dataclass(frozen=True, slots=True)
class Measure:
    """A number per run: a column of the frame of runs."""

    key: str
    label: str
    unit: str
    emergence: bool = False  # True: a time to emergence; nan is censored
    main: bool = True  # False: not in the families of tests, but adjusted separately


def _by_span(key: str, label: str, unit: str) -> list[Measure]:
    """Measures for the mean of a figure over each part of training."""
    return [Measure(f"{key}_{s.key}", f"{s.key.title()} {label}", unit) for s in SPANS]


MEAN_MAX: Final = Measure("mean_fitness_max", "Mean Max Fitness", POINTS)
FITNESS: Final = (
    Measure("fitness_max", "Max Fitness Ever", POINTS),
    Measure("final_fitness_max", "Final Max Fitness", POINTS),
    MEAN_MAX,
    Measure("final_fitness_mean", "Final Average Fitness", POINTS),
    *_by_span("fitness_max", "max fitness", POINTS),
)
"""Tables 9 and 10; each in points of the run's own rewards and curriculum."""

DIVERSITY: Final = (
    *_by_span("diversity", "diversity", "Eq. (3)"),
    Measure("mean_diversity", "Overall diversity", "Eq. (3)"),
    Measure("mean_rate", "Mean mutation rate", "rate"),
    Measure("mean_overlapping", "Diversity over behaviours that overlap", "Eq. (3)"),
)
"""Table 12; the paper compares these without a test."""

FIRST: Final = "first"
DESCENDANT: Final = "first_descendant"


def emergence(tier: str, agent: str = "Robot") -> Measure:
    """A row of Table 11: the generation of a tier's first robot."""
    return Measure(f"{FIRST}.{tier}", f"First {title(tier)} {agent}", "generation", emergence=True)


def descendant(tier: str, agent: str = "Robot") -> Measure:
    """The generation of a tier's first robot that is not an advised tree."""
    label = f"First {title(tier)} {agent}, advised trees not counted"
    return Measure(f"{DESCENDANT}.{tier}", label, "generation", emergence=True, main=False)


def training_measures(classes: Classes) -> tuple[Measure, ...]:
    """The measures that a run's records have."""
    firsts = [emergence(tier, classes.agent) for tier in classes.milestones]
    others = [descendant(tier, classes.agent) for tier in classes.milestones]
    return (*FITNESS, *firsts, *DIVERSITY, *others)


COSTS: Final = {
    "episodes": "Episodes, with those of the supervisor",
    "decisions": "Decisions of the supervisor",
    "injected": "Trees injected",
    "cost.supervision": "Supervision (s)",
    "cost.evaluation": "Simulation (s)",
    "cost.operators": "Genetic operators (s)",
    "llm.requests": "Requests to a language model",
    "llm.latency_s": "Response times of a language model (s)",
    "llm.input_tokens": "Input tokens",
    "llm.output_tokens": "Output tokens",
    "llm.fallback_rates": "Rates of the fallback",
    "llm.fallback_trees": "Trees of the fallback",
    "llm.cost_usd": "Cost (US dollars; unknown prices left out)",
}
"""Costs of supervision in one run (Table 14): labels by column; those of a model are its last."""


def read_runs(arms: Sequence[Arm]) -> tuple[DataFrame, DataFrame]:
    """The frames of all runs of some arms.

    Returns:
        A row per generation, with its figures, `run` (the path), `arm`, `seed`, `until` (episodes
        so far) and `first_descendant.TIER` (whether an
        individual of the tier is no advised tree); and a row per run, with its figures, `tree`,
        `worlds` (seeds of all that it used) and `origin` (of its best robot).

    Raises:
        RunError: a run is damaged.
    """
    from pandas import DataFrame

    generations, runs = [], []
    for arm in arms:
        for run in arm.runs:
            identity = {"arm": arm.name, "run": str(run.path), "seed": run.seed}
            rows, values = _read(run)
            generations += [{**identity, **row} for row in rows]
            runs.append({**identity, **arm.levels, **values})
    frame = DataFrame(generations)
    frame["until"] = frame.groupby("run")["episodes"].cumsum()
    return frame, DataFrame(runs).set_index("run")


def _read(run: Run) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    folder = RunFolder(run.path)
    summary, constraints = folder.summary(), recorded_constraints(run.config)
    planned = int(run.flat["gp.population"]) * int(run.flat["gp.episodes"])
    lineage, rows, worlds = Ancestry(), list[dict[str, Any]](), set[int]()
    records, costs = list(folder.records()), list(folder.costs())
    if not records or len(costs) != len(records):
        raise RunError(
            f"Expected as many costs as generations in {run.path}, found {len(costs)} and"
            f" {len(records)}; run it again."
        )
    for record, cost in zip(records, costs, strict=True):
        worlds.update(record["worlds"])
        row = generation_values(record, cost, constraints)
        row["episodes"] = cost["episodes"] or planned
        rows.append({**row, **lineage.add(record)})
    champion = summary["champion"]
    worlds.update(champion["chosen_in"], (champion["validation"] or {}).get("worlds", ()))
    values = {
        **run_values(summary),
        "supervisor": str(run.config["supervisor"]["name"]),
        "name": str(run.config["name"]),
        "tree": champion["tree"],
        "origin": lineage.origin_of_best(champion),
        "worlds": worlds,
        **{f"components.{name}": v for name, v in champion["record"]["components"].items()},
    }
    return rows, values


def measured(generations: DataFrame, classes: Classes) -> DataFrame:
    """The values of the measures and costs of each run, all of which have equal generations."""
    from pandas import DataFrame

    runs = generations.groupby("run", sort=False)
    last, n = runs.tail(1).set_index("run"), generations["generation"].max() + 1
    values = {
        "fitness_max": runs["fitness_max"].max(),
        "final_fitness_max": last["fitness_max"],
        "final_fitness_mean": last["fitness_mean"],
        **{
            f"mean_{name}": runs[name].mean()
            for name in ("fitness_max", "diversity", "rate", "overlapping")
        },
    }
    for span in SPANS:
        part = generations[generations["generation"].isin(span.generations(n))].groupby("run")
        values |= {f"{name}_{span.key}": part[name].mean() for name in ("fitness_max", "diversity")}
    for tier in classes.milestones:
        for key, column in ((FIRST, f"tiers.{tier}"), (DESCENDANT, f"{DESCENDANT}.{tier}")):
            reached = generations[generations[column] > 0].groupby("run")
            values[f"{key}.{tier}"] = reached["generation"].min()
    values["decisions"] = runs["source"].count()
    for name in COSTS.keys() & {*generations.columns}:
        values[name] = last[name] if name.startswith("llm.") else runs[name].sum()
    return DataFrame(values)


class Ancestry:
    """Follows the individuals of a run, for what comes from advised trees.

    An advised tree is one that a supervisor injected or edited, and that has not changed since.
    """

    def __init__(self) -> None:
        self._by_id: dict[str, Mapping[str, Any]] = {}
        self._heirs: set[str] = set()  # injected and edited individuals and their descendants

    def add(self, record: Mapping[str, Any]) -> dict[str, bool]:
        """Add a generation; returns by tier whether it has an individual that is not advised."""
        individuals = record["individuals"]
        self._by_id |= {i["id"]: i for i in individuals}
        self._heirs |= {
            i["id"]
            for i in individuals
            if i["origin"] in (Origin.INJECTED, Origin.EDITED)
            or not self._heirs.isdisjoint(i["parents"])
        }
        bred = {tier for i in individuals for tier in i["tiers"] if not advised(self._source(i))}
        return {f"{DESCENDANT}.{tier}": tier in bred for tier in record["snapshot"]["tiers"]}

    def _source(self, i: Mapping[str, Any]) -> Mapping[str, Any]:
        """The individual of which one is an unchanged copy; or itself."""
        while len(i["parents"]) == 1 and not i["mutation"]:
            parent = self._by_id.get(i["parents"][0])
            if parent is None or parent["tree"] != i["tree"]:
                break
            i = parent
        return i

    def origin_of_best(self, champion: Mapping[str, Any]) -> str:
        """The source of a run's best robot; an unchanged copy has that of the original."""
        record = champion["record"]
        i = self._source(self._by_id.get(record["id"], record))
        if advised(i):
            return "injected" if i["origin"] == Origin.INJECTED else "edited by the supervisor"
        if i["id"] in self._heirs:
            return "bred, with an advised ancestor"
        return "a random tree" if i["origin"] == Origin.RANDOM and not i["mutation"] else "bred"


def advised(i: Mapping[str, Any]) -> bool:
    """True for a tree that a supervisor injected or edited, and that was not mutated."""
    if i["origin"] == Origin.EDITED:
        return "+" not in i["mutation"]  # "edit:KIND+OPERATOR" if it was
    return bool(i["origin"] == Origin.INJECTED and not i["mutation"])
