"""Tuning: what numbers stand in a file, what they may become, and how values race."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import pytest

from islandgp.bt.language import parse, to_text
from islandgp.bt.numbers import REPEATS, Number, numbers_of, with_numbers
from islandgp.bt.vocabulary import Action, Vocabulary, flag, number
from islandgp.domain import Outcome
from islandgp.evaluation.base import Job
from islandgp.running.tuning import FINALISTS, RaceState, Values, choices, choose, race
from tests.made import outcome

WORDS = Vocabulary(
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
    """Constants and parameters have those of all their uses; what nothing asks for has none."""
    found = [(n.label, n.value, set(n.purposes), n.line) for n in numbers_of(FILE, WORDS)]
    assert found == [
        ("constant low =", 20.0, {"charge", "lap"}, 2),
        ("constant n =", 3.0, {REPEATS}, 4),
        ("constant nobody =", 9.0, set(), 5),
        ("use inner: t =", 2.0, {REPEATS}, 7),
        ("use outer: low =", 15.5, {"charge"}, 9),
        ("use outer: unused =", 8.0, set(), 9),
        ("charge <", -3.0, {"charge"}, 11),
        ("lap >", 1.0, {"lap"}, 11),
    ]


def test_only_numbers_change() -> None:
    """With its own numbers a file is itself; with others, names and comments stay."""
    found = numbers_of(FILE, WORDS)
    assert with_numbers(FILE, found, [n.value for n in found]) == FILE
    changed = with_numbers(FILE, found, [n.value + 0.25 if n.value == 20 else 1 for n in found])
    assert "constant low = 20.25  # percent\nconstant other = low\nconstant n = 1\n" in changed
    assert re.sub(r"-?\d[\d.]*", "", changed) == re.sub(r"-?\d[\d.]*", "", FILE)


def test_included_numbers_are_left_out(tmp_path: Path) -> None:
    """Arguments for an included subtree are the file's own, the numbers in it are not."""
    (tmp_path / "lib.bt").write_text(
        "constant m = 4\nsubtree s(t) = repeater t { repeater m { Go }}"
    )
    text = 'include "lib.bt"\nsequence { use s(5) repeater m { Go } }'
    found = numbers_of(text, WORDS, folder=tmp_path)
    assert [(n.label, n.value, set(n.purposes)) for n in found] == [("use s: t =", 5.0, {REPEATS})]


def asked(value: float, *purposes: str) -> Number:
    """A number for these purposes."""
    return Number("", value, frozenset(purposes), 1, 0, 1)


@pytest.mark.parametrize(
    ("one", "values"),
    [
        (asked(2, "lap"), (1, 2, 3, 4)),
        (asked(2.5, "lap"), (1, 2, 2.5, 3, 4)),
        (asked(-7, "lap"), (-7, 1, 2, 3, 4)),
        (asked(12.5, "lap", "charge"), (1, 12.5)),
        (asked(1, REPEATS), (1, 2, 3)),
        (asked(4, REPEATS), (1, 2, 3, 4, 5, 6, 7, 8)),
        (asked(100, REPEATS), tuple(range(1, 101))),
        (asked(2, REPEATS, "lap"), (1, 2, 3, 4)),
        (asked(9), (9,)),
    ],
)
def test_choices(one: Number, values: tuple[float, ...]) -> None:
    """A key's grid or 1 to the most repetitions, and the value as it is written."""
    assert choices(one, WORDS, 3) == values


@pytest.mark.parametrize(("low", "high", "step"), [(0, 1e9, 1e-300), (-1e300, 1e300, 1)])
def test_choices_are_bounded(low: float, high: float, step: float) -> None:
    """A key with any range has few values, all of which the language can say."""
    words = Vocabulary("maze", {"Go": Action("")}, {"far": number("", low, high, step)})
    found = choices(asked(7, "far"), words, 3)
    assert 100 < len(found) < 205
    for value in (found[0], found[-1]):
        text = with_numbers("when far < 7 { Go }", [Number("", 7, frozenset(), 1, 11, 12)], [value])
        parse(text, words)


