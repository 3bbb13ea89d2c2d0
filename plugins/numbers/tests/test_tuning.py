"""Tuning: which numbers a file has, which are tuned, and what CMA-ES finds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from math import isclose
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.parameters import one_of, real
from islandgp.bt.core.parameters import text as text_argument
from islandgp.bt.core.vocabulary import Action, Vocabulary, enumeration, flag, number
from islandgp.errors import ConfigError
from islandgp_numbers.numbers import COUNT, EQUAL, numbers_of, with_numbers
from islandgp_numbers.tuning import NumberSettings, Tuned, thresholds_of, tuned
from tests.profiles import examples

MAZE = Vocabulary(
    "maze",
    {"Go": Action("goes")},
    {
        "charge": number("charge in %", 0, 100, 5),
        "lap": number("laps", 1, 4),
        "wall": flag("a wall is near"),
    },
)

FILE = """# What stays as it is: this comment.
constant low = 20  # percent
constant other = low
constant n = 3
constant nobody = 9
subtree inner(x, t) = when charge < x abort lower { repeater t { when lap >= low { Go } } }
subtree outer(low, unused) = use inner(low, 2)
selector {
  use outer(15.5, 8)
  use inner(other, n)
  when not charge < -3 and (lap > 1 or wall) { Go }
  repeater n { Go }
}
"""


def test_each_number_has_its_purposes() -> None:
    """Constants and parameters have those of all their uses; what nothing reads has none."""
    rows = [(n.label, n.value, set(n.purposes), n.line) for n in numbers_of(FILE, MAZE)]
    assert rows == [
        ("low =", 20.0, {"charge", "lap"}, 2),
        ("n =", 3.0, {COUNT}, 4),
        ("low ,", 2.0, {COUNT}, 7),
        ("outer (", 15.5, {"charge"}, 9),
        ("charge <", -3.0, {"charge"}, 11),
        ("lap >", 1.0, {"lap"}, 11),
    ]


def test_only_numbers_change() -> None:
    """With its own numbers a file is itself; with others, names and comments stay."""
    numbers = numbers_of(FILE, MAZE)
    assert with_numbers(FILE, numbers, [n.value for n in numbers]) == FILE
    changed = with_numbers(FILE, numbers, [n.value + 0.25 if n.value == 20 else 1 for n in numbers])
    assert "constant low = 20.25  # percent\nconstant other = low\nconstant n = 1\n" in changed
    assert re.sub(r"-?\d[\d.]*", "", changed) == re.sub(r"-?\d[\d.]*", "", FILE)


def test_included_numbers_are_left_out(tmp_path: Path) -> None:
    """Arguments for an included subtree are the file's own, the numbers in it are not."""
    (tmp_path / "lib.bt").write_text(
        "constant m = 4\nsubtree s(t) = repeater t { repeater m { Go }}"
    )
    text = 'include "lib.bt"\nsequence { use s(5) repeater m { Go } }'
    numbers = numbers_of(text, MAZE, folder=tmp_path)
    assert [(n.label, n.value, set(n.purposes)) for n in numbers] == [("s (", 5.0, {COUNT})]


def test_equality_is_a_purpose() -> None:
    """A number that `==` or `!=` compares, also by a constant, has it beside the key."""
    text = (
        "constant n = 2 selector { when lap == n { Go } when lap != 3 { Go } when lap > 1 { Go } }"
    )
    purposes = [(n.value, set(n.purposes)) for n in numbers_of(text, MAZE)]
    assert purposes == [(2.0, {"lap", EQUAL}), (3.0, {"lap", EQUAL}), (1.0, {"lap"})]


def test_which_numbers_are_tuned() -> None:
    """Those that order is asked of; counts, equalities and what nothing uses are left.

    A number of several keys has the range that they have in common and the finest step.
    """
    text = """
    constant shared = 3
    constant count = 2
    constant nobody = 9
    subtree s(t, times) = when charge <= t { repeater times { Go } }
    selector {
      use s(20, count)
      when charge < shared { when lap < shared { Go } }
      when lap == 2 or wall { Go }
      when charge >= 150 { repeater 3 { Go } }
    }
    """
    tuned_numbers = [
        (t.number.label, t.number.value, (t.key.low, t.key.high, t.key.step), t.bounds)
        for t in thresholds_of(text, MAZE)
    ]
    assert tuned_numbers == [
        ("shared =", 3, (1, 4, 1), (1, 4)),
        ("s (", 20, (0, 100, 5), (0, 100)),
        ("charge >=", 150, (0, 100, 5), (0, 250)),
    ]


