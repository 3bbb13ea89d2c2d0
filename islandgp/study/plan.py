"""The analysis plan of a comparison: primary endpoint, families of tests, margins."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Final

from islandgp.errors import StudyError
from islandgp.study.arms import Comparison
from islandgp.study.measures import MUTATION, TABLE_12, all_measures, main_family
from islandgp.study.texts import note

Pair = tuple[str, str]

FIRST: Final = "the first two arms"
LIBRARY: Final = "arms that inject trees"
REST: Final = "other pairs"


@dataclass(frozen=True, slots=True)
class AnalysisPlan:
    """The analysis plan, by the options of the command."""

    families: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # arms by family
    primary: str | None = None  # key of the measure that is the primary endpoint
    margins: Mapping[str, float] = field(default_factory=dict)  # by measure, in its unit, > 0


DEFAULT_PLAN: Final = AnalysisPlan()
"""The default plan."""


@dataclass(frozen=True, slots=True)
class Family:
    """Comparisons whose p-values are adjusted together."""

    name: str
    pairs: tuple[Pair, ...]  # of arms, by name
    measures: frozenset[str]  # keys


def parse_family(text: str) -> tuple[str, tuple[str, ...]]:
    """Parses NAME=arm,arm,... Raises StudyError for other texts."""
    name, _, rest = text.partition("=")
    arms = tuple(dict.fromkeys(arm.strip() for arm in rest.split(",") if arm.strip()))
    if not name.strip() or len(arms) < 2:
        raise StudyError(
            f"Expected --family NAME=ARM,ARM,... with two arms or more, found {text!r};"
            " for instance --family judgement=expert,blind,trees."
        )
    return name.strip(), arms


def parse_margin(text: str) -> tuple[str, float]:
    """Parses MEASURE=VALUE. Raises StudyError for other texts."""
    name, _, rest = text.partition("=")
    try:
        value = float(rest)
    except ValueError:
        value = 0.0
    if not name.strip() or not isfinite(value) or value <= 0:
        raise StudyError(
            f"Expected --margin MEASURE=VALUE with a value above 0, found {text!r};"
            " for instance --margin mean_max=2500."
        )
    return name.strip(), value


def parse_plan(
    families: Sequence[str], primary: str | None, margins: Sequence[str]
) -> AnalysisPlan:
    """Parses the options of a plan. Raises StudyError if one is not valid."""
    named = list(map(parse_family, families))
    bounds = list(map(parse_margin, margins))
    for option, keys in (("family", [n for n, _ in named]), ("margin", [m for m, _ in bounds])):
        if twice := [key for key in dict.fromkeys(keys) if keys.count(key) > 1]:
            raise StudyError(f"Expected each {option} once, found {twice[0]} twice; leave one out.")
    if {FIRST, REST} & set(dict(named)):
        raise StudyError(
            f"Expected other names for families than {FIRST!r} and {REST!r}, which are taken;"
            " choose another name."
        )
    return AnalysisPlan(dict(named), primary, dict(bounds))


def check_plan(plan: AnalysisPlan, study: Comparison) -> None:
    """Raises StudyError if an arm or a measure of a plan does not exist."""
    for name, members in plan.families.items():
        for arm in members:
            if arm not in study.names:
                raise StudyError(
                    f"Expected arms of this comparison in --family {name}, found {arm!r};"
                    f" there are {', '.join(study.names)}."
                )
    keys = [m.key for m in all_measures(study)]
    named = [("--primary", plan.primary)] if plan.primary is not None else []
    named += [("--margin", key) for key in plan.margins]
    for place, key in named:
        if key not in keys:
            raise StudyError(
                f"Expected a measure in {place}, found {key!r}; there are {', '.join(keys)}."
            )
    families(study, plan)


def families(study: Comparison, plan: AnalysisPlan) -> tuple[Family, ...]:
    """The families of a comparison; every pair of arms is in one of them.

    The first family is the first pair, by the measures of Tables 9 to 12. The plan's families
    follow; without any, the arms that inject trees are a family. The last family has all other
    pairs. A pair belongs to the first family with both arms. Except for the first, the measures of
    a family are those with a margin, if the plan has margins.

    Raises:
        StudyError: all pairs of a family are in earlier families.
    """
    paper = frozenset(m.key for m in (*main_family(study.milestones), *TABLE_12, MUTATION))
    measures = frozenset(plan.margins) or paper
    remaining = [(a.name, b.name) for a, b in study.pairs]
    result = [Family(FIRST, (remaining.pop(0),), paper)]
    inject = [a for a in study.arms if any(g.injected for run in a.runs for g in run.guidance)]
    injecting = {LIBRARY: tuple(arm.name for arm in inject)}
    for name, arms in (plan.families or injecting).items():
        pairs = tuple(pair for pair in remaining if set(pair) <= set(arms))
        if pairs:
            result.append(Family(name, pairs, measures))
        elif plan.families:
            raise StudyError(
                f"Expected pairs of arms in --family {name} that are in no family before it, found"
                " none; the first pair of arms is a family by itself."
            )
        remaining = [pair for pair in remaining if pair not in pairs]
    if remaining:
        result.append(Family(REST, tuple(remaining), measures))
    return tuple(result)


def in_sentences(plan: AnalysisPlan, study: Comparison) -> Iterator[str]:
    """The plan in sentences."""
    labels = {m.key: m for m in all_measures(study)}
    if plan.primary is not None:
        yield note("primary", measure=labels[plan.primary].label)
    for f in families(study, plan):
        pairs, n = ", ".join(f"{a} and {b}" for a, b in f.pairs), len(f.measures)
        yield note("family", name=f.name, pairs=pairs, n=n, tests=len(f.pairs) * n)
    if plan.margins:
        each = ", ".join(
            f"{labels[key].label} {value:,g} ({labels[key].unit})"
            for key, value in plan.margins.items()
        )
        yield note("margins", each=each)
