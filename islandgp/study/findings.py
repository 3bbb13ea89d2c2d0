"""Every comparison of a study as one value: what was compared, and what the tests say."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf, nan

from islandgp.study.arms import Comparison
from islandgp.study.comparable import paired
from islandgp.study.emergence import ranks
from islandgp.study.measures import Measure, values
from islandgp.study.statistics import (
    ENUMERATED,
    Interval,
    PairedTest,
    RankTest,
    benjamini_hochberg,
    bootstrap,
    log_rank,
    mean_difference,
    paired_test,
    rank_test,
)


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

    @property
    def censored(self) -> bool:
        """Whether it never happened in some run."""
        return any(v is None for sample in self.samples for v in sample)

    @property
    def never(self) -> bool:
        """Whether it happened in no run of either arm."""
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
    def shift(self) -> Interval:
        """Mean of the first arm minus mean of the second, with its bootstrap interval.

        For emergence it is that of the restricted means: of the generations without one. Nothing
        is known (nan) where it happened in no run.
        """
        if self.never:
            return Interval(nan, nan, nan)
        return bootstrap(self.numbers, mean_difference)


def family(study: Comparison, measures: Sequence[Measure]) -> tuple[Finding, ...]:
    """All pairs of arms by all measures; each kind of test is adjusted over all of its p-values."""
    found = [
        examine(
            m,
            (a.name, b.name),
            (values(m, a.runs), values(m, b.runs)),
            study.generations,
            in_pairs=paired(a, b),
        )
        for a, b in study.pairs
        for m in measures
    ]
    return adjust(found)


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
    censored = any(v is None for sample in samples for v in sample)
    rank = rank_test(a, b, enumerated=enumerated)
    return Finding(
        measure=measure,
        arms=arms,
        samples=samples,
        generations=generations,
        rank=rank,
        rank_q=rank.p,
        paired=paired_test(a, b, ordinal=censored) if in_pairs else None,
        paired_q=None,
        log_rank=log_rank(*samples, horizon=generations) if measure.emergence else None,
        log_rank_q=None,
    )


def adjust(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """The findings with Benjamini and Hochberg's p over the whole family, kind by kind."""
    rank = benjamini_hochberg([f.rank.p for f in findings])
    pairs = _adjusted(findings, lambda f: None if f.paired is None else f.paired.p)
    logs = _adjusted(findings, lambda f: f.log_rank)
    return tuple(
        replace(f, rank_q=rank[i], paired_q=pairs[i], log_rank_q=logs[i])
        for i, f in enumerate(findings)
    )


def _adjusted(
    findings: Sequence[Finding], p: Callable[[Finding], float | None]
) -> list[float | None]:
    raw = [p(f) for f in findings]
    known = iter(benjamini_hochberg([x for x in raw if x is not None]))
    return [None if x is None else next(known) for x in raw]


def finding(findings: Sequence[Finding], key: str, arms: tuple[str, str]) -> Finding:
    """The one of a measure and a pair of arms. Raises StopIteration when there is none."""
    return next(f for f in findings if f.measure.key == key and f.arms == arms)