def test_keys_without_a_common_range_share_no_threshold() -> None:
    """Nor is anything tuned in a range that is narrower than the digits of a file."""
    keys = {"a": number("", 0, 1), "b": number("", 2, 3), "c": number("", 0, 1e-9, 1e-9)}
    vocabulary = Vocabulary("maze", {"Go": Action("")}, keys)
    text = "constant n = 1 when a < n and b < n and c < 0.5 and b > 2 { Go }"
    assert [t.number.label for t in thresholds_of(text, vocabulary)] == ["b >"]


class Hill:
    """Points are highest at some thresholds, the same in all worlds but for the world's luck."""

    def __init__(self, *best: float, vocabulary: Vocabulary = MAZE, ends: int = 10**9) -> None:
        """The best thresholds of a tree, in its order; episode `ends` is interrupted."""
        self.best, self.vocabulary, self.ends = best, vocabulary, ends
        self.calls: list[tuple[tuple[str, ...], tuple[int, ...]]] = []

    @property
    def episodes(self) -> int:
        """The number of requested episodes."""
        return sum(len(trees) * len(worlds) for trees, worlds in self.calls)

    def __call__(self, trees: Sequence[str], worlds: Sequence[int]) -> list[list[float]]:
        """See `Evaluate`."""
        self.calls.append((tuple(trees), tuple(worlds)))
        if self.episodes > self.ends:
            raise KeyboardInterrupt
        losses = [self.loss(tree) for tree in trees]
        return [[self.points(loss, world % 1000) for world in worlds] for loss in losses]

    def loss(self, tree: str) -> float:
        """How far a tree's thresholds are from the best ones."""
        return sum(
            abs(t.number.value - best) / (t.key.high - t.key.low)
            for t, best in zip(thresholds_of(tree, self.vocabulary), self.best, strict=True)
        )

    def points(self, loss: float, luck: int) -> float:
        """A world is good or bad for all, and its slopes are steep or gentle."""
        return luck - 100 * loss * (1 + luck / 1000)


TREE = "selector { when charge < 60 { Go } when lap > 1.5 abort none { Go } Go }"
SMALL = NumberSettings(episodes=2_400, worlds=4)  # 40 generations


def run(
    hill: Hill, text: str = TREE, number_settings: NumberSettings = SMALL, seed: int = 1
) -> Tuned:
    """A tree that is tuned on the hill."""
    return tuned(text, hill, hill.vocabulary, number_settings, seed=seed)


@cache
def tuned_once() -> tuple[Hill, Tuned, list[int]]:
    """A hill, its tuned tree and the progress that was reported."""
    hill, progress = Hill(33.7, 2.62), list[int]()
    return hill, tuned(TREE, hill, MAZE, SMALL, seed=1, progress=progress.append), progress


def test_the_optimum_is_found_off_the_grid() -> None:
    """Thresholds come within the rounding of the best ones, which random trees cannot have."""
    _, result, _ = tuned_once()
    assert result.comparison is not None
    assert result.comparison.accepted
    assert result.comparison.better == result.comparison.worlds
    charge, lap = result.values
    assert abs(charge - 33.7) <= 0.3
    assert abs(lap - 2.62) <= 0.03
    expected = TREE.replace("60", f"{charge:g}").replace("1.5", f"{lap:g}")
    assert result.text == expected


def test_the_episodes_are_counted() -> None:
    """The costs are what the evaluator ran, within the budget; each call reports progress."""
    hill, result, progress = tuned_once()
    assert result.comparison is not None
    assert result.costs.total == hill.episodes == progress[-1] <= 2_400
    assert 12 * 4 * 10 < result.costs.search <= 1_920  # it converges before
    assert result.costs.comparison == 2 * result.comparison.worlds == 240
    assert 0 < result.costs.race <= 240
    assert len(progress) == len(hill.calls)


def test_worlds_of_each_individual() -> None:
    """All trees of a generation meet the same worlds; no two calls have a world in common."""
    hill, _, _ = tuned_once()
    worlds = [world for _, each in hill.calls for world in each]
    assert len(set(worlds)) == len(worlds)
    assert {len(each) for _, each in hill.calls[:10]} == {4}
    assert to_text(parse(TREE)) in hill.calls[-1][0]


