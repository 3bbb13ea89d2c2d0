"""Checks that arms are comparable: that they differ only in the studied settings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from textwrap import shorten
from typing import Any, Final

from islandgp.errors import StudyError
from islandgp.records.parameters import runtime_keys
from islandgp.study.arms import Arm, Comparison, Run, cut
from islandgp.study.episodes import cost_warnings
from islandgp.study.select import in_short
from islandgp.study.texts import note

VARIED_GROUPS: Final = frozenset({"supervisor"})
"""The group in which arms may always differ (section 3.1)."""

TASK: Final = frozenset({"domain", "world", "rewards", "curriculum", "classes"})
"""Groups that define fitness and tiers; arms must not differ in them."""

REPLACEABLE_GROUPS: Final = frozenset({"library", "search"})
"""Groups that may differ as a whole if every selection names a key of the group."""

BUDGET: Final = frozenset({"gp.population", "gp.generations", "gp.episodes", "gp.shared_seed"})
"""Keys of the budget, in which arms must not differ."""

START: Final = (BUDGET - {"gp.generations"}) | {"gp.reseed_every", "gp.max_depth", "gp.max_nodes"}
"""Keys that affect the initial population and the worlds, besides seed, TASK and TREES."""

TREES: Final = "gp.trees."
"""Prefix of the keys of random trees."""

MIN_GENERATIONS: Final = 4  # least number of generations, so that no stage of Table 10 is empty

MAX_ARMS: Final = 3  # most arms with the same value that are named


def compare_arms(
    arms: Sequence[Arm],
    *,
    force: bool = False,
    notes: Sequence[str] = (),
    sources: Sequence[str] = (),
) -> Comparison:
    """Makes a comparison of arms; all runs are cut to the length of the shortest one.

    Args:
        arms: two or more, of different names.
        force: turn differences that make a comparison doubtful from an error into warnings.
        notes: further notes for the report.
        sources: folders or stores of the runs, for the report.

    Returns:
        The comparison.

    Raises:
        StudyError: fewer than two arms, equal names, a run in two arms, runs that are too
            short or of two domains; or the arms are not comparable and `force` is not set.
    """
    _check_names(arms)
    _check_vocabulary(arms)
    intended: list[str] = []  # differences in keys that the arms may differ in
    warnings = _inside(arms)
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
    horizon = min(arm.generations for arm in arms)
    shortened = tuple(replace(a, runs=tuple(cut(run, horizon) for run in a.runs)) for a in arms)
    return Comparison(
        arms=shortened,
        comparability_warnings=tuple(warnings),
        notes=(
            *intended,
            *_cuts(arms, horizon),
            *cost_warnings(shortened),
            *_alike(shortened),
            *notes,
        ),
        sources=tuple(sources),
    )


_FORCE: Final = "or use --force: the report then lists these differences."
_REMEDIES: Final = {
    "runs": f"Select other runs, {_FORCE}",
    "curriculum": "A search may set the curriculum: run all arms with the same, for example"
    f" curriculum.last_only=true; select other runs, {_FORCE}",
}


def _alike(arms: Sequence[Arm]) -> Iterator[str]:
    """A note for each pair of arms whose runs have identical populations."""
    for a, b in combinations(arms, 2):
        populations, others = (
            {run.seed: [r.individuals for r in run.records] for run in arm.runs} for arm in (a, b)
        )
        same = [seed for seed, each in populations.items() if each == others.get(seed)]
        if same:
            seeds = in_short(sorted(same))
            yield note("same", a=a.name, b=b.name, same=len(same), runs=len(a.runs), seeds=seeds)


def _cuts(arms: Sequence[Arm], horizon: int) -> Iterator[str]:
    """Notes on arms that lose generations, because all runs are cut to `horizon` of them."""
    for arm in arms:
        longest = max(len(run.records) for run in arm.runs)
        if longest > horizon:
            yield note("cut", arm=arm.name, n=longest, last=horizon - 1)


def paired(first: Arm, second: Arm) -> bool:
    """True if the runs of two arms are pairs with equal seed, initial population and worlds.

    The arms must have the same seeds, one run each, and the same settings of the start.
    """
    if first.seeds != second.seeds or len(set(first.seeds)) < len(first.seeds):
        return False
    return all(_start(a) == _start(b) for a, b in zip(first.runs, second.runs, strict=True))


def _start(run: Run) -> dict[str, Any]:
    return {
        key: value
        for key, value in run.flat.items()
        if _group(key) in TASK or key in START or key.startswith(TREES)
    }


def _check_names(arms: Sequence[Arm]) -> None:
    if len(arms) < 2:
        raise StudyError(
            f"Expected two or more arms, found {len(arms)}; for instance"
            ' --arm expert="supervisor=expert" --arm baseline="supervisor=baseline".'
        )
    for arm in arms:
        if arm.generations < MIN_GENERATIONS:
            raise StudyError(
                f"Expected runs of at least {MIN_GENERATIONS} generations, found {arm.generations}"
                f" in {arm.name}; early, mid and late training need one each."
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


def _differences(arms: Sequence[Arm]) -> list[tuple[str, str]]:
    differences = []
    irrelevant = _irrelevant(arms)
    names = [arm.name for arm in arms]
    kinds = {str(run.flat.get("supervisor.factory")) for arm in arms for run in arm.runs}
    for key in sorted({key for arm in arms for run in arm.runs for key in run.flat}):
        if _group(key) in irrelevant or key == "supervisor.factory":
            continue
        if len(kinds) > 1 and key.startswith("supervisor.policy."):
            continue  # settings differ with the kind of supervisor
        values = [str(arm.runs[0].flat.get(key, "not set")) for arm in arms]
        if key == "supervisor.name" and values == names:
            continue  # the names of the arms show it
        if len(set(values)) > 1:
            differences.append((key, _by_value(names, values)))
    return differences


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
    if _group(key) in TASK or key in BUDGET:
        return False
    if _group(key) in REPLACEABLE_GROUPS:
        return all(_group(key) in map(_group, keys) for keys in keys_by_arm)
    return all(any(_contains(key, k) or _contains(k, key) for k in keys) for keys in keys_by_arm)


def _contains(whole: str, key: str) -> bool:
    return f"{key}.".startswith(f"{whole}.")


def _seeds(arms: Sequence[Arm]) -> list[str]:
    if len({tuple(sorted(set(arm.seeds))) for arm in arms}) == 1:
        return []
    each = "; ".join(f"{arm.name} {in_short(sorted(set(arm.seeds)))}" for arm in arms)
    return [f"seeds differ: {each}"]


def _group(key: str) -> str:
    return key.partition(".")[0]


def _list(values: set[str]) -> str:
    return " and ".join(sorted(values)[:3])
