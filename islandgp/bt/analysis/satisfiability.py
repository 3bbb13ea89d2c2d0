"""Whether conditions can hold together, follow from each other, or have a shorter form."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import chain, product
from math import ceil, floor, inf, prod
from typing import Final, TypeAlias

from islandgp.bt.core.arithmetic import Formula, bounds
from islandgp.bt.core.condition import (
    WHOLE,
    Condition,
    ConditionExpr,
    combine,
    opposite,
    ordered,
    rounded,
    terms,
    to_nnf,
    with_terms,
)
from islandgp.bt.core.vocabulary import Vocabulary

Conditions: TypeAlias = tuple[ConditionExpr, ...]

MAX_CASES: Final = 32  # most cases of conditions joined by `or`
MAX_PREMISES: Final = 64  # most conditions that are analysed together


def keys_of(expr: ConditionExpr) -> set[str]:
    """The keys that a condition reads."""
    return {key for term in terms(expr) for key in term.keys}


def implies(premises: Conditions, expr: ConditionExpr) -> bool:
    """True if `expr` holds on every blackboard on which all of `premises` hold.

    It may also return False for a condition that is implied, if more than MAX_CASES cases or
    MAX_PREMISES premises would have to be examined.
    """
    return excludes(premises, opposite(expr))


@lru_cache(maxsize=10_000)  # trees of a population share most of their guards
def excludes(premises: Conditions, expr: ConditionExpr) -> bool:
    """True if `expr` holds on no blackboard on which all of `premises` hold.

    It may also return False where that is the case, as `implies`.
    """
    single = [c for c in premises if isinstance(c, Condition)]
    if isinstance(expr, Condition) and len(single) == len(premises):
        return not _satisfiable([*(c for c in single if {*c.keys} <= {*expr.keys}), expr])
    return not _consistent(_related(premises, expr), expr)


def shortened(expr: ConditionExpr, premises: Conditions) -> ConditionExpr:
    """A shorter condition with the same value wherever all of `premises` hold, or else `expr`."""
    if isinstance(expr, Condition):
        return expr
    condition, related = to_nnf(expr), _related(premises, expr)
    while (reduced := _without_redundant(condition, related)) != condition:
        condition = reduced
    return condition if _word_count(condition) < _word_count(expr) else expr


def without_decimals(expr: ConditionExpr, vocabulary: Vocabulary) -> ConditionExpr:
    """The condition with the thresholds of whole numbers rounded, where its value stays equal."""
    whole = {name for name, key in vocabulary.keys.items() if key.whole}
    return with_terms(expr, lambda term: rounded(term) if term.key in whole else term) or expr


def _word_count(expr: ConditionExpr) -> int:
    """The number of terms and of the word `not`."""
    if isinstance(expr, Condition):
        return 2 if expr.operator == "not" else 1
    return (expr.word == "not") + sum(map(_word_count, expr.parts))


def _without_redundant(expr: ConditionExpr, premises: Conditions) -> ConditionExpr:
    """The condition without parts whose value follows from the other parts and `premises`."""
    if isinstance(expr, Condition) or expr.word == "not":
        return expr
    parts = list(expr.parts)
    at = 0
    while at < len(parts) > 1:
        others = parts[:at] + parts[at + 1 :]
        # Where a part of an `and` matters, the others hold; of an `or`, none of them does.
        assumed = (*premises, *(others if expr.word == "and" else map(opposite, others)))
        if not _consistent(assumed, opposite(parts[at]) if expr.word == "and" else parts[at]):
            parts = others
        else:
            parts[at] = _without_redundant(parts[at], assumed)
            at += 1
    return combine(expr.word, parts)


def _related(premises: Conditions, expr: ConditionExpr) -> Conditions:
    """The conditions in `premises` that constrain keys of `expr`, directly or indirectly."""
    keys, related, others = keys_of(expr), list[ConditionExpr](), list(premises)
    while found := [each for each in others if not keys.isdisjoint(keys_of(each))]:
        related += found
        keys = keys.union(*map(keys_of, found))
        others = [each for each in others if each not in found]
    return tuple(related)


def _consistent(premises: Conditions, expr: ConditionExpr) -> bool:
    """True if there may be a blackboard on which `expr` and all of `premises` hold."""
    # Without some premises the answer can only turn from False to True.
    joint = combine("and", [to_nnf(each) for each in (expr, *premises[:MAX_PREMISES])])
    return _case_count(joint) > MAX_CASES or any(map(_satisfiable, _cases(joint)))


def _case_count(expr: ConditionExpr) -> int:
    """The number of `_cases`."""
    if isinstance(expr, Condition) or expr.word == "not":
        return 1
    return (prod if expr.word == "and" else sum)(map(_case_count, expr.parts))


def _cases(expr: ConditionExpr) -> Iterator[tuple[Condition, ...]]:
    """The conjunctions in the disjunctive normal form of a condition in NNF."""
    if isinstance(expr, Condition):
        yield (expr,)
    elif expr.word == "not":  # of a division by a key: it may hold
        yield ()
    elif expr.word == "or":
        for part in expr.parts:
            yield from _cases(part)
    else:
        for parts in product(*map(_cases, expr.parts)):
            yield tuple(chain.from_iterable(parts))


def _satisfiable(conditions: Sequence[Condition]) -> bool:
    """True if there may be a blackboard on which all of these conditions hold.

    A comparison of two keys is treated as a comparison of their difference with 0, and a formula as
    a number within the bounds that follow from the ranges of its keys.
    """
    by_sides: dict[tuple[str, str], list[Condition]] = {}
    for each in map(ordered, conditions):
        by_sides.setdefault((each.key, each.other), []).append(each)
    if any(isinstance(side, Formula) for sides in by_sides for side in sides):
        ranges = {key: _range(each) for (key, other), each in by_sides.items() if not other}
        for sides, asked in by_sides.items():
            if any(isinstance(side, Formula) for side in sides):
                asked += _within(*sides, ranges)
    return all(map(_has_value, by_sides.values()))


def _within(key: str, other: str, ranges: Mapping[str, tuple[float, float]]) -> Iterator[Condition]:
    """The bounds of a side, or of the difference of two, as conditions."""
    low, high = bounds(key.term if isinstance(key, Formula) else key, ranges)
    if other:
        low_other, high_other = bounds(other.term if isinstance(other, Formula) else other, ranges)
        low, high = low - high_other, high - low_other
    if low > -inf:
        yield Condition(key, ">=", low, other)
    if high < inf:
        yield Condition(key, "<=", high, other)


def _range(conditions: Sequence[Condition]) -> tuple[float, float]:
    """The lowest and the highest number that conditions of a key allow."""
    low = max((c.number for c in conditions if c.operator in (">", ">=", "==")), default=-inf)
    high = min((c.number for c in conditions if c.operator in ("<", "<=", "==")), default=inf)
    return low, high


def _has_value(conditions: Sequence[Condition]) -> bool:
    """True if a number satisfies all of these conditions, which have the same sides."""
    # The bounds are (x, False), just below x, and (x, True), just above it.
    low, high = (-inf, False), (inf, True)
    excluded = set()
    whole = False
    for _, operator, number, _ in conditions:
        whole |= operator == WHOLE
        if operator in ("!=", "is"):  # the number of a flag is 0
            excluded.add(number)
        if operator in (">", ">=", "==", "not"):
            low = max(low, (number, operator == ">"))
        if operator in ("<", "<=", "==", "not"):
            high = min(high, (number, operator != "<"))
    if whole and -inf < low[0] and high[0] < inf:
        first = floor(low[0]) + 1 if low[1] else ceil(low[0])
        last = floor(high[0]) if high[1] else ceil(high[0]) - 1
        return any(x not in excluded for x in range(first, min(last, first + len(excluded)) + 1))
    return low < high and not (low[0] == high[0] and low[0] in excluded)
