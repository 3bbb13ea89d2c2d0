"""Comparisons of two arms by a measure, with the results of their tests."""

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
    """A comparison of two arms by a measure."""

    measure: Measure
    arms: tuple[str, str]
    samples: tuple[tuple[float | None, ...], tuple[float | None, ...]]  # None: censored
    generations: int  # at which runs are censored
    rank: RankTest
    rank_q: float  # p adjusted over the family
    paired: PairedTest | None  # if the arms share seeds
    paired_q: float | None
    log_rank: float | None  # p, for emergence
    log_rank_q: float | None
    family: str = ""  # name of the family in which its p-values are adjusted
    size: int = 1  # number of comparisons in the family

    @property
    def test(self) -> PairedTest | RankTest:
        """The test of `shift`: the paired one if the arms share seeds."""
        return self.rank if self.paired is None else self.paired

    @property
    def p_bh(self) -> float:
        """The p-value of `test`, adjusted over the family."""
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
        """The samples for a rank test; censored runs are after the last generation."""
        a, b = (ranks(sample, self.generations) for sample in self.samples)
        return a, b

    @property
    def endless(self) -> tuple[list[float], list[float]]:
        """The samples for medians; the value of a censored run is infinite."""
        a, b = ([inf if v is None else v for v in sample] for sample in self.samples)
        return a, b

    @property
    def hazard(self) -> Interval:
        """Hazard ratio of the first arm to the second, for emergence; above 1, it is earlier."""
        return hazard_ratio(*self.samples, horizon=self.generations)

    @property
    def shift(self) -> Interval:
        """Mean of the first arm minus mean of the second, with its 95 % interval.

        Student's t interval of the paired differences if the arms share seeds, else Welch's. For
        emergence, the means are restricted means; nan if all runs are censored.
        """
        if self.never:
            return Interval(nan, nan, nan)
        return (mean_difference if self.paired is None else paired_difference)(*self.numbers)


def examine_all(
    study: Comparison, families: Sequence[Family], measures: Sequence[Measure]
) -> tuple[Finding, ...]:
    """The comparisons of all pairs of arms by all measures.

    p-values are adjusted by kind of test over each family; those of measures outside a family are
    adjusted separately.
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
    """The tests of two samples, with unadjusted p-values.

    `in_pairs`: True if the values are pairs; `enumerated` as for `rank_test`.
    """
    a, b = (ranks(sample, generations) for sample in samples)
    rank = rank_test(a, b, enumerated=enumerated)
    pairs = paired_test(a, b) if in_pairs else None
    logs = log_rank(*samples, horizon=generations) if measure.emergence else None
    pairs_q = None if pairs is None else pairs.p
    return Finding(measure, arms, samples, generations, rank, rank.p, pairs, pairs_q, logs, logs)


def adjust(findings: Sequence[Finding], family: str = "") -> tuple[Finding, ...]:
    """The findings with p-values adjusted by Benjamini-Hochberg over the family, by kind."""
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
    """The finding of a measure and a pair of arms. Raises StopIteration if there is none."""
    return next(f for f in findings if f.measure.key == key and f.arms == arms)
