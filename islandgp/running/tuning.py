"""The numbers of a tree are tuned: Optuna proposes values, and trees race over worlds.

A batch of trials meets a few worlds at a time. A trial is given up where the Wilcoxon
signed-rank test finds it worse than the best so far in the same worlds (Optuna's
WilcoxonPruner). The best ones meet other worlds, in which one of them is chosen. Batches do
not depend on the number of workers, so neither does the result.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean
from typing import Final, TypeAlias

import optuna
from optuna.distributions import BaseDistribution, IntDistribution

from islandgp.bt.builder import MAX_NUMBER
from islandgp.bt.node import REPEATS as MOST_REPEATS
from islandgp.bt.numbers import REPEATS, Number
from islandgp.bt.vocabulary import Vocabulary
from islandgp.evaluation.base import Evaluator, evaluated
from islandgp.seeding import Stream, seed_of

BATCH: Final = 8  # trials that are proposed at a time
ROUND: Final = 5  # worlds that a batch meets at a time
WORSE: Final = 0.1  # p-value below which a trial is given up
FINALISTS: Final = 3  # that meet other worlds, in which one is chosen
MOST_VALUES: Final = 200  # of a number, but for the one that is written

Values: TypeAlias = tuple[float, ...]


def choices(number: Number, vocabulary: Vocabulary, repeats: int) -> tuple[float, ...]:
    """The values that a number may take, rising, the written one among them.

    Thresholds are those of random trees: a key's grid from `low` to `high`. What is compared with
    several keys keeps to the narrowest range and the widest step.

    Args:
        number: it is left as it is where nothing asks for it.
        vocabulary: declares the keys.
        repeats: most repetitions, or twice as many as are written.
    """
    keys = [vocabulary.keys[purpose] for purpose in number.purposes - {REPEATS}]
    ranges = [(key.low, key.high, key.step) for key in keys]
    if REPEATS in number.purposes:
        most = min(max(repeats, 2 * int(number.value)), MOST_REPEATS[1])
        ranges.append((1.0, float(most), 1.0))
    if not ranges:
        return (number.value,)
    low = max(-MAX_NUMBER, *(r[0] for r in ranges))
    high = min(MAX_NUMBER, *(r[1] for r in ranges))
    step = max((high - low) / MOST_VALUES, *(r[2] for r in ranges), 1e-9)
    count = int((high - low) / step + 1e-9) + 1 if low <= high else 0
    found = {round(low + index * step, 9) + 0.0 for index in range(count)}  # no -0
    if REPEATS in number.purposes:
        found = {value for value in found if value == int(value)}
    return tuple(sorted(found | {number.value}))


@dataclass(frozen=True, slots=True)
class RaceState:
    """How far a race has come."""

    trials: int  # proposed, the written numbers being the first
    different: int  # of them
    dropped: int  # different ones that were given up before the last world
    episodes: int
    finalists: tuple[Values, ...]  # the best of those that met every world, the best one first
    gained: float  # points, mean difference of the first of them to the written numbers


@dataclass(slots=True)
class _Entry:
    """Values that race."""

    values: Values
    points: list[float] = field(default_factory=list)  # by world, as far as it came
    dropped: bool = False


def race(
    tree: Callable[[Values], str],
    written: Values,
    allowed: Sequence[Sequence[float]],
    worlds: Sequence[int],
    evaluator: Evaluator,
    *,
    stage: int,
    trials: int,
    seed: int,
) -> Iterator[RaceState]:
    """How the race stands, after each batch and within it.

    Args:
        tree: the canonical text of the tree with these numbers.
        written: the numbers as they are.
        allowed: what each of them may become, rising, the written value among them.
        worlds: all that trees may meet; who meets them all can win.
        evaluator: runs the episodes.
        stage: index of the curriculum's stage that scores them.
        trials: how many are proposed after the written one; values that were proposed before
            cost no episode.
        seed: of the proposals.

    Raises:
        EvaluationError: an episode cannot be run.
    """
    study = _study(seed)
    space: dict[str, BaseDistribution] = {
        str(axis): IntDistribution(0, len(values) - 1) for axis, values in enumerate(allowed)
    }
    study.enqueue_trial({str(a): values.index(written[a]) for a, values in enumerate(allowed)})
    known: dict[Values, _Entry] = {}
    best: _Entry | None = None
    episodes = 0

    while len(study.trials) < trials + 1:
        size = min(BATCH, trials + 1 - len(study.trials)) if known else 1
        batch = [study.ask(space) for _ in range(size)]
        asked = [tuple(v[t.params[str(a)]] for a, v in enumerate(allowed)) for t in batch]
        judges = {v: t for v, t in zip(asked, batch, strict=True) if v not in known}
        entries = {values: _Entry(values) for values in judges}
        for start in range(0, len(worlds), ROUND):
            left = [entry for entry in entries.values() if not entry.dropped]
            episodes += _meet(left, tree, worlds[start : start + ROUND], evaluator, stage)
            for entry in left:
                trial = judges[entry.values]
                _report(trial, entry.points, start)
                if best is not None and len(entry.points) < len(worlds):
                    entry.dropped = _difference(entry, best) < 0 and trial.should_prune()
            if best is not None and left:
                yield _standing(study, known, written, episodes)
        known |= entries
        for trial, values in zip(batch, asked, strict=True):
            if judges.get(values) is not trial:  # else its points are reported already
                _report(trial, known[values].points, 0)
            study.tell(trial, _value(known[values], best))
        whole = [entry for entry in entries.values() if not entry.dropped]
        best = max([*([best] if best else []), *whole], key=lambda entry: fmean(entry.points))
        yield _standing(study, known, written, episodes)


def _standing(
    study: optuna.Study, known: Mapping[Values, _Entry], written: Values, episodes: int
) -> RaceState:
    whole = [entry for entry in known.values() if not entry.dropped]
    order = sorted(whole, key=lambda entry: -fmean(entry.points))
    return RaceState(
        len(study.trials),
        len(known),
        len(known) - len(whole),
        episodes,
        tuple(entry.values for entry in order[:FINALISTS]),
        _difference(order[0], known[written]),
    )


def choose(
    tree: Callable[[Values], str],
    finalists: Sequence[Values],
    worlds: Sequence[int],
    evaluator: Evaluator,
    stage: int,
) -> Values:
    """The finalist with the highest mean in these worlds, the first of them where several have it.

    The winner of a race has often been lucky with its worlds, so these are others.
    """
    entries = [_Entry(values) for values in finalists]
    _meet(entries, tree, worlds, evaluator, stage)
    return max(entries, key=lambda entry: fmean(entry.points)).values


def _study(seed: int) -> optuna.Study:
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    draws = seed_of(seed, Stream.TUNING, generation=1)
    with warnings.catch_warnings():  # the pruner calls itself experimental since 2024
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        pruner = optuna.pruners.WilcoxonPruner(p_threshold=WORSE)
    sampler = optuna.samplers.TPESampler(seed=draws)
    return optuna.create_study(sampler=sampler, pruner=pruner, direction="maximize")


def _meet(
    entries: Sequence[_Entry],
    tree: Callable[[Values], str],
    worlds: Sequence[int],
    evaluator: Evaluator,
    stage: int,
) -> int:
    """Lets each of the entries meet the worlds; returns the number of episodes."""
    if not entries:
        return 0
    found = evaluated(evaluator, [tree(entry.values) for entry in entries], stage, worlds)
    for entry, outcomes in zip(entries, found, strict=True):
        entry.points += [outcome.fitness for outcome in outcomes]
    return len(entries) * len(worlds)


def _report(trial: optuna.Trial, points: Sequence[float], start: int) -> None:
    """Tells a trial the points of the worlds from `start` on."""
    for step in range(start, len(points)):
        trial.report(points[step], step)


def _difference(entry: _Entry, best: _Entry) -> float:
    """Mean of the paired differences in the worlds that the entry has met."""
    return fmean(a - b for a, b in zip(entry.points, best.points, strict=False))


def _value(entry: _Entry, best: _Entry | None) -> float:
    """What Optuna is told: the mean; of a dropped entry what it would be, by the difference to
    the best so far in the worlds that it met, as its own may have been easy ones."""
    if not entry.dropped or best is None:
        return fmean(entry.points)
    return fmean(best.points) + min(0.0, _difference(entry, best))
