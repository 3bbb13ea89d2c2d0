"""Fits a small policy to a supervisor's decisions and measures their agreement (section 3.9).

Cross-validation holds out whole runs, because generations of the same run are similar.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any, Final

from islandgp.errors import StudyError
from islandgp.supervision.distilled import Answer, Policy, Question, Rule, decide

FOLDS: Final = 5  # of the cross-validation over runs


@dataclass(frozen=True, slots=True)
class Case:
    """One decision of the teacher."""

    run: int  # index of its run
    known: Mapping[str, float]  # features of the state, by `supervision.distilled.features`
    target: str | None  # None: the tree is not from the teacher
    rate: float | None  # None: the rate is not from the teacher


@dataclass(frozen=True, slots=True)
class Shape:
    """Limits of the decision trees."""

    depth: int = 6  # most questions on a path
    cases: int = 4  # fewest cases of a leaf


def distil(cases: Sequence[Case], teacher: str, shape: Shape) -> Policy:
    """Fit a policy to all cases, with a report from cross-validation over runs.

    The report has `runs`, `targets` and `rates` (numbers of cases); `target_agreement`, the share
    of targets equal to the teacher's, and for comparison `target_commonest`, the share of its most
    frequent target; `target_agreement_least`, the agreement of the run with the lowest one;
    `rate_error`, the mean absolute error of the rate, and for comparison `rate_error_mean`, that
    of predicting the mean rate.

    Raises:
        StudyError: there are not enough runs, or no decisions.
    """
    runs = sorted({case.run for case in cases})
    if len(runs) < 2:
        raise StudyError(
            f"Expected at least two runs, one to be held back, found {len(runs)}; give more."
        )
    for name, examples in (("targets", _targets(cases)), ("rates", _rates(cases))):
        if len({case.run for case, _ in examples}) < 2:
            raise StudyError(f"Expected {name} of the teacher in at least two runs, found fewer.")
    return Policy(
        format=1,
        teacher=teacher,
        target=_fit_targets(cases, shape),
        rate=_fit_rates(cases, shape),
        report={"runs": len(runs), **_held_back(cases, runs, shape)},
    )


def _held_back(cases: Sequence[Case], runs: Sequence[int], shape: Shape) -> dict[str, float]:
    right: dict[int, list[bool]] = {}  # by run
    errors: list[float] = []
    for fold in range(min(FOLDS, len(runs))):
        out = set(runs[fold :: min(FOLDS, len(runs))])
        training = [case for case in cases if case.run not in out]
        new = [case for case in cases if case.run in out]
        if _targets(training):
            rule = _fit_targets(training, shape)
            for case, target in _targets(new):
                right.setdefault(case.run, []).append(decide(rule, case.known) == target)
        if _rates(training):
            rule = _fit_rates(training, shape)
            errors += [abs(float(decide(rule, c.known)) - rate) for c, rate in _rates(new)]
    commonest = Counter(target for _, target in _targets(cases)).most_common(1)[0][1]
    rates = [rate for _, rate in _rates(cases)]
    all_hits = [hit for hits in right.values() for hit in hits]
    return {
        "targets": len(all_hits),
        "rates": len(errors),
        "target_agreement": fmean(all_hits),
        "target_agreement_least": min(map(fmean, right.values())),
        "target_commonest": commonest / len(_targets(cases)),
        "rate_error": fmean(errors),
        "rate_error_mean": fmean(abs(rate - fmean(rates)) for rate in rates),
    }


def _targets(cases: Sequence[Case]) -> list[tuple[Case, str]]:
    return [(case, case.target) for case in cases if case.target is not None]


def _rates(cases: Sequence[Case]) -> list[tuple[Case, float]]:
    return [(case, case.rate) for case in cases if case.rate is not None]


def _fit_targets(cases: Sequence[Case], shape: Shape) -> Rule:
    from sklearn.tree import DecisionTreeClassifier  # type: ignore[import-untyped] # no stubs

    targets = _targets(cases)
    names = sorted({target for _, target in targets})
    places = [names.index(target) for _, target in targets]  # all of them occur
    return _fit(DecisionTreeClassifier, shape, targets, places, lambda n: names[int(n[0].argmax())])


def _fit_rates(cases: Sequence[Case], shape: Shape) -> Rule:
    from sklearn.tree import DecisionTreeRegressor

    cases_of_rate = _rates(cases)
    rates = [rate for _, rate in cases_of_rate]
    return _fit(
        DecisionTreeRegressor, shape, cases_of_rate, rates, lambda n: round(float(n[0][0]), 6)
    )


def _fit(
    kind: Any,
    shape: Shape,
    examples: Sequence[tuple[Case, Any]],
    answers: Sequence[float],
    answer: Any,
) -> Rule:
    """Fit a tree of scikit-learn's class `kind`; `answer` converts a leaf's value to an answer."""
    names = list(examples[0][0].known)
    tree = kind(max_depth=shape.depth, min_samples_leaf=shape.cases, random_state=0)
    tree.fit([[case.known[name] for name in names] for case, _ in examples], answers)
    return _rule(tree.tree_, names, answer)


def _rule(tree: Any, names: Sequence[str], answer: Any, place: int = 0) -> Rule:
    """A rule from scikit-learn's arrays, in which -1 is a missing child."""
    if tree.children_left[place] < 0:
        cases = int(tree.n_node_samples[place])
        return Answer(answer=answer(tree.value[place]), cases=cases)
    yes = _rule(tree, names, answer, tree.children_left[place])
    no = _rule(tree, names, answer, tree.children_right[place])
    if isinstance(yes, Answer) and isinstance(no, Answer) and yes.answer == no.answer:
        return Answer(answer=yes.answer, cases=yes.cases + no.cases)
    feature, at_most = names[tree.feature[place]], float(tree.threshold[place])
    return Question(feature=feature, at_most=at_most, yes=yes, no=no)


def report_lines(policy: Policy) -> Iterator[str]:
    """The report as lines of text."""
    r = policy.report
    yield f"Teacher: {policy.teacher}, {r['runs']:.0f} runs; each was held back once."
    yield (
        f"Targets: {r['target_agreement']:.0%} of {r['targets']:,.0f} agree with the teacher's"
        f" ({r['target_agreement_least']:.0%} in the run with the fewest;"
        f" {r['target_commonest']:.0%} for always choosing the most frequent)."
    )
    yield (
        f"Rates: {r['rate_error']:.3f} from the teacher's on the mean"
        f" ({r['rate_error_mean']:.3f} for always choosing the mean), {r['rates']:,.0f} rates."
    )
