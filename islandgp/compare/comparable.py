"""Checks that arms are comparable: that they differ only in the studied settings."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from textwrap import shorten
from typing import TYPE_CHECKING, Any, Final

from islandgp.compare.arms import Arm, Run, in_short
from islandgp.compare.measures import measured, read_runs
from islandgp.errors import StudyError
from islandgp.gp.plan import is_read
from islandgp.plain import flatten
from islandgp.records.parameters import TASK, runtime_keys, short_key
from islandgp.scoring.classes import Classes

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart

VARIED_GROUPS: Final = frozenset({"supervisor"})
"""The group in which arms may always differ (section 3.1)."""

REPLACEABLE_GROUPS: Final = TASK - {"domain"} | {"library", "search"}
"""Groups that may differ as a whole if every selection names a key of the group."""

BUDGET: Final = frozenset({"gp.population", "gp.generations", "gp.episodes", "gp.shared_seed"})
"""Keys of the budget, in which arms must not differ."""

START: Final = (BUDGET - {"gp.generations"}) | {"gp.reseed_every", "gp.max_depth", "gp.max_nodes"}
"""Keys that affect the initial population and seeds of worlds, besides the seed and `gp.trees`."""

MIN_GENERATIONS: Final = 4  # least number of generations, so that no stage of Table 10 is empty

UNEQUAL: Final = 0.05  # least share by which costs are unequal

MAX_KEYS: Final = 3  # most settings in the label of a task


@dataclass(frozen=True, slots=True)
class Task:
    """World, rewards, last stage of the curriculum and classes of some arms."""

    label: str  # the settings in which it differs from the others, or its arms
    arms: tuple[str, ...]
    run: Run  # one with this task


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Arms to compare, with warnings about confounded settings."""

    arms: tuple[Arm, ...]
    tasks: tuple[Task, ...]  # the distinct ones, in the order of the arms
    runs: DataFrame  # of `read_runs`, with measures; indexed by the path
    generations: DataFrame  # of `read_runs`, as many for each run
    comparability_warnings: tuple[str, ...]  # differences that make the comparison doubtful
    notes: tuple[str, ...]  # further notes for the reader

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the arms."""
        return tuple(arm.name for arm in self.arms)

    @property
    def classes(self) -> Classes:
        """The first arm's classes; behaviours and tiers have the same names in all arms."""
        return self.arms[0].runs[0].classes

    @property
    def pairs(self) -> tuple[tuple[Arm, Arm], ...]:
        """All pairs, in the order in which the arms were given."""
        return tuple(combinations(self.arms, 2))

    @property
    def horizon(self) -> int:
        """Number of generations of each run."""
        return int(self.generations["generation"].max()) + 1

    @property
    def same_training(self) -> bool:
        """True if points of training are comparable: all arms have one task and curriculum."""
        configs = [arm.runs[0].config for arm in self.arms]
        return all(config[group] == configs[0][group] for config in configs for group in TASK)

    def of_arm(self, name: str) -> DataFrame:
        """The runs of an arm."""
        return self.runs[self.runs["arm"] == name]


