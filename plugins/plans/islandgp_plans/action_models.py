"""What actions need and give, learned from the episodes of a run.

For each action with its arguments, `ActionRecord` has samples of where it started, whether it
succeeded and what it changed: one for each cell of the blackboard, so that states which a robot
often visits do not outweigh rare ones. From these, `learn` finds

- `needs`: the shortest conjunction that separates success from failure, greedily;
- `gives`: the conditions that hold after a success and often did not before.

Conditions are flags, words, thresholds, and equality of two keys.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice, product
from typing import Final, NamedTuple

import numpy as np

from islandgp.bt.core.condition import Condition
from islandgp.bt.core.node import ActionArgs, Node
from islandgp.bt.core.parameters import leaf_of
from islandgp.bt.core.printer import condition_text
from islandgp.bt.core.vocabulary import Key, Vocabulary

BINS: Final = 4  # of a number's range
WORDLIKE: Final = 12  # a whole number with at most so many values has a cell for each
MAX_CELLS: Final = 80  # of an action and a result; the oldest are dropped first
MAX_NEEDS: Final = 5
MISSED: Final = 0.03  # share of the successes that a learned condition may exclude
HELD: Final = 0.9  # share of the successes after which an effect holds
MAX_ENDS: Final = 8  # of a cell in a small world
MAX_COMBINATIONS: Final = 60  # of the words of an action's arguments
ENOUGH: Final = 5  # cells of successes from which on a model is relied on
MANY: Final = 20  # cells of successes from which on a few failures may have no reason
OFTEN: Final = 100  # successes after which a model is relied on, from however few states
RELIABLE: Final = 3  # failures in a cell after which it counts in full
THRESHOLDS: Final = 8  # of a number that are tried

Board = tuple[float, ...]


class ActionSample(NamedTuple):
    """Some executions of an action in an episode that started and ended alike."""

    action: str  # text of the leaf, with its arguments
    succeeded: bool
    start: Board
    """The blackboard at the start of the first of them; () if another action succeeded right before
    in the same tick, and this one ended in it."""
    end: Board  # after its end; () if another action may have changed it
    points: float  # that the action earned, mean
    times: int  # executions, >= 1
    last: bool = False  # the episode ended right after it


def wordlike(key: Key) -> bool:
    """True for a key with few values: flags, words, and small whole numbers."""
    return key.flag or bool(key.words) or (key.whole and key.high - key.low < WORDLIKE)


def small_world(vocabulary: Vocabulary) -> bool:
    """True if all keys have few values, so that a cell is a state."""
    return bool(vocabulary.keys) and all(map(wordlike, vocabulary.keys.values()))


def cell_of(board: Sequence[float], vocabulary: Vocabulary) -> tuple[int, ...]:
    """The cell of a blackboard: its flags, words and small numbers, and the bins of others."""
    return tuple(
        int(value)
        if wordlike(key)
        else min(BINS - 1, max(0, int((value - key.low) / (key.high - key.low) * BINS)))
        for value, key in zip(board, vocabulary.keys.values(), strict=True)
    )


def without_numbers(action: Node, vocabulary: Vocabulary) -> Node:
    """The leaf with the defaults of its numbers: executions that differ in these are alike."""
    parameters = vocabulary.action(action.action).arguments
    if not any(each.numeric for each in parameters.values()):
        return action
    assert isinstance(action.args, ActionArgs)
    words = {k: v for k, v in action.args.values if not parameters[k].numeric}
    return leaf_of(action.action, words, parameters)


def all_leaves(vocabulary: Vocabulary) -> list[Node]:
    """The actions with each combination of their words, at most MAX_COMBINATIONS of each."""
    leaves = []
    for name, action in vocabulary.actions.items():
        if action.condition:  # without effect
            continue
        parameters = {k: p for k, p in action.arguments.items() if p.words}
        choices = islice(product(*(p.words for p in parameters.values())), MAX_COMBINATIONS)
        chosen = (dict(zip(parameters, values, strict=True)) for values in choices)
        leaves += [leaf_of(name, values, action.arguments) for values in chosen]
    return leaves


@dataclass(frozen=True, slots=True)
class Cell:
    """Executions of an action that started in one cell of the blackboard."""

    start: Board  # of the first one
    end: Board  # after the last one of which it is known; ()
    points: float  # that the action earned, mean
    count: int
    ends: tuple[tuple[Board, int], ...] = ()
    """In a small world: each known end and its number; () is the end of the episode."""


@dataclass(frozen=True, slots=True)
class ActionRecord:
    """Executions of an action with its arguments, by result and cell."""

    successes: tuple[Cell, ...] = ()
    failures: tuple[Cell, ...] = ()
    succeeded: int = 0
    failed: int = 0


def recorded(
    records: Mapping[str, ActionRecord], samples: Iterable[ActionSample], vocabulary: Vocabulary
) -> dict[str, ActionRecord]:
    """The records with further samples."""
    sides: dict[tuple[str, bool], dict[tuple[int, ...], Cell]] = {}
    counts: dict[tuple[str, bool], int] = {}
    small = small_world(vocabulary)

    def side(kind: tuple[str, bool]) -> dict[tuple[int, ...], Cell]:
        if kind not in sides:
            record = records.get(kind[0], ActionRecord())
            cells = record.successes if kind[1] else record.failures
            sides[kind] = {cell_of(cell.start, vocabulary): cell for cell in cells}
            counts[kind] = record.succeeded if kind[1] else record.failed
        return sides[kind]

    for sample in samples:
        kind = (sample.action, sample.succeeded)
        cells = side(kind)
        counts[kind] += sample.times
        if not sample.start:
            continue
        key = cell_of(sample.start, vocabulary)
        before = cells.pop(key, None) or Cell(sample.start, (), 0.0, 0)
        n = before.count + sample.times
        points = before.points + (sample.points - before.points) * sample.times / n
        ends = dict(before.ends)
        known = bool(sample.end) or sample.last
        if small and known and (sample.end in ends or len(ends) < MAX_ENDS):
            ends[sample.end] = ends.get(sample.end, 0) + sample.times
        end = sample.end or before.end
        cells[key] = Cell(before.start, end, points, n, tuple(ends.items()))
        if sample.end:  # the start and the end of the same execution
            cells[key] = replace(cells[key], start=sample.start)
        if len(cells) > MAX_CELLS:
            del cells[next(iter(cells))]
    updated = dict(records)
    for (action, succeeded), cells in sides.items():
        kept, n = tuple(cells.values()), counts[action, succeeded]
        old = updated.get(action, ActionRecord())
        if succeeded:
            updated[action] = replace(old, successes=kept, succeeded=n)
        else:
            updated[action] = replace(old, failures=kept, failed=n)
    return updated


@dataclass(frozen=True)
class ActionModel:
    """What an action with its arguments needs and gives."""

    leaf: Node
    text: str
    needs: tuple[Condition, ...] = ()
    facts: frozenset[Condition] = frozenset()  # hold in all successes, needed or not
    gives: tuple[Condition, ...] = ()  # of flags, words, and pairs of keys
    raises: Mapping[str, int] | None = None  # numbers that it changes: 1 larger, -1 smaller
    changes: frozenset[str] = frozenset()  # keys with few values that it often changes
    points: float = 0.0  # of a success, mean
    succeeded: int = 0
    failed: int = 0
    starts: int = 0  # cells of successes
    ends: int = 0  # of these, of which it is known what they changed

    @property
    def understood(self) -> bool:
        """True if it succeeded from enough different states to know what it needs and gives."""
        return self.ends >= ENOUGH or self.succeeded >= OFTEN

    @property
    def sentence(self) -> str:
        """For reports and prompts: `HandOver needs carrying; gives not carrying; ...`."""
        if not self.succeeded:
            return f"{self.text} never succeeded in {self.failed:,} starts"
        if not self.starts:
            return f"{self.text} succeeded only in the tick of another action; needs unknown"
        moved = self.raises or {}
        gives = [*map(condition_text, self.gives)]
        gives += [f"{'more' if up > 0 else 'less'} {key}" for key, up in moved.items()]
        parts = [
            f"{self.text} needs {' and '.join(map(condition_text, self.needs)) or 'nothing'}",
            f"gives {', '.join(gives) or 'nothing seen'}",
            *([f"earns {self.points:,.4g}"] if self.points > 0 else []),
            f"{self.succeeded:,} of {self.succeeded + self.failed:,} starts succeeded",
        ]
        return "; ".join(parts)


class Learner:
    """Learns models from records; the literals of a vocabulary are made once."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self.vocabulary = vocabulary
        self.words = [name for name, key in vocabulary.keys.items() if wordlike(key)]
        self.numbers = [name for name in vocabulary.keys if name not in self.words]

    def learn(self, text: str, action: Node, record: ActionRecord) -> ActionModel:
        """The model of an action; without successes, its declared conditions are its needs."""
        declaration = self.vocabulary.action(action.action)
        declared, given = declaration.to_start, declaration.gives
        if not record.successes:
            succeeded, failed = record.succeeded, record.failed
            return ActionModel(
                action, text, declared, gives=given, succeeded=succeeded, failed=failed
            )
        useful = [c for c in record.successes if self._useful(c)]
        points = float(np.mean([c.points for c in record.successes]))
        ended = [c for c in useful if c.end]
        needs = self._needs(useful, record.failures) if useful else ()
        return ActionModel(
            action,
            text,
            tuple(dict.fromkeys((*declared, *needs))),
            self._facts(useful),
            tuple(dict.fromkeys((*given, *self._gives(ended)))),
            self._raises(ended),
            frozenset(self._changes(ended)),
            points,
            record.succeeded,
            record.failed,
            len(record.successes),
            sum(bool(c.end) for c in record.successes),
        )

    def _useful(self, cell: Cell) -> bool:
        """True if the execution earned points or changed something by a visible step."""
        if cell.points or not cell.end:
            return True
        keys = self.vocabulary.keys.values()
        return any(
            abs(after - before) >= (1 if wordlike(key) else key.step)
            for before, after, key in zip(cell.start, cell.end, keys, strict=True)
        )

    @cached_property
    def literals(self) -> list[Condition]:
        """Conditions on flags, equality of two keys, words, then inequality."""
        keys = self.vocabulary.keys
        flags, equal, unequal = [], [], []
        for name in self.words:
            key = keys[name]
            if key.flag:
                flags += [Condition(name, "is", 0.0), Condition(name, "not", 0.0)]
                continue
            values = (
                [key.number_of(word) for word in key.words]
                if key.words
                else [float(v) for v in range(int(key.low), int(key.high) + 1)]
            )
            equal += [Condition(name, "==", value) for value in values]
            unequal += [Condition(name, "!=", value) for value in values]
        pairs = self.pairs
        return [
            *flags,
            *(Condition(a, "==", 0.0, b) for a, b in pairs),
            *equal,
            *unequal,
            *(Condition(a, "!=", 0.0, b) for a, b in pairs),
        ]

    @cached_property
    def pairs(self) -> list[tuple[str, str]]:
        """Keys with few values that can be compared with each other."""
        return [
            (a, b)
            for a in self.words
            for b in self.vocabulary.comparable(a)
            if a < b and b in self.words
        ]

    def holds(self, term: Condition, boards: np.ndarray) -> np.ndarray:
        """For each blackboard, whether a condition holds."""
        index = self.vocabulary.key_index
        left = boards[:, index[term.key]]
        if term.operator in ("is", "not"):
            result: np.ndarray = (left != 0) == (term.operator == "is")
            return result
        right = boards[:, index[term.other]] if term.other else float(term.number)
        compare = {
            "<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal,
            "==": np.equal, "!=": np.not_equal,
        }  # fmt: skip
        answer: np.ndarray = compare[term.operator](left, right)
        return answer

    def _thresholds(self, boards: np.ndarray) -> Iterator[Condition]:
        for name in self.numbers:
            key, values = self.vocabulary.keys[name], boards[:, self.vocabulary.key_index[name]]
            for value in np.unique(np.quantile(values, np.linspace(0, 1, THRESHOLDS + 2)[1:-1])):
                steps = round((float(value) - key.low) / key.step)
                number = round(key.low + steps * key.step, 9) + 0.0
                yield Condition(name, ">=", number)
                yield Condition(name, "<", number)

    def _needs(self, successes: Sequence[Cell], failures: Sequence[Cell]) -> tuple[Condition, ...]:
        """A short conjunction of conditions that hold in the successes and not in the failures."""
        possible = {cell_of(c.start, self.vocabulary) for c in successes}
        failed = [c for c in failures if cell_of(c.start, self.vocabulary) not in possible]
        if not failed:
            return ()
        good, bad = np.array([c.start for c in successes]), np.array([c.start for c in failed])
        weights = np.array([min(c.count, RELIABLE) / RELIABLE for c in failed])
        missed = int(MISSED * len(good))
        terms = [*self.literals, *dict.fromkeys(self._thresholds(np.vstack([good, bad])))]
        terms = [t for t in terms if np.sum(~self.holds(t, good)) <= missed]
        excluded = [~self.holds(t, bad) for t in terms]
        needs: list[int] = []
        left = np.ones(len(bad), bool)
        while terms and len(needs) < MAX_NEEDS:
            gains = [float(weights @ (left & e)) for e in excluded]
            best = int(np.argmax(gains))
            if gains[best] < max(0.99, MISSED * len(bad) * (len(good) > MANY)):
                break
            needs.append(best)
            left &= ~excluded[best]
        for k in list(needs):  # earlier ones may have become redundant
            others = [excluded[j] for j in needs if j != k]
            if others and np.sum(~np.logical_or.reduce(others)) <= np.sum(left):
                needs.remove(k)
        return tuple(terms[k] for k in needs)

    def _facts(self, cells: Sequence[Cell]) -> frozenset[Condition]:
        if not cells:
            return frozenset()
        starts = np.array([c.start for c in cells])
        return frozenset(term for term in self.literals if self.holds(term, starts).all())

    def _gives(self, cells: Sequence[Cell]) -> Iterator[Condition]:
        if not cells:
            return
        starts, ends = np.array([c.start for c in cells]), np.array([c.end for c in cells])
        for term in self.literals:
            after, before = self.holds(term, ends), self.holds(term, starts)
            least = 2 if term.other else 1  # two keys may become equal by chance
            changed = np.sum(after & ~before) >= max(least, 0.1 * len(cells))
            if term.operator != "!=" and changed and np.mean(after) >= HELD:
                yield term

    def _raises(self, cells: Sequence[Cell]) -> dict[str, int]:
        moved = {}
        for name in self.numbers:
            at, step = self.vocabulary.key_index[name], self.vocabulary.keys[name].step
            by = [c.end[at] - c.start[at] for c in cells]
            for sign in (1, -1):
                if (
                    by
                    and np.mean([sign * b >= step for b in by]) >= HELD
                    and sign * np.mean(by) > 0
                ):
                    moved[name] = sign
        return moved

    def _changes(self, cells: Sequence[Cell]) -> Iterator[str]:
        for name in self.words:
            at = self.vocabulary.key_index[name]
            if sum(c.end[at] != c.start[at] for c in cells) > 0.1 * len(cells):
                yield name
