"""Checks that arms are comparable: that they differ only in the studied settings."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from textwrap import shorten
from typing import TYPE_CHECKING, Any, Final

from islandgp.compare.arms import Arm, Run, in_short
from islandgp.compare.measures import identical, measured, read_runs
from islandgp.errors import StudyError
from islandgp.records.parameters import TASK, flatten, runtime_keys, short_key
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
"""Keys that affect the initial population and the seeds of worlds, besides seed and TREES."""

TREES: Final = "gp.trees."
"""Prefix of the keys of random trees."""

MIN_GENERATIONS: Final = 4  # least number of generations, so that no stage of Table 10 is empty

UNEQUAL: Final = 0.05  # least share by which costs are unequal

MAX_ARMS: Final = 3  # most arms with the same value that are named


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
    sources: tuple[str, ...]  # folders of the runs

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

    def task(self, arm: str) -> Task:
        """The task of an arm."""
        return next(task for task in self.tasks if arm in task.arms)

    def of_arm(self, name: str) -> DataFrame:
        """The runs of an arm."""
        return self.runs[self.runs["arm"] == name]


def compare_arms(
    arms: Sequence[Arm],
    *,
    force: bool = False,
    notes: Sequence[str] = (),
    sources: Sequence[str] = (),
) -> Comparison:
    """Makes a comparison of arms; generations after the end of the shortest run are left out.

    Args:
        arms: two or more, of different names.
        force: turn differences that make a comparison doubtful from an error into warnings.
        notes: further notes for the report.
        sources: folders of the runs, for the report.

    Returns:
        The comparison.

    Raises:
        StudyError: fewer than two arms, equal names, a run in two arms, runs that are too
            short or of two domains; or the arms are not comparable and `force` is not set.
        RunError: a run is damaged.
    """
    _check_names(arms)
    _check_vocabulary(arms)
    warnings, intended = _inside(arms), list[str]()
    for key, values in _differences(arms):
        if _may_differ(key, [arm.keys for arm in arms]):
            intended.append(f"The arms differ in {key}: {values}.")
        else:
            warnings.append(f"{key} differs: {values}")
    warnings += _seeds(arms)
    if warnings and not force:
        raise StudyError(
            "Expected arms that differ only in what is studied, found:\n  "
            + "\n  ".join(shorten(line, width=400, placeholder=" ...") for line in warnings)
            + f"\n{_REMEDIES['curriculum' if 'curriculum.' in str(warnings) else 'runs']}"
        )
    generations, runs = read_runs(arms)
    lengths = generations.groupby("run")["generation"].count()
    horizon, shortest = lengths.min(), runs.loc[lengths.idxmin(), "arm"]
    if horizon < MIN_GENERATIONS:
        raise StudyError(
            f"Expected runs of at least {MIN_GENERATIONS} generations, found {horizon} in"
            f" {shortest}; early, mid and late training need one each."
        )
    longer = runs[lengths.reindex(runs.index) > horizon]["arm"]
    cuts = [
        f"{name} has runs of more than {horizon} generations; measures of training end with"
        f" generation {horizon - 1}, the last one of the shortest run."
        for name in longer.unique()
    ]
    generations = generations[generations["generation"] < horizon]
    values = measured(generations, arms[0].runs[0].classes)
    runs = runs.drop(columns=values.columns, errors="ignore").join(values)
    tasks = _tasks(arms)
    labels = {name: task.label for task in tasks for name in task.arms}
    runs.insert(2, "task", runs["arm"].map(labels))
    further = (*cuts, *_pairs(arms), *_costs(runs), *_alike(arms, generations), *notes)
    return Comparison(
        arms=tuple(arms),
        tasks=tasks,
        runs=runs,
        generations=generations,
        comparability_warnings=tuple(warnings),
        notes=(*intended, *further),
        sources=tuple(sources),
    )


_FORCE: Final = "or use --force: the report then lists these differences."
_REMEDIES: Final = {
    "runs": f"Select other runs, {_FORCE}",
    "curriculum": "A search may set the curriculum: run all arms with the same, for example"
    f" curriculum.last_only=true; select other runs, {_FORCE}",
}


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
        label = " ".join(settings) if 0 < len(settings) <= MAX_ARMS else " and ".join(names)
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
    return {k: v for k, v in run.flat.items() if k in START or k.startswith(TREES)}


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


def _alike(arms: Sequence[Arm], generations: DataFrame) -> Iterator[str]:
    """A note for each pair of arms whose runs have identical populations."""
    by_arm = dict(iter(generations.groupby("arm")))
    for a, b in combinations(arms, 2):
        if same := list(identical(by_arm[a.name], by_arm[b.name])):
            yield (
                f"{a.name} and {b.name} have the same individuals in every generation of"
                f" {len(same)} of {len(a.runs)} runs (seeds {in_short(same)}): no test can"
                " find a difference there."
            )


def _check_names(arms: Sequence[Arm]) -> None:
    if len(arms) < 2:
        raise StudyError(
            f"Expected two or more arms, found {len(arms)}; for instance"
            ' --arm expert="supervisor=expert" --arm baseline="supervisor=baseline".'
        )
    for name, count in Counter(arm.name for arm in arms).items():
        if count > 1:
            raise StudyError(f"Expected arms of different names, found {name} {count} times.")
    names: dict[Any, str] = {}
    for arm in arms:
        for run in arm.runs:
            if run.path in names:
                raise StudyError(
                    f"Expected each run in one arm, found {run.path.name} in {names[run.path]} and"
                    f" in {arm.name}; narrow the selections."
                )
            names[run.path] = arm.name


def _check_vocabulary(arms: Sequence[Arm]) -> None:
    """Raises StudyError if the arms' domains, behaviours or tiers differ."""
    kinds = {_vocabulary(run): arm.name for arm in arms for run in arm.runs}
    if len(kinds) > 1:
        a, b, *_ = kinds.values()
        raise StudyError(
            f"Expected runs of one domain, with the same behaviours and tiers, found others in {a}"
            f" than in {b}; such runs cannot be compared, not even with --force."
        )


