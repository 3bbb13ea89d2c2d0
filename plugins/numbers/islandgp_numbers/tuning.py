"""Tunes the thresholds of a tree by CMA-ES, starting from the written values.

CMA-ES (Hansen 2016, arXiv 1604.00772) samples trees near the written one. All trees of a generation
are evaluated in the same worlds, and each generation in new ones (common random numbers). Then a
race by successive halving, in other worlds, selects among means of the distribution, the best trees
of the last generations and the written tree. The winner is accepted if it is better than
the written tree by the paired differences in a third set of worlds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import count, islice
from math import ceil, log
from pathlib import Path
from statistics import fmean
from typing import Final, TypeAlias

import numpy as np

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node_builder import MAX_NUMBER
from islandgp.bt.core.vocabulary import Key, Vocabulary, number
from islandgp.errors import ConfigError
from islandgp.gp.branches import fine
from islandgp.scoring.constraints import merit
from islandgp.seeding import Stream, seed_of
from islandgp.statistics import mean_interval
from islandgp_numbers.cma import Cma
from islandgp_numbers.numbers import (
    COUNT,
    EQUAL,
    WEIGHT,
    Number,
    argument_purpose,
    numbers_of,
    with_numbers,
)

SEARCH: Final = Fraction(4, 5)  # of the episodes; half of the rest is to race, half to compare
RACING: Final = 8  # most trees in the race, including the written one
MIN_WORLDS: Final = 2  # an interval needs two
MIN_RANGE: Final = 1e-7  # of a key; `fine` rounds to 9 decimals

Values: TypeAlias = tuple[float, ...]
"""A value for each threshold that is tuned."""

Evaluate: TypeAlias = Callable[[Sequence[str], Sequence[int]], Sequence[Sequence[float]]]
"""(trees as canonical text, world seeds) -> the points of each tree in each world."""

MeanInterval: TypeAlias = tuple[float, float, float]
"""A mean and the ends of its 95 % interval, points."""


@dataclass(frozen=True, slots=True)
class Threshold:
    """A number in a file that is tuned."""

    number: Number
    key: Key  # the common range and step of the keys that are compared with it
    bounds: tuple[float, float]  # the range of search; wider than the key's if the value is outside

    def at(self, offset: float) -> float:
        """The rounded value at an offset from the written one, as a share of the range."""
        low, high = self.bounds
        within = replace(self.key, low=low, high=high)
        return fine(self.number.value + offset * (self.key.high - self.key.low), within)


@dataclass(frozen=True, slots=True)
class EpisodePlan:
    """Division of a budget of episodes."""

    population: int  # trees of a generation
    generations: int  # at most; the search stops early if it has converged
    racing: int  # most episodes of the race
    comparing: int  # worlds of the comparison


@dataclass(frozen=True, slots=True)
class NumberSettings:
    """Range and budget of the search for thresholds."""

    episodes: int = 9_600  # most episodes in total
    worlds: int = 4  # of each generation, >= MIN_WORLDS
    population: int = 12  # trees of a generation; more with more than 14 thresholds, as in Hansen
    sigma: float = 0.1  # initial standard deviation, as a share of a key's range

    def plan(self, dimensions: int) -> EpisodePlan:
        """The division of the episodes, for a number of thresholds.

        Raises:
            ConfigError: too few episodes for one generation, the race and the comparison.
        """
        population = max(self.population, 4 + int(3 * log(dimensions)))
        generation = population * self.worlds
        generations = int(SEARCH * self.episodes / generation)
        rest = self.episodes - generations * generation
        comparing = rest // 4
        racing = rest - 2 * comparing
        if generations < 1 or comparing < MIN_WORLDS:
            minimum = max(ceil(generation / SEARCH), generation + 4 * MIN_WORLDS)
            raise ConfigError(
                f"Expected at least {minimum:,} episodes: a generation is {population} trees in"
                f" {self.worlds} worlds, and a race and a comparison follow; found"
                f" {self.episodes:,}. Give more episodes, or fewer worlds."
            )
        return EpisodePlan(population, generations, racing, comparing)


@dataclass(frozen=True, slots=True)
class NumberComparison:
    """A comparison of two trees in the same worlds, which were not used to choose them."""

    worlds: int
    written: MeanInterval
    tuned: MeanInterval
    difference: MeanInterval  # tuned minus written, paired by world
    better: int  # worlds in which the tuned tree has more points

    @property
    def accepted(self) -> bool:
        """True if the whole interval of the difference is above 0."""
        return self.difference[1] > 0


@dataclass(frozen=True, slots=True)
class EpisodeCosts:
    """Episodes, by purpose."""

    search: int = 0
    race: int = 0
    comparison: int = 0

    @property
    def total(self) -> int:
        """Number of all episodes."""
        return self.search + self.race + self.comparison


@dataclass(frozen=True, slots=True)
class Tuned:
    """The result of tuning a tree."""

    text: str  # with the new values if they are accepted, else the unchanged text
    thresholds: tuple[Threshold, ...]
    values: Values  # of the thresholds in `text`
    comparison: NumberComparison | None  # None: the written tree won the race, or there was no race
    costs: EpisodeCosts


def thresholds_of(
    text: str, vocabulary: Vocabulary, *, name: str = "<tree>", folder: Path | None = None
) -> list[Threshold]:
    """The numbers of a tree file that can be tuned, in order of occurrence.

    These are the numbers that `<`, `<=`, `>` and `>=` compare with a key, directly or through a
    constant or a parameter, and those of sums. Counts of repeaters, numbers in `==` or `!=`, unused
    numbers and those of included files are not tuned.

    Args:
        text: of the file, or canonical text.
        vocabulary: declares the keys.
        name: of the file in messages.
        folder: of the included files.

    Raises:
        TreeError: the text is no tree of the vocabulary.
    """
    arguments = {
        argument_purpose(name, key): number(
            "", p.low, p.high, p.step or p.high - p.low, most=p.high
        )
        for name, action in vocabulary.actions.items()
        for key, p in action.arguments.items()
        if p.sort == "number"
    }
    thresholds = []
    for each in numbers_of(text, vocabulary, name=name, folder=folder):
        if not each.purposes or each.purposes & {COUNT, EQUAL}:
            continue
        reach = max(1.0, 2 * abs(each.value))
        ranges = {**vocabulary.keys, **arguments, WEIGHT: number("", -reach, reach, reach / 100)}
        keys = [ranges[purpose] for purpose in each.purposes if purpose in ranges]
        if len(keys) < len(each.purposes):  # a whole number
            continue
        low = max(-MAX_NUMBER, *(key.low for key in keys))
        high = min(MAX_NUMBER, *(key.high for key in keys))
        if high - low < MIN_RANGE:  # the range may be empty
            continue
        common = number("", low, high, min(key.step for key in keys))
        common = replace(common, whole=any(key.whole for key in keys))
        upper_limit = min((key.most for key in keys if key.most is not None), default=MAX_NUMBER)
        thresholds.append(Threshold(each, common, _bounds(each.value, common, upper_limit)))
    return thresholds


def _bounds(original: float, key: Key, upper_limit: float) -> tuple[float, float]:
    """The bounds of a threshold: the key's range, extended by its width if the value is above it.

    Args:
        original: the value.
        key: its range.
        upper_limit: greatest value of the key.
    """
    high = key.high
    if original > high:
        high = min(original + high - key.low, upper_limit, MAX_NUMBER)
    return min(key.low, original), max(high, original)


def tuned(
    text: str,
    evaluate: Evaluate,
    vocabulary: Vocabulary,
    settings: NumberSettings | None = None,
    *,
    seed: int,
    name: str = "<tree>",
    folder: Path | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> Tuned:
    """Search for better thresholds of a tree.

    The result is a function of the arguments. A tree without thresholds uses no episodes.

    Args:
        text: of a file, whose comments and layout are kept; `to_text(node)` for a Node.
        evaluate: runs episodes; called once per generation and per round of the race.
        vocabulary: declares the keys.
        settings: default: NumberSettings().
        seed: of the worlds and of CMA-ES, >= 0.
        name, folder: as for `thresholds_of`.
        progress: called with the number of episodes so far.

    Returns:
        The tree with better thresholds, or unchanged if none are found; with the comparison.

    Raises:
        TreeError: the text is no tree of the vocabulary.
        ConfigError: the settings have too few episodes.
    """
    settings = settings or NumberSettings()
    thresholds = tuple(thresholds_of(text, vocabulary, name=name, folder=folder))
    original = tuple(each.number.value for each in thresholds)
    if not thresholds:
        return Tuned(text, (), (), None, EpisodeCosts())
    plan = settings.plan(len(thresholds))
    candidates = _Candidates(text, vocabulary, thresholds, evaluate, name, folder, progress)
    worlds = _new_worlds(seed)

    best = _search(candidates, settings, plan, worlds, seed)
    searching = candidates.episodes
    winner = _race(candidates, [original, *best], plan.racing, worlds)
    racing = candidates.episodes - searching
    if winner == original:
        return Tuned(text, thresholds, original, None, EpisodeCosts(searching, racing))
    comparison = _compare(candidates, original, winner, list(islice(worlds, plan.comparing)))
    costs = EpisodeCosts(searching, racing, candidates.episodes - searching - racing)
    if not comparison.accepted:
        return Tuned(text, thresholds, original, comparison, costs)
    return Tuned(candidates.text(winner), thresholds, winner, comparison, costs)


class _Candidates:
    """Evaluates the file's tree with other values of its thresholds, and counts the episodes."""

    def __init__(
        self,
        text: str,
        vocabulary: Vocabulary,
        thresholds: Sequence[Threshold],
        evaluate: Evaluate,
        name: str,
        folder: Path | None,
        progress: Callable[[int], None],
    ) -> None:
        self.thresholds = thresholds
        self.episodes = 0
        self._text, self._words, self._evaluate = text, vocabulary, evaluate
        self._name, self._folder, self._progress = name, folder, progress

    def text(self, values: Values) -> str:
        """The file with these values; a number whose value is unchanged keeps its digits."""
        pairs = zip(self.thresholds, values, strict=True)
        changed = [(t.number, value) for t, value in pairs if t.number.value != value]
        return with_numbers(self._text, [n for n, _ in changed], [v for _, v in changed])

    def points(self, trees: Sequence[Values], worlds: Sequence[int]) -> list[list[float]]:
        """The points of each tree in each world. Raises LimitError if a tree is too long."""
        texts = [
            to_text(parse(self.text(values), self._words, name=self._name, folder=self._folder))
            for values in trees
        ]
        points = [list(row) for row in self._evaluate(texts, worlds)]
        self.episodes += len(trees) * len(worlds)
        self._progress(self.episodes)
        return points


