"""Rules of a tree's guards: `never ACTION while CONDITION`, proven or refuted.

`never Drive(speed > 0.5) while near` is about the calls with such arguments, `never base while
near` about all actions that use the resource `base`.

A rule is broken by a tick in which the action is called, started or resumed, on a blackboard on
which the condition holds. Any blackboard may follow any other one, within the ranges of the keys,
and an action may return each of its statuses. So a proof holds in every world; a refutation is a
sequence of blackboards that breaks the rule, which a particular world may never show.

`invariants` first tries to prove the rule by one walk through the tree. If that fails, a
breadth-first search visits the states (memories) of the tree, until it finds a blackboard that
breaks the rule, has visited all states, or has no steps left.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from typing import Final, Literal, NamedTuple

from islandgp.bt.analysis.context import root_context
from islandgp.bt.core.condition import ConditionExpr, condition, opposite, terms
from islandgp.bt.core.engine import compile_tree
from islandgp.bt.core.kinds import TIMED, is_opaque, kind_of
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import ActionArgs, Node, asked_in, keys_in, leaf, walk
from islandgp.bt.core.parameters import Parameter, bound
from islandgp.bt.core.vocabulary import Action, Key, Vocabulary, enumeration, flag, number
from islandgp.errors import TreeError
from islandgp_verify.boards import NO_BOARD, Boards, BoardSets
from islandgp_verify.invariants import boards_of_nodes
from islandgp_verify.machine import Machine
from islandgp_verify.moves import ActionCalls, Memory, Search, SpentError

STEPS: Final = 200_000  # default of the search; takes some seconds
MAX_CELLS: Final = 2_000  # most classes of blackboards

_SHOWN: Final = 200  # characters of a rule in messages
_RULE: Final = re.compile(
    r"\s*never\s+(\w+)(?:\s*\(\s*(\S.*?)\s*\))?\s+while\s+(\S.*?)\s*", re.DOTALL
)
_PLACE: Final = re.compile(r"^.*?:\d+:\d+: ")


@dataclass(frozen=True, slots=True)
class Rule:
    """An action is never called on a blackboard on which a condition holds."""

    text: str  # as it was written
    actions: tuple[str, ...]  # one, or all that use a resource
    condition: ConditionExpr
    arguments: ConditionExpr | None = None  # of the calls that it forbids; None: all of them

    def forbids(self, args: ActionArgs, vocabulary: Vocabulary) -> bool:
        """True if the rule is about a leaf with this action and these arguments."""
        if self.arguments is None or args.name not in self.actions:
            return args.name in self.actions
        parameters = vocabulary.action(args.name).arguments
        keys = _keys_of(parameters)
        values = bound(args, parameters)
        board = [
            key.number_of(value) if isinstance(value := values[name], str) else float(value)
            for name, key in keys.items()
        ]
        index = {name: place for place, name in enumerate(keys)}
        return condition(self.arguments, board, index)()


@dataclass(frozen=True, slots=True)
class CounterTick:
    """A tick of a counterexample."""

    board: dict[str, float]  # by key that the tree or the rule reads
    statuses: tuple[tuple[int, int], ...]
    """(place in document order, status) of the nodes that are ticked, or aborted."""


@dataclass(frozen=True, slots=True)
class RuleResult:
    """Result of checking a rule."""

    rule: Rule
    result: Literal["proven", "refuted", "unknown"]
    why: str  # in words
    ticks: tuple[CounterTick, ...] = ()  # of a refutation; the last one breaks the rule
    place: int | None = None  # of the action that breaks it, in document order


def read_rule(text: str, vocabulary: Vocabulary) -> Rule:
    """A rule from `never ACTION while CONDITION`. Raises TreeError in a line."""
    match = _RULE.fullmatch(text)
    rule = repr(text if len(text) <= _SHOWN else f"{text[:_SHOWN]}...")
    if match is None:
        raise TreeError(f"rule {rule}: expected never ACTION while CONDITION, found another form")
    name, arguments, text_of_condition = match.groups()
    users = tuple(word for word, each in vocabulary.actions.items() if name in each.uses)
    actions = (name,) if name in vocabulary.actions or not users else users
    forbidden = _read_condition(text_of_condition, actions[0], vocabulary, rule)
    limits = None
    if arguments is not None:
        if name not in vocabulary.actions:
            raise TreeError(f"rule {rule}: expected arguments of an action, found {name}(...)")
        keys = _keys_of(vocabulary.action(name).arguments)
        parameters = Vocabulary(vocabulary.domain, {name: Action("")}, keys)
        limits = _read_condition(arguments, name, parameters, rule)
    return Rule(" ".join(text.split()), actions, forbidden, limits)


def _read_condition(text: str, action: str, vocabulary: Vocabulary, rule: str) -> ConditionExpr:
    """A condition of a rule. Raises TreeError in a line."""
    try:
        tree = parse(f"when {text} {{ {action} }}", vocabulary)
    except TreeError as error:
        first, *rest = str(error).splitlines()
        hints = rest[2:] if error.source else rest
        message = ". ".join([_PLACE.sub("", first), " ".join(hints)]).rstrip(". ")
        raise TreeError(f"rule {rule}: {message}") from None
    if re.search(r"\babort\b", text):
        raise TreeError(f"rule {rule}: expected a condition after while, found an abort rule")
    if tree.guard is None or tree.children != (leaf(action),):
        raise TreeError(f"rule {rule}: expected a condition after while, found more than that")
    return tree.guard.condition


def _keys_of(parameters: Mapping[str, Parameter]) -> dict[str, Key]:
    """Arguments as keys, so that a condition can compare them; without texts."""
    makers: dict[str, Callable[[Parameter], Key]] = {
        "number": lambda each: number("", each.low, each.high),
        "integer": lambda each: number("", each.low, each.high),
        "word": lambda each: enumeration("", each.words),
        "flag": lambda _: flag(""),
    }
    return {
        name: makers[each.sort](each) for name, each in parameters.items() if each.sort in makers
    }


def check_rule(tree: Node, rule: Rule, vocabulary: Vocabulary, steps: int = STEPS) -> RuleResult:
    """Proves or refutes that a tree keeps a rule.

    Args:
        tree: with actions and keys of the vocabulary.
        rule: to be proven or refuted.
        vocabulary: has the ranges of keys and the statuses of actions.
        steps: maximum steps of the search, >= 0; a step takes some microseconds.

    Returns:
        Proven, refuted with blackboards that break the rule, or unknown after `steps`.
    """
    written = root_context(tree, vocabulary).written
    keys = {name: _any(k) if name in written else k for name, k in vocabulary.keys.items()}
    sets = BoardSets(keys)
    machine = Machine(tree, vocabulary, sets)
    forbidden = sets.of(rule.condition)
    leaves = {place: machine.nodes[place].args for place in machine.statuses}
    places = [
        place
        for place, args in leaves.items()
        if isinstance(args, ActionArgs) and rule.forbids(args, vocabulary)
    ]
    if not places:
        call = rule.text.removeprefix("never ").split(" while ")[0]
        return RuleResult(rule, "proven", f"there is no {call} in the tree")
    if forbidden == NO_BOARD:
        return RuleResult(rule, "proven", "its condition never holds in the ranges of the keys")
    possible = boards_of_nodes(machine)
    candidates = [place for place in places if sets.both(possible[place], forbidden) != NO_BOARD]
    if not candidates:
        return RuleResult(rule, "proven", "it follows from the guards")
    if any(not term.single for term in (*asked_in(tree), *terms(rule.condition))):
        return _unknown(rule, ": if keys are compared with keys, only guards are examined")
    if written:
        return _unknown(rule, ": if a tree writes keys, only guards are examined")
    for node in machine.nodes:
        if node.kind in TIMED or kind_of(node).reactive or is_opaque(node):
            return _unknown(rule, f": of a tree with a {node.kind} only the guards are examined")
    return _explored(machine, rule, {*candidates}, vocabulary, steps)


def _any(key: Key) -> Key:
    """A key of any number, as a tree may write one beyond the declared range."""
    return key if key.flag or key.words else replace(key, low=-inf, most=None)


def _unknown(rule: Rule, why: str) -> RuleResult:
    return RuleResult(rule, "unknown", f"neither proven nor refuted{why}")


class _MemoryOrigin(NamedTuple):
    """How the search reached a memory."""

    before: Memory | None
    board: Sequence[float]
    calls: ActionCalls


def _explored(
    machine: Machine, rule: Rule, places: Set[int], vocabulary: Vocabulary, steps: int
) -> RuleResult:
    """Searches breadth-first for a sequence of ticks that breaks the rule."""
    search = Search(machine, steps)
    cells, is_complete = _cells(machine, rule)
    boards = [board for cell in cells if (board := machine.sets.pick(cell)) is not None]
    breaks = [condition(rule.condition, board, vocabulary.key_index)() for board in boards]
    origins: dict[Memory | None, _MemoryOrigin | None] = {None: None}
    waiting: deque[Memory | None] = deque([None])
    try:
        while waiting:
            memory = waiting.popleft()
            for board, is_forbidden in zip(boards, breaks, strict=True):
                for move in search.moves(memory, board):
                    called = [place for place, _ in move.calls if place in places]
                    if is_forbidden and called:
                        course = [*_back(origins, memory), (board, move.calls)]
                        ticks = _ticks(machine.nodes[0], vocabulary, rule, course)
                        why = f"in {len(ticks)} tick{'s' * (len(ticks) > 1)}"
                        return RuleResult(rule, "refuted", why, ticks, called[0])
                    if move.memory not in origins:
                        origins[move.memory] = _MemoryOrigin(memory, board, move.calls)
                        waiting.append(move.memory)
    except SpentError:
        return _unknown(rule, f" in {len(origins):,} states of the tree; give more --steps")
    if not is_complete or not machine.sets.exact:
        return _unknown(rule, ": its conditions distinguish too many blackboards")
    return RuleResult(
        rule, "proven", f"no tick breaks it in any of {len(origins):,} states of the tree"
    )


def _cells(machine: Machine, rule: Rule) -> tuple[list[Boards], bool]:
    """The classes of blackboards that the rule and the guards distinguish; whether they are all."""
    sets = machine.sets
    cells = [sets.of(rule.condition), sets.of(opposite(rule.condition))]
    for place, holds in machine.holds.items():
        halves = ((sets.both(c, holds), sets.both(c, machine.fails[place])) for c in cells)
        cells = list(dict.fromkeys(half for pair in halves for half in pair if half != NO_BOARD))
        if len(cells) > MAX_CELLS:
            return cells[:MAX_CELLS], False
    return cells, True


def _back(
    origins: dict[Memory | None, _MemoryOrigin | None], memory: Memory | None
) -> list[tuple[Sequence[float], ActionCalls]]:
    """The blackboards and calls that lead to a memory, oldest first."""
    steps = []
    while (origin := origins[memory]) is not None:
        steps.append((origin.board, origin.calls))
        memory = origin.before
    return steps[::-1]


def _ticks(
    tree: Node,
    vocabulary: Vocabulary,
    rule: Rule,
    course: Sequence[tuple[Sequence[float], ActionCalls]],
) -> tuple[CounterTick, ...]:
    """The ticks of a counterexample, as executed by the engine."""
    board = [0.0] * len(vocabulary.keys)
    returns: dict[int, int] = {}
    statuses: dict[int, int] = {}
    tick = compile_tree(
        tree, _Scripted(tree, returns), board, vocabulary.key_index, watch=statuses.__setitem__
    )
    keys = {*keys_in(tree), *(term.key for term in terms(rule.condition))}
    ticks = []
    for values, calls in course:
        board[:] = values
        returns.clear()
        returns.update(calls)
        statuses.clear()
        tick()
        keys_in_tick = {key: board[at] for key, at in vocabulary.key_index.items() if key in keys}
        ticks.append(CounterTick(keys_in_tick, tuple(sorted(statuses.items()))))
    return tuple(ticks)


class _Scripted(dict[str, Callable[[bool], int]]):
    """Actions that return the statuses of a script by place.

    The compiler looks each leaf up once, in document order.
    """

    def __init__(self, tree: Node, returns: dict[int, int]) -> None:
        super().__init__()
        self._returns = returns
        self._places = iter([p for p, node in enumerate(walk(tree)) if node.action])

    def __missing__(self, _: str) -> Callable[[bool], int]:
        return partial(self._act, next(self._places))

    def _act(self, place: int, _: bool) -> int:
        return self._returns[place]