def compare_arms(
    arms: Sequence[Arm], *, force: bool = False, notes: Sequence[str] = ()
) -> Comparison:
    """Makes a comparison of arms; generations after the end of the shortest run are left out.

    Args:
        arms: two or more, of different names.
        force: turn differences that make a comparison doubtful from an error into warnings.
        notes: further notes for the report.

    Returns:
        The comparison.

    Raises:
        StudyError: fewer than two arms, equal names, a run in two arms, runs that are too
            short or of two domains; or the arms are not comparable and `force` is not set.
        RunError: a run is damaged.
    """
    _check(arms)
    settings = _settings(arms)
    warnings, intended = [*_inside(arms, settings)], list[str]()
    for key, values in _differences(arms, settings):
        if _may_differ(key, [arm.keys for arm in arms]):
            intended.append(f"The arms differ in {key}: {values}.")
        else:
            warnings.append(f"{key} differs: {values}")
    if not all({*a.seeds} & {*b.seeds} for a, b in combinations(arms, 2)):
        each = "; ".join(f"{arm.name} {in_short(sorted(set(arm.seeds)))}" for arm in arms)
        warnings.append(f"two arms share no seed: {each}")
    if warnings and not force:
        raise StudyError(
            "Expected arms that differ only in what is studied, found:\n  "
            + "\n  ".join(shorten(line, width=400, placeholder=" ...") for line in warnings)
            + "\nSelect other runs, set these keys alike in all arms (the curriculum of a search by"
            " curriculum.last_only=true), or use --force, which lists them in the report."
        )
    generations, runs = read_runs(arms)
    lengths = generations.groupby("run")["generation"].count()
    horizon, longest = int(lengths.min()), int(lengths.max())
    if horizon < MIN_GENERATIONS:
        raise StudyError(
            f"Expected runs of at least {MIN_GENERATIONS} generations, found {horizon}; early, mid"
            " and late training need one each."
        )
    if longest > horizon:
        notes = (
            f"The runs have {horizon} to {longest} generations; measures of training end with"
            f" generation {horizon - 1}, the last one of the shortest run.",
            *notes,
        )
    generations = generations[generations["generation"] < horizon]
    values = measured(generations, arms[0].runs[0].classes)
    runs = runs.drop(columns=values.columns, errors="ignore").join(values)
    tasks = _tasks(arms)
    labels = {name: task.label for task in tasks for name in task.arms}
    runs.insert(2, "task", runs["arm"].map(labels))
    further = (*_pairs(arms), *_costs(runs), *notes)
    return Comparison(
        arms=tuple(arms),
        tasks=tasks,
        runs=runs,
        generations=generations,
        comparability_warnings=tuple(warnings),
        notes=(*intended, *further),
    )


def _tasks(arms: Sequence[Arm]) -> tuple[Task, ...]:
    """The distinct tasks of arms, labelled by what differs, or by their arms if that is much."""
    by_text: dict[str, list[Arm]] = {}
    for arm in arms:
        config = {group: arm.runs[0].config[group] for group in sorted(TASK)}
        last = config["curriculum"]["stages"][-1]  # in which best robots are tested
        config["curriculum"] = {key: value for key, value in last.items() if key != "epochs"}
        by_text.setdefault(json.dumps(config, sort_keys=True, default=str), []).append(arm)
    flats = [flatten(json.loads(text)) for text in by_text]
    keys = {key for flat in flats for key in flat if len({str(f.get(key)) for f in flats}) > 1}
    tasks = []
    for flat, members in zip(flats, by_text.values(), strict=True):
        names = tuple(arm.name for arm in members)
        settings = [f"{short_key(key, keys)}={flat.get(key)}" for key in sorted(keys)]
        label = " ".join(settings) if 0 < len(settings) <= MAX_KEYS else " and ".join(names)
        tasks.append(Task(label, names, members[0].runs[0]))
    return tuple(tasks)


def shared_seeds(first: Arm, second: Arm) -> tuple[int, ...]:
    """The seeds whose runs are pairs: one run in each arm, with the same start.

    Runs with the same seed and start have the same initial population and seeds of worlds.
    """
    a, b = (
        {run.seed: run for run in arm.runs if arm.seeds.count(run.seed) == 1}
        for arm in (first, second)
    )
    return tuple(seed for seed in sorted({*a} & {*b}) if _start(a[seed]) == _start(b[seed]))


def _start(run: Run) -> dict[str, Any]:
    return {k: v for k, v in run.flat.items() if k in START or k.startswith("gp.trees.")}


def _pairs(arms: Sequence[Arm]) -> Iterator[str]:
    """Notes on pairs of arms that share only some of their seeds."""
    for a, b in combinations(arms, 2):
        shared = {*shared_seeds(a, b)}
        alone = [(arm, sorted({*arm.seeds} - shared)) for arm in (a, b)]
        if shared and any(seeds for _, seeds in alone):
            others = " and ".join(f"{in_short(s)} of {arm.name}" for arm, s in alone if s)
            yield (
                f"{a.name} and {b.name} are paired by the {len(shared)} seeds that they share"
                f" ({in_short(sorted(shared))}); seeds {others} have no pair: only the rank test"
                " has their runs."
            )


def _costs(runs: DataFrame) -> Iterator[str]:
    """A warning if runs of the arms had clearly different numbers of episodes."""
    costs = runs.groupby("arm", sort=False)["episodes"].mean()
    if costs.max() > (1 + UNEQUAL) * costs.min():
        each = ", ".join(f"{arm} {cost:,.0f}" for arm, cost in costs.items())
        yield f"Warning: arms of unequal cost, in episodes of a run: {each}."