def test_a_function_of_the_seed() -> None:
    """Equal seeds ask for the same episodes; others for other worlds and trees."""
    (before, end, _), same, other = tuned_once(), Hill(33.7, 2.62), Hill(33.7, 2.62)
    assert run(same, seed=1) == end
    assert same.calls == before.calls
    run(other, seed=2)
    assert other.calls != before.calls


def test_the_best_tree_stays() -> None:
    """Where the written numbers are the best, they win the race and nothing is compared."""
    result = run(Hill(60, 1.5))
    assert (result.text, result.values, result.comparison) == (TREE, (60, 1.5), None)
    assert result.costs.comparison == 0


def test_numbers_without_effect_stay() -> None:
    """Of equal trees the written one is kept, and the search stops before its budget is spent."""
    calls: list[int] = []

    def flat(trees: Sequence[str], worlds: Sequence[int]) -> list[list[float]]:
        calls.append(len(trees) * len(worlds))
        return [list(map(float, worlds)) for _ in trees]

    result = tuned(TREE, flat, MAZE, SMALL, seed=0)
    assert (result.text, result.comparison) == (TREE, None)
    assert result.costs.search < 0.8 * 2_400 * 0.6


def test_luck_is_not_accepted() -> None:
    """A difference that may be chance leaves the tree as it was, and reports the comparison."""

    def lucky(trees: Sequence[str], worlds: Sequence[int]) -> list[list[float]]:
        return [[float(hash_of(tree, world)) for world in worlds] for tree in trees]

    def hash_of(tree: str, world: int) -> int:
        return (sum(map(ord, tree)) * 7919 + world) * 104_729 % 1_000

    ends = [tuned(TREE, lucky, MAZE, SMALL, seed=seed) for seed in range(3)]
    rejected = [end for end in ends if end.comparison and not end.comparison.accepted]
    assert rejected
    assert all(end.text == TREE and end.values == (60, 1.5) for end in rejected)


def test_one_number() -> None:
    """CMA-ES searches one dimension, too."""
    text = "when charge > 40 { Go }"
    result = run(Hill(51.3), text)
    assert abs(result.values[0] - 51.3) <= 0.3
    assert result.text == f"when charge > {result.values[0]:g} {{ Go }}"


def test_a_constant_has_one_value() -> None:
    """It keeps its name and its comment in all uses; a number that stays keeps its digits."""
    text = (
        "# A robot\nconstant low = 40.0  # percent\n"
        "selector {\n  when charge < low { Go }  when charge >= low { repeater 02 { Go } }\n"
        "  when lap == 3.00 { Go }\n}\n"
    )

    def points(trees: Sequence[str], worlds: Sequence[int]) -> list[list[float]]:
        values = [[t.number.value for t in thresholds_of(tree, MAZE)] for tree in trees]
        assert all(a == b for a, b in values)
        return [[world % 7 - abs(a - 63.4) for world in worlds] for a, _ in values]

    result = tuned(text, points, MAZE, SMALL, seed=3)
    assert abs(result.values[0] - 63.4) <= 0.3
    assert result.text == text.replace("40.0", f"{result.values[0]:g}")


@pytest.mark.parametrize(
    "text",
    [
        "Go",
        "selector { Go when wall { Go } }",
        "repeater 3 { Go }",
        "when lap == 2 { Go }",
        "constant n = 3 Go",
    ],
)
def test_no_numbers(text: str) -> None:
    """A tree without thresholds costs nothing and comes out as it is."""
    hill = Hill()
    result = run(hill, text)
    assert (result.text, result.values, result.comparison) == (text, (), None)
    assert hill.calls == []
    assert result.costs.total == 0


@pytest.mark.parametrize(
    ("low", "high", "step", "value"),
    [
        (-1e6, 1e6, 1, 7),
        (0, 1e6, 1e-9, 500_000),
        (0, 1e-6, 1e-7, 0),
        (0, 1, 0.1, 1_000_000),
        (0, 1, 0.1, -1_000_000),
        (999_999, 1e6, 1, 999_999),
    ],
)
def test_any_range(low: float, high: float, step: float, value: float) -> None:
    """Candidates of a key with any range stay in it and can be read."""
    vocabulary = Vocabulary("maze", {"Go": Action("")}, {"far": number("", low, high, step)})
    hill = Hill(0, vocabulary=vocabulary)
    result = run(hill, f"when far < {value} {{ Go }}", NumberSettings(episodes=300, worlds=2))
    tuned_thresholds = [
        t for trees, _ in hill.calls for tree in trees for t in thresholds_of(tree, vocabulary)
    ]
    low_bound, high_bound = result.thresholds[0].bounds
    assert len(tuned_thresholds) > 12
    assert all(low_bound <= t.number.value <= high_bound for t in tuned_thresholds)