def _vocabulary(run: Run) -> tuple[object, ...]:
    """The names that a run's records use."""
    classes = run.classes
    return (
        run.flat["domain.factory"],
        classes.specialist_names,
        tuple(classes.behaviours),
        tuple(classes.tiers),
        classes.milestones,
    )


def _inside(arms: Sequence[Arm]) -> list[str]:
    """Differences between the runs of one arm."""
    warnings = []
    irrelevant = _irrelevant(arms)
    for arm in arms:
        ignored = irrelevant
        mixed = {str(run.flat["supervisor.name"]) for run in arm.runs}
        if len(mixed) > 1:  # then the rest of their settings differs as well
            ignored |= {"supervisor"}
            warnings.append(f"within {arm.name}: supervisor.name is {_list(mixed)}")
        for key in sorted({key for run in arm.runs for key in run.flat}):
            values = {str(run.flat.get(key)) for run in arm.runs}
            if len(values) > 1 and _group(key) not in ignored:
                warnings.append(f"within {arm.name}: {key} is {_list(values)}")
        twice = [seed for seed, n in Counter(arm.seeds).items() if n > 1]
        if twice:
            warnings.append(
                f"within {arm.name}: seeds {in_short(sorted(twice))} are there more than once;"
                " name=... selects one sweep"
            )
    return warnings


def _differences(arms: Sequence[Arm]) -> Iterator[tuple[str, str]]:
    """The keys in which the first runs of arms differ, with their values."""
    irrelevant = _irrelevant(arms)
    names = [arm.name for arm in arms]
    kinds = {str(run.flat.get("supervisor.factory")) for arm in arms for run in arm.runs}
    for key in sorted({key for arm in arms for run in arm.runs for key in run.flat}):
        if _group(key) in irrelevant or key == "supervisor.factory":
            continue
        if len(kinds) > 1 and key.startswith("supervisor.policy."):
            continue  # settings differ with the kind of supervisor
        values = [str(arm.runs[0].flat.get(key, "not set")) for arm in arms]
        if len(set(values)) > 1 and not (key == "supervisor.name" and values == names):
            yield key, _by_value(names, values)


def _by_value(names: Sequence[str], values: Sequence[str]) -> str:
    """The arms by value, as text: "0.4 in a and b, 0.2 in c"."""
    groups: dict[str, list[str]] = {}
    for name, value in zip(names, values, strict=True):
        groups.setdefault(value, []).append(name)
    most = max(groups, key=lambda value: len(groups[value]))
    parts = [
        f"{value} in {' and '.join(group)}"
        for value, group in groups.items()
        if value != most or len(group) <= MAX_ARMS
    ]
    if len(groups[most]) > MAX_ARMS:
        parts.append(f"{most} in the others")
    return ", ".join(parts)


def _irrelevant(arms: Sequence[Arm]) -> frozenset[str]:
    """Groups that do not affect the records of these arms, or are checked separately."""
    separate = {"seed", "name", "archive"}  # the archive changes no population
    return runtime_keys(*(run.config for arm in arms for run in arm.runs)) | separate


def _may_differ(key: str, keys_by_arm: Sequence[frozenset[str]]) -> bool:
    """True if the arms may differ in a key: each has it, a part of it, or the whole of it."""
    if _group(key) in VARIED_GROUPS:
        return True
    if _group(key) == "domain" or key in BUDGET:
        return False
    if _group(key) in REPLACEABLE_GROUPS:
        return all(_group(key) in map(_group, keys) for keys in keys_by_arm)
    return all(any(_contains(key, k) or _contains(k, key) for k in keys) for keys in keys_by_arm)


def _contains(whole: str, key: str) -> bool:
    return f"{key}.".startswith(f"{whole}.")


def _seeds(arms: Sequence[Arm]) -> list[str]:
    """A warning if two arms of different seeds share none."""
    if all({*a.seeds} & {*b.seeds} for a, b in combinations(arms, 2)):
        return []
    each = "; ".join(f"{arm.name} {in_short(sorted(set(arm.seeds)))}" for arm in arms)
    return [f"two arms share no seed: {each}"]


def _group(key: str) -> str:
    return key.partition(".")[0]


def _list(values: Iterable[str]) -> str:
    return " and ".join(sorted(values)[:3])