def _check(arms: Sequence[Arm]) -> None:
    """Raises StudyError if the arms cannot be compared, not even with `force`."""
    if len(arms) < 2:
        raise StudyError(
            f"Expected two or more arms, found {len(arms)}; for instance"
            ' --arm expert="supervisor=expert" --arm baseline="supervisor=baseline".'
        )
    for kind, things in (
        ("arm of another name", [arm.name for arm in arms]),
        ("run in one arm", [run.path for arm in arms for run in arm.runs]),
    ):
        twice = [str(thing) for thing, n in Counter(things).items() if n > 1]
        if twice:
            raise StudyError(f"Expected each {kind}, found {twice[0]} twice; narrow --arm.")
    kinds = {
        (run.flat["domain.factory"], c.specialist_names, *c.behaviours, *c.tiers, c.milestones): arm
        for arm in arms
        for run in arm.runs
        for c in [run.classes]
    }
    if len(kinds) > 1:
        a, b, *_ = (arm.name for arm in kinds.values())
        raise StudyError(
            f"Expected runs of one domain, with the same behaviours and tiers, found others in {a}"
            f" than in {b}; such runs cannot be compared, not even with --force."
        )


def _settings(arms: Sequence[Arm]) -> DataFrame:
    """The configuration as texts, without what does not affect records: a column per run."""
    from pandas import DataFrame

    runs = [run for arm in arms for run in arm.runs]
    # The archive changes no population; seeds are checked separately.
    ignored = runtime_keys(*(run.config for run in runs)) | {"seed", "name", "archive"}
    texts = {
        run.path: {k: str(v) for k, v in run.flat.items() if _group(k) not in ignored}
        for run in runs
    }
    return DataFrame(texts).fillna("not set").sort_index()


def _inside(arms: Sequence[Arm], settings: DataFrame) -> Iterator[str]:
    """Differences between the runs of one arm."""
    for arm in arms:
        own = settings[[run.path for run in arm.runs]]
        mixed = own.loc["supervisor.name"].nunique() > 1  # then its other settings differ as well
        for key, values in own[own.nunique(axis=1) > 1].iterrows():
            if not (mixed and _group(key) == "supervisor") or key == "supervisor.name":
                yield f"within {arm.name}: {key} is {' and '.join(sorted(set(values))[:3])}"
        if twice := sorted(seed for seed, n in Counter(arm.seeds).items() if n > 1):
            yield (
                f"within {arm.name}: seeds {in_short(twice)} are there more than once;"
                " name=... selects one sweep"
            )


def _differences(arms: Sequence[Arm], settings: DataFrame) -> Iterator[tuple[str, str]]:
    """The keys in which the first runs of arms differ, with the arms by value."""
    names = [arm.name for arm in arms]
    firsts = settings[[arm.runs[0].path for arm in arms]]
    several = settings.loc["supervisor.factory"].nunique() > 1
    for key, values in firsts[firsts.nunique(axis=1) > 1].iterrows():
        if key == "supervisor.factory" or (several and key.startswith("supervisor.policy.")):
            continue  # settings differ with the kind of supervisor
        if key == "supervisor.name" and [*values] == names:
            continue
        groups: dict[str, list[str]] = {}
        for name, value in zip(names, values, strict=True):
            groups.setdefault(value, []).append(name)
        yield key, ", ".join(f"{value} in {' and '.join(g)}" for value, g in groups.items())


def _may_differ(key: str, keys_by_arm: Sequence[frozenset[str]]) -> bool:
    """True if the arms may differ in a key: each has it, a part of it, or the whole of it."""
    if _group(key) in VARIED_GROUPS:
        return True
    if _group(key) == "domain" or key in BUDGET:
        return False
    if _group(key) == "allocation" and all("search" in map(_group, k) for k in keys_by_arm):
        return True  # the keys depend on the search
    if _group(key) in REPLACEABLE_GROUPS:
        return all(_group(key) in map(_group, keys) for keys in keys_by_arm)
    return all(is_read(key, keys) for keys in keys_by_arm)


def _group(key: str) -> str:
    return key.partition(".")[0]