@given(st.integers(2, 40), st.integers(1, 20_000), st.integers(1, 100), st.integers(2, 30))
@examples(max_examples=200)
def test_a_plan_keeps_to_its_episodes(
    worlds: int, episodes: int, dimensions: int, population: int
) -> None:
    """There is a generation, a race of two and a comparison, or an error with the minimum."""
    number_settings = NumberSettings(episodes=episodes, worlds=worlds, population=population)
    try:
        plan = number_settings.plan(dimensions)
    except ConfigError as error:
        match = re.search(r"at least ([\d,]+) episodes", str(error))
        assert match is not None
        minimum = int(match[1].replace(",", ""))
        assert minimum > episodes
        assert NumberSettings(minimum, worlds, population).plan(dimensions).generations == 1
        return
    search = plan.generations * plan.population * worlds
    assert plan.generations >= 1
    assert plan.comparing >= 2
    assert plan.racing >= 4
    assert search + plan.racing + 2 * plan.comparing == episodes


@pytest.mark.parametrize(("worlds", "episodes"), [(2, 32), (4, 61), (16, 240), (16, 700)])
def test_small_budgets(worlds: int, episodes: int) -> None:
    """The least budget is enough, and none is overspent."""
    hill = Hill(33.7, 2.62)
    result = run(hill, number_settings=NumberSettings(episodes, worlds))
    assert result.costs.total == hill.episodes <= episodes


def test_the_numbers_of_sums_are_tuned() -> None:
    """Weights and thresholds of sums have ranges of their own, and keep their place."""
    found = thresholds_of("when 0.5 * lap + charge / 4 > 20 { Go }", MAZE)
    assert [(each.number.value, each.bounds) for each in found] == [
        (0.5, (-1, 1)),
        (4, (-8, 8)),
        (20, (-40, 40)),
    ]


def test_too_few_episodes() -> None:
    """It is one error, before any episode."""
    hill = Hill(33.7, 2.62)
    with pytest.raises(ConfigError, match="Expected at least 60 episodes: a generation is 12"):
        run(hill, number_settings=NumberSettings(episodes=59))
    assert hill.calls == []


def test_an_interruption_is_passed_on() -> None:
    """Ctrl-C ends the search at once."""
    hill = Hill(33.7, 2.62, ends=500)
    with pytest.raises(KeyboardInterrupt):
        run(hill)
    assert hill.episodes <= 500 + 48


def test_the_intervals() -> None:
    """Before, after and difference are paired: means differ by the mean difference."""
    comparison = tuned_once()[1].comparison
    assert comparison is not None
    difference = comparison.tuned[0] - comparison.written[0]
    assert isclose(difference, comparison.difference[0])
    width = comparison.difference[2] - comparison.difference[1]
    assert 0 < width < comparison.written[2] - comparison.written[1]


def test_words_and_texts_in_place_of_parameters_are_no_numbers() -> None:
    """A word, a text and a key are passed beside a number; a constant may have a word's name."""
    vocabulary = Vocabulary(
        "bot",
        {
            "Go": Action(
                "", arguments={"to": one_of("", ("dock", "door")), "speed": real("", 0, 2)}
            ),
            "Say": Action("", arguments={"what": text_argument("")}),
        },
        {"place": enumeration("", ("dock", "door"))},
    )
    text = """constant dock = 1
subtree go(where, speed, what) = when place == where {
  sequence { Go(to: where, speed: speed) Say(what: what) Go(to: dock) }
}
use go(door, 0.5, "on my way")
"""
    numbers = numbers_of(text, vocabulary)
    assert [(n.value, n.purposes) for n in numbers] == [(0.5, {"Go.speed"})]

    def evaluate(trees: Sequence[str], worlds: Sequence[int]) -> list[list[float]]:
        for tree in trees:
            assert to_text(parse(tree, vocabulary)) == tree
        matches = [re.search(r"speed: ([0-9.]+)", tree) for tree in trees]
        speeds = [float(each[1]) if each else 1.0 for each in matches]  # the default is left out
        return [[-abs(speed - 1.5)] * len(worlds) for speed in speeds]

    result = tuned(text, evaluate, vocabulary, SMALL, seed=0)
    assert result.text.startswith("constant dock = 1\n")
    assert isclose(result.values[0], 1.5, abs_tol=0.1)