class Hilly:
    """An evaluator whose points are best at `charge < 35` and two repetitions, in any world."""

    def __init__(self, *, ends: int = 10**9) -> None:
        """It is interrupted when it has run `ends` episodes."""
        self.jobs: list[Job] = []
        self.ends = ends

    @property
    def simulated(self) -> int:
        """See `Evaluator`."""
        return len(self.jobs)

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        self.jobs += jobs
        if len(self.jobs) > self.ends:
            raise KeyboardInterrupt
        return [outcome(points(job)) for job in jobs]

    def close(self) -> None:
        """Nothing is held."""


def points(job: Job) -> float:
    """What a tree earns: its numbers, and a world that is good or bad for all."""
    charge, count = map(float, re.findall(r"\d+", job.tree))
    luck = job.seed * 7919 % 1000
    return luck - abs(charge - 35) * (1 + luck / 1000) - 10 * abs(count - 2)


TREE = "when charge < 95 { repeater 5 { Go } }"
NUMBERS = numbers_of(TREE, WORDS)
ALLOWED = [choices(n, WORDS, 5) for n in NUMBERS]


def text_of(values: Values) -> str:
    """The canonical text with these numbers."""
    return to_text(parse(with_numbers(TREE, NUMBERS, values)))


def raced(evaluator: Hilly, trials: int = 40, seed: int = 1) -> list[RaceState]:
    """All standings of a race from the numbers of TREE."""
    found = race(text_of, (95, 5), ALLOWED, range(20), evaluator, stage=0, trials=trials, seed=seed)
    return list(found)


def test_a_race_finds_better_numbers() -> None:
    """The best trees met every world, the others were given up before; nobody meets one twice."""
    evaluator = Hilly()
    last = raced(evaluator)[-1]
    assert last.trials == 41
    assert len(last.finalists) == FINALISTS
    best = last.finalists[0]
    assert abs(best[0] - 35) <= 5
    assert abs(best[1] - 2) <= 1
    assert last.gained > 60
    assert len(set(evaluator.jobs)) == len(evaluator.jobs) == last.episodes
    assert last.dropped > last.different / 2
    assert last.episodes < last.different * 20 * 2 / 3
    trees = [job.tree for job in evaluator.jobs]
    assert [trees.count(text_of(values)) for values in last.finalists] == [20] * FINALISTS
    tried = {job.tree for job in evaluator.jobs}
    top = max(tried, key=lambda text: sum(points(Job(text, 0, world)) for world in range(20)))
    assert top == text_of(best)


def test_a_race_is_a_function_of_its_seed() -> None:
    """The same seed proposes the same trees in the same order."""
    runs = [Hilly(), Hilly(), Hilly()]
    ends = [raced(each, 20, seed)[-1] for each, seed in zip(runs, (1, 1, 2), strict=True)]
    assert runs[0].jobs == runs[1].jobs
    assert runs[0].jobs != runs[2].jobs
    assert ends[0] == ends[1]


def test_a_race_with_one_value_ends() -> None:
    """Proposals that were there before cost no episode."""
    evaluator = Hilly()
    found = race(
        text_of, (95, 5), [(35, 95), (5,)], range(4), evaluator, stage=0, trials=30, seed=0
    )
    last = list(found)[-1]
    assert (last.trials, last.different, last.episodes) == (31, 2, 8)
    assert last.finalists == ((35, 5), (95, 5))


def test_what_an_interrupted_race_knows() -> None:
    """The standing before Ctrl-C is there, with the best of those that had met every world."""
    whole = raced(Hilly(), 20)
    going = race(text_of, (95, 5), ALLOWED, range(20), Hilly(ends=150), stage=0, trials=20, seed=1)
    kept: list[RaceState] = []
    with pytest.raises(KeyboardInterrupt):
        kept.extend(going)  # what came before the interruption stays
    assert kept == whole[: len(kept)]
    assert 100 < kept[-1].episodes <= 150


def test_the_choice_is_made_in_other_worlds() -> None:
    """The highest mean of these worlds; the first of equals."""
    evaluator = Hilly()
    assert choose(text_of, [(95, 5), (35, 3), (30, 2)], range(100, 104), evaluator, 0) == (30, 2)
    assert {job.seed for job in evaluator.jobs} == set(range(100, 104))
    assert choose(text_of, [(95, 5), (35, 2), (35, 2)], range(3), Hilly(), 0) == (35, 2)


def test_no_numbers() -> None:
    """A tree without numbers has none."""
    assert numbers_of("selector { Go when wall { Go } }", WORDS) == []
