"""Every comparison of a study as one value: what was compared, and what the tests say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, nan
from typing import Any

from islandgp.statistics import (
    ENUMERATED,
    UNTESTED,
    Interval,
    PairedTest,
    RankTest,
    benjamini_hochberg,
    hazard_ratio,
    log_rank,
    mean_difference,
    paired_difference,
    paired_test,
    rank_test,
)
from islandgp.study.arms import Arm, Comparison
from islandgp.study.comparable import paired
from islandgp.study.emergence import ranks
from islandgp.study.measures import Measure
from islandgp.study.plan import Family


@dataclass(frozen=True, slots=True)
class Finding:
    """Two arms compared by one measure."""

    measure: Measure
    arms: tuple[str, str]
    samples: tuple[tuple[float | None, ...], tuple[float | None, ...]]  # None: censored
    generations: int  # that censored runs were watched for
    rank: RankTest
    rank_q: float  # p adjusted over the family
    paired: PairedTest | None  # when the arms share seeds
    paired_q: float | None
    log_rank: float | None  # p, for emergence
    log_rank_q: float | None
    family: str = ""  # what its p-values are adjusted with
    size: int = 1  # comparisons of that family

    @property
    def test(self) -> PairedTest | RankTest:
        """The one that belongs to `shift`: paired where the arms share seeds."""
        return self.rank if self.paired is None else self.paired

    @property
    def p_bh(self) -> float:
        """That test's p, adjusted over the family."""
        return self.rank_q if self.paired_q is None else self.paired_q

    @property
    def equal(self) -> bool:
        """True if both runs of every pair have the same value."""
        return self.paired is not None and self.paired.kind == UNTESTED

    @property
    def censored(self) -> bool:
        """True if some run is censored."""
        return any(v is None for sample in self.samples for v in sample)

    @property
    def never(self) -> bool:
        """True if all runs of both arms are censored."""
        return all(v is None for sample in self.samples for v in sample)

    @property
    def numbers(self) -> tuple[list[float], list[float]]:
        """The samples as a rank test takes them; censored runs after the last generation."""
        a, b = (ranks(sample, self.generations) for sample in self.samples)
        return a, b

    @property
    def endless(self) -> tuple[list[float], list[float]]:
        """The samples as medians take them; a censored run's value is infinite."""
        a, b = ([inf if v is None else v for v in sample] for sample in self.samples)
        return a, b

    @property
    def hazard(self) -> Interval:
        """Hazard ratio of the first arm to the second, for emergence: above 1 it comes sooner."""
        return hazard_ratio(*self.samples, horizon=self.generations)

    @property
    def shift(self) -> Interval:
        """Mean of the first arm minus mean of the second, with its 95 % interval.

        Student's t of the paired differences where the arms share seeds, else Welch's. For
        emergence it is that of the restricted means: of the generations without one. Nothing
        is known (nan) where it happened in no run.
        """
        if self.never:
            return Interval(nan, nan, nan)
        return (mean_difference if self.paired is None else paired_difference)(*self.numbers)


def examine_all(
    study: Comparison, families: Sequence[Family], measures: Sequence[Measure]
) -> tuple[Finding, ...]:
    """All pairs of the families by all measures.

    Each kind of test is adjusted over its p-values in the family; the measures that a family
    does not ask for are adjusted among themselves.
    """
    arms = {arm.name: arm for arm in study.arms}

    def compared(a: Arm, b: Arm, measure: Measure) -> Finding:
        samples = tuple(map(measure.of, a.runs)), tuple(map(measure.of, b.runs))
        names = a.name, b.name
        return examine(measure, names, samples, study.generations, in_pairs=paired(a, b))

    findings: list[Finding] = []
    for family in families:
        selected = [m for m in measures if m.key in family.measures]
        further = [m for m in measures if m.key not in family.measures]
        for name, group in ((family.name, selected), (f"{family.name}, further", further)):
            examined = [compared(arms[a], arms[b], m) for a, b in family.pairs for m in group]
            findings += adjust(examined, name)
    return tuple(findings)


def examine(
    measure: Measure,
    arms: tuple[str, str],
    samples: tuple[tuple[float | None, ...], tuple[float | None, ...]],
    generations: int,
    *,
    in_pairs: bool,
    enumerated: int = ENUMERATED,
) -> Finding:
    """The tests of two samples, before they are adjusted for others.

    `in_pairs` when their values belong together one by one; `enumerated` as in `rank_test`.
    """
    a, b = (ranks(sample, generations) for sample in samples)
    rank = rank_test(a, b, enumerated=enumerated)
    pairs = paired_test(a, b) if in_pairs else None
    logs = log_rank(*samples, horizon=generations) if measure.emergence else None
    pairs_q = None if pairs is None else pairs.p
    return Finding(measure, arms, samples, generations, rank, rank.p, pairs, pairs_q, logs, logs)


def adjust(findings: Sequence[Finding], family: str = "") -> tuple[Finding, ...]:
    """The findings with Benjamini and Hochberg's p over the whole family, kind by kind."""
    rank, pairs, logs = (_adjusted(findings, kind) for kind in ("rank", "paired", "log_rank"))
    size = len(findings)
    return tuple(
        replace(f, rank_q=rank[i], paired_q=pairs[i], log_rank_q=logs[i], family=family, size=size)
        for i, f in enumerate(findings)
    )


def _adjusted(findings: Sequence[Finding], kind: str) -> list[Any]:
    tests = [getattr(f, kind) for f in findings]  # `log_rank` is a p-value itself
    p = [getattr(test, "p", test) for test in tests]
    adjusted = iter(benjamini_hochberg([x for x in p if x is not None]))
    return [None if x is None else next(adjusted) for x in p]


def finding(findings: Sequence[Finding], key: str, arms: tuple[str, str]) -> Finding:
    """The one of a measure and a pair of arms. Raises StopIteration when there is none."""
    return next(f for f in findings if f.measure.key == key and f.arms == arms)