def _search(
    candidates: _Candidates,
    settings: NumberSettings,
    plan: EpisodePlan,
    worlds: Iterator[int],
    seed: int,
) -> list[Values]:
    """Means of CMA-ES, an eighth of the search apart, then the best values; the latest first."""
    axes = candidates.thresholds
    scales = [axis.key.high - axis.key.low for axis in axes]
    optimizer = Cma(
        np.zeros(len(axes)),
        settings.sigma,
        bounds=np.array(
            [
                [(end - axis.number.value) / scale for end in axis.bounds]
                for axis, scale in zip(axes, scales, strict=True)
            ]
        ),
        size=plan.population,
        seed=seed_of(seed, Stream.TUNING, generation=1),
    )
    winners: list[Values] = []
    means_of_search: list[Values] = []
    for _ in range(plan.generations):
        samples = optimizer.ask()
        values = [_rounded(axes, offsets) for offsets in samples]
        trees = list(dict.fromkeys(values))
        fitness = candidates.points(trees, list(islice(worlds, settings.worlds)))
        means = {tree: fmean(points) for tree, points in zip(trees, fitness, strict=True)}
        best = max(trees, key=means.__getitem__)
        winners.append(best)
        optimizer.tell(samples, [merit(means[tree], 0.0) for tree in values])
        means_of_search.append(_rounded(axes, optimizer.mean))
        if len(trees) == 1 or optimizer.converged:
            break
    spaced = means_of_search[:: -ceil(len(means_of_search) / 8)]
    return [*spaced[: RACING // 2], *reversed(winners)]


def _rounded(axes: Sequence[Threshold], offsets: Sequence[float] | np.ndarray) -> Values:
    return tuple(axis.at(float(offset)) for axis, offset in zip(axes, offsets, strict=True))


def _race(
    candidates: _Candidates, trees: Sequence[Values], episodes: int, worlds: Iterator[int]
) -> Values:
    """The winner of a race by successive halving; the first of equal trees.

    The number of trees is limited so that each has MIN_WORLDS new worlds in each round.
    """
    distinct = list(dict.fromkeys(trees))
    n = min(RACING, len(distinct))
    while n > 2 and episodes // len(_halving(n)) // n < MIN_WORLDS:
        n -= 1
    points: dict[Values, list[float]] = {tree: [] for tree in distinct[:n]}
    sizes = _halving(n)
    for size in sizes:
        racers = sorted(points, key=lambda tree: -_mean(points[tree]))[:size]
        new = list(islice(worlds, episodes // len(sizes) // size))
        fitness = candidates.points(racers, new)
        points = {tree: points[tree] + scores for tree, scores in zip(racers, fitness, strict=True)}
    return max(points, key=lambda tree: _mean(points[tree]))


def _halving(n: int) -> list[int]:
    """The number of trees in each round: n, n / 2, ..., 2; none for a single tree."""
    sizes = []
    while n > 1:
        sizes.append(n)
        n = max(2, (n + 1) // 2) if n > 2 else 1
    return sizes


def _mean(points: Sequence[float]) -> float:
    return fmean(points) if points else 0.0  # before the first round all are equal


def _compare(
    candidates: _Candidates, original: Values, winner: Values, worlds: Sequence[int]
) -> NumberComparison:
    before, after = candidates.points([original, winner], worlds)
    differences = [b - a for a, b in zip(before, after, strict=True)]
    better = sum(difference > 0 for difference in differences)
    gain = mean_interval(differences)
    return NumberComparison(len(worlds), mean_interval(before), mean_interval(after), gain, better)


def _new_worlds(seed: int) -> Iterator[int]:
    """Distinct world seeds, without end."""
    used: set[int] = set()
    for slot in count():
        world = seed_of(seed, Stream.TUNING, slot=slot)
        if world not in used:
            used.add(world)
            yield world
