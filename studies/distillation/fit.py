"""Fits a small policy to a supervisor's decisions and measures their agreement (section 3.9).

Cross-validation holds out whole runs, because generations of the same run are similar.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any, Final, TypeVar

from islandgp.errors import StudyError
from studies.distillation.policy import Answer, Policy, Question, Rule, decide

T = TypeVar("T", str, float)

FOLDS: Final = 5  # of the cross-validation over runs


@dataclass(frozen=True, slots=True)
class Case:
    """One decision of the teacher."""

    run: int  # index of its run
    known: Mapping[str, float]  # features of the state, by `policy.features`
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
    targets = [(case, case.target) for case in cases if case.target is not None]
    rates = [(case, case.rate) for case in cases if case.rate is not None]
    for name, examples in (("targets", targets), ("rates", rates)):
        if len({case.run for case, _ in examples}) < 2:
            raise StudyError(f"Expected {name} of the teacher in at least two runs, found fewer.")
    return Policy(
        format=1,
        teacher=teacher,
        target=_fit_targets(targets, shape),
        rate=_fit_rates(rates, shape),
        report={"runs": len(runs), **_held_back(targets, rates, shape)},
    )


def _held_back(
    targets: Sequence[tuple[Case, str]], rates: Sequence[tuple[Case, float]], shape: Shape
) -> dict[str, float]:
    right: dict[int, list[bool]] = {}  # by run
    for training, new in _folds(targets):
        rule = _fit_targets(training, shape)
        for case, target in new:
            right.setdefault(case.run, []).append(decide(rule, case.known) == target)
    errors: list[float] = []
    for trained, held_back in _folds(rates):
        rule = _fit_rates(trained, shape)
        errors += [abs(float(decide(rule, case.known)) - rate) for case, rate in held_back]
    commonest = Counter(target for _, target in targets).most_common(1)[0][1]
    mean_rate = fmean(rate for _, rate in rates)
    all_hits = [hit for hits in right.values() for hit in hits]
    return {
        "targets": len(all_hits),
        "rates": len(errors),
        "target_agreement": fmean(all_hits),
        "target_agreement_least": min(map(fmean, right.values())),
        "target_commonest": commonest / len(targets),
        "rate_error": fmean(errors),
        "rate_error_mean": fmean(abs(rate - mean_rate) for _, rate in rates),
    }


def _folds(
    examples: Sequence[tuple[Case, T]],
) -> Iterator[tuple[list[tuple[Case, T]], list[tuple[Case, T]]]]:
    """The examples to train with and those held back, FOLDS times; each run is held back once."""
    runs = sorted({case.run for case, _ in examples})
    folds = min(FOLDS, len(runs))
    for fold in range(folds):
        out = set(runs[fold::folds])
        yield [e for e in examples if e[0].run not in out], [e for e in examples if e[0].run in out]


def _fit_targets(targets: Sequence[tuple[Case, str]], shape: Shape) -> Rule:
    from sklearn.tree import DecisionTreeClassifier  # type: ignore[import-untyped] # no stubs

    names = sorted({target for _, target in targets})
    places = [names.index(target) for _, target in targets]  # all of them occur
    return _fit(DecisionTreeClassifier, shape, targets, places, lambda n: names[int(n[0].argmax())])


def _fit_rates(rates: Sequence[tuple[Case, float]], shape: Shape) -> Rule:
    from sklearn.tree import DecisionTreeRegressor

    numbers = [rate for _, rate in rates]
    return _fit(DecisionTreeRegressor, shape, rates, numbers, lambda n: round(float(n[0][0]), 6))


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
