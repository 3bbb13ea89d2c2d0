"""How exact exports are: many trees in three engines, with the figures of docs/exports.md.

    BEHAVIORTREE_CPP=FOLDER python -m tests.trees.exactness

Trees are random, evolved, or those of `grammar/examples`; what they meet is random, or what a
whole episode on the island was recorded to be.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count
from math import inf
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Final, NamedTuple

from islandgp.bt.core.arithmetic import SIGNS, Formula, Named, Operation, Term, negative
from islandgp.bt.core.condition import (
    FLAG_OPERATORS,
    OPERATORS,
    Condition,
    ConditionExpr,
    combine,
    comparison,
    negate,
    terms,
    with_term,
)
from islandgp.bt.core.engine import ABORTED
from islandgp.bt.core.kinds import ABORTS, INNER, KINDS, NAV2, POLICIES
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import (
    AGAIN,
    FAILURE,
    RUNNING,
    STATUS_NAMES,
    SUCCESS,
    Args,
    CountArgs,
    GuardArgs,
    Node,
    ParallelArgs,
    SecondsArgs,
    SetArgs,
    as_subtree,
    leaf,
    walk,
)
from islandgp.domain import Scene
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import DomainError
from islandgp.evaluation.base import Problem
from islandgp.evaluation.serial import Serial
from islandgp.evolution.loop import evolve
from islandgp.resources import resource
from islandgp.supervision.baseline import Baseline, BaselineSettings
from tests.composed import composed, composed_plan
from tests.running.commands import ROOT
from tests.trees.targets import (
    BehaviorTreeCpp,
    Trace,
    compiled,
    in_py_trees,
    ours,
    with_unique_names,
)
from tests.trees.worlds import random_trees

PLACES: Final = VOCABULARY.key_index
EXAMPLES: Final = sorted(
    (resource("grammar") / "examples").glob("*.bt"), key=lambda path: path.name
)
PAGE: Final = ROOT / "docs" / "exports.md"
ENGINES: Final = ("py_trees", "`tickExactlyOnce`", "`tickOnce`")


class Case(NamedTuple):
    """A tree, its blackboards and results, and the trace of its leaves if it is known."""

    tree: Node  # each leaf has a unique name
    boards: Sequence[Sequence[float]]  # a value per key, for each tick
    results: Sequence[int]  # of the leaves, one after the other, again from the first
    recorded: Trace | None = None  # of a recorded episode: as `ours`, without who is fresh
    restarting: bool = False  # True: the leaves start again after their end, as those of Nav2


def named(tree: Node) -> Node:
    """The tree with a unique name for each leaf."""
    return with_unique_names(tree, count())


def random_condition(rng: Random, terms: int) -> ConditionExpr:
    """A comparison, or several of them joined."""
    if terms > 1:
        parts = [random_condition(rng, count) for count in (1, terms - 1)]
        joined = combine(rng.choice(["and", "or"]), parts)
        return negate(joined) if rng.random() < 0.3 else joined
    key = rng.choice([*VOCABULARY.keys])
    if VOCABULARY.keys[key].flag:
        return Condition(key, rng.choice(FLAG_OPERATORS), 0.0)
    return Condition(key, rng.choice(OPERATORS), float(rng.randint(1, 3)))


USUAL: Final = (*["selector", "when"] * 3, "sequence", "parallel", "inverter", "force_success",
                "force_failure", "repeater", "retry")  # fmt: skip
"""Kinds of random trees with many guards that interrupt."""
SHARED: Final = tuple(
    kind for kind in INNER if kind not in {*NAV2, "cooldown", "if_else", "random_selector"}
)
"""Kinds with an exact form in both libraries."""


def random_args(rng: Random, kind: str) -> Args:
    """Arguments of a node of a kind: small numbers, guards that mostly interrupt."""
    args = KINDS[kind].args
    if args is GuardArgs:
        condition = random_condition(rng, rng.choice([1, 1, 1, 2, 3]))
        return GuardArgs(condition, rng.choice(["lower", "both", *ABORTS]))
    if args is ParallelArgs:
        policies = [*POLICIES, 1, 2]
        return ParallelArgs(rng.choice(policies), rng.choice(policies))
    if args is CountArgs:
        return CountArgs(rng.randint(1, 4))
    return SecondsArgs(rng.choice([0.5, 1, 2, 2.5, 4])) if args is SecondsArgs else ()


def random_tree(rng: Random, levels: int, kinds: Sequence[str] = USUAL) -> Node:
    """A tree of these kinds; Hypothesis makes few guards that interrupt."""
    if levels == 1 or rng.random() < 0.15:
        return leaf("A")
    kind = rng.choice(kinds)
    fewest, most = KINDS[kind].children
    children = [
        random_tree(rng, levels - 1, kinds) for _ in range(rng.randint(fewest, min(most, 4)))
    ]
    return Node(kind, random_args(rng, kind), tuple(children))


def random_boards(rng: Random, ticks: int = 25, most: float = 4) -> list[list[float]]:
    """Blackboards of which one key changes from tick to tick; numbers go from 0 to `most`.

    As those of `random_condition` are small, so are these by default.
    """
    board = [0.0] * len(PLACES)
    boards = []
    for _ in range(ticks):
        board = list(board)
        name = rng.choice([*PLACES])
        key = VOCABULARY.keys[name]
        board[PLACES[name]] = float(rng.randint(0, 1 if key.flag else round(min(most, key.high))))
        boards.append(board)
    return boards


def random_results(rng: Random) -> list[int]:
    """What leaves return."""
    return rng.choices([FAILURE, SUCCESS, RUNNING], [1, 1, 3], k=37)


def random_cases(number: int) -> Iterator[Case]:
    """Random trees that meet random blackboards."""
    for seed in range(number):
        rng = Random(seed)
        tree = named(random_tree(rng, rng.randint(3, 6)))
        yield Case(tree, random_boards(rng), random_results(rng))


def cases_with(kind: str, number: int) -> Iterator[Case]:
    """Random trees with nodes of a kind among others."""
    rng = Random(kind)
    while number:
        tree = random_tree(rng, rng.randint(2, 5), [*SHARED, *[kind] * 5])
        if any(node.kind == kind for node in walk(tree)):
            yield Case(named(tree), random_boards(rng), random_results(rng))
            number -= 1


def comparing_keys(number: int) -> Iterator[Case]:
    """Random trees that mostly compare numbers with each other, and calculate with them."""
    numbers = [name for name, key in VOCABULARY.keys.items() if not key.flag]
    rng = Random("keys")

    def pair() -> Condition:
        left, right, third = rng.sample(numbers, 3)
        if rng.random() < 0.5:
            return Condition(left, rng.choice(OPERATORS), 0.0, right)
        product = Operation("*", (rng.choice([0.5, 2.0, -1.0]), left))
        total = Operation(rng.choice(SIGNS), (product, right))
        return comparison(total, rng.choice(OPERATORS), rng.choice([third, 1.0, negative(third)]))

    def changed(expr: ConditionExpr) -> ConditionExpr:
        for index, _ in enumerate(terms(expr)):
            if rng.random() < 0.8:
                expr = with_term(expr, index, pair()) or expr
        return expr

    def visit(node: Node) -> Node:
        args = node.args
        if isinstance(args, GuardArgs):
            args = args._replace(condition=changed(args.condition))
        return Node(node.kind, args, tuple(map(visit, node.children)))

    for case in random_cases(number):
        yield case._replace(tree=visit(case.tree))


def random_assignment(rng: Random) -> Node:
    """A `set` of a flag or a small number."""
    names = [*VOCABULARY.keys]
    key = rng.choice(names)
    alike = [n for n in names if n != key and VOCABULARY.keys[n].flag == VOCABULARY.keys[key].flag]
    if rng.random() < 0.3:
        return Node("set", SetArgs(Condition(key, "=", 0.0, rng.choice(alike))))
    if VOCABULARY.keys[key].flag:
        at = rng.randint(0, 1)
        return Node("set", SetArgs(Condition(key, "=", Named(("no", "yes")[at], at))))
    if rng.random() < 0.5:
        return Node("set", SetArgs(Condition(key, "=", float(rng.randint(0, 4)))))
    right: Term = rng.choice([float(rng.randint(1, 3)), rng.choice(alike)])
    term = Operation(rng.choice("+-*"), (rng.choice([key, *alike]), right))
    return Node("set", SetArgs(Condition(key, "=", 0.0, Formula(term))))


def writing(number: int) -> Iterator[Case]:
    """Random trees with a `set` before some of the children of composites."""
    rng = Random("set")

    def visit(node: Node) -> Node:
        children: list[Node] = []
        for child in map(visit, node.children):
            if KINDS[node.kind].children[1] > 2 and rng.random() < 0.4:
                children.append(random_assignment(rng))
            children.append(child)
        return node._replace(children=tuple(children))

    for case in random_cases(number):
        yield case._replace(tree=visit(case.tree))


def counted_by_keys(number: int) -> Iterator[Case]:
    """Random trees in which counts and seconds are keys."""
    rng, counted = Random("counts"), ("repeater", "retry", "wait", "timeout")

    def visit(node: Node) -> Node:
        args = node.args
        if isinstance(args, CountArgs):
            args = CountArgs("lap")
        elif isinstance(args, SecondsArgs):
            args = SecondsArgs("batteryLevel")
        return Node(node.kind, args, tuple(map(visit, node.children)))

    while number:
        tree = visit(random_tree(rng, rng.randint(2, 5), [*SHARED, *counted * 3]))
        if any(node.kind in counted for node in walk(tree)):
            yield Case(named(tree), random_boards(rng), random_results(rng))
            number -= 1


def nav2_cases(kind: str, number: int) -> Iterator[Case]:
    """Random trees with nodes of a kind of Nav2.

    An `every` is a child of a pipeline at the root, and a case ends with that pipeline: Nav2's
    RateController starts its child at once after a node above was reset.
    """
    rng = Random(kind)
    kinds = [*SHARED, *(["pipeline", "recovery"] if kind == "every" else [kind] * 5)]
    while number:
        tree = random_tree(rng, rng.randint(2, 5), kinds)
        if kind == "every":
            children = (random_tree(rng, 3, kinds) for _ in range(2))
            rates = (Node(kind, random_args(rng, kind), (child,)) for child in children)
            tree = Node("pipeline", (), (*rates, tree))
        tree, boards, results = named(tree), random_boards(rng), random_results(rng)
        has_kind = any(node.kind == kind for node in walk(tree))
        if not has_kind:
            continue
        if kind == "every":
            trace = ours(tree, boards, results, PLACES)
            last = next((i for i, t in enumerate(trace) if not t.endswith("RUNNING")), len(trace))
            boards = boards[: last + 1]
        yield Case(tree, boards, results, restarting=True)
        number -= 1


def in_subtrees(tree: Node, rng: Random) -> Node:
    """The tree with some of its nodes as named subtrees, a few of them used again."""
    subtrees: list[Node] = []

    def visit(node: Node) -> Node:
        if subtrees and rng.random() < 0.1:
            return rng.choice(subtrees)
        copy = node._replace(children=tuple(map(visit, node.children)))
        for _ in range(rng.choice([0, 0, 0, 1, 1, 2])):
            copy = as_subtree(copy, rng.choice(["a", "recharge(20, -1.5)", "Sequence", "check"]))
            subtrees.append(copy)
        return copy

    return visit(tree)


class Calls:
    """An observer that keeps the calls of leaves, and their blackboards."""

    def __init__(self, tree: Node) -> None:
        """For an episode of this tree, whose leaves have the names of `named`."""
        places = [place for place, node in enumerate(walk(tree)) if node.action]
        self.boards: list[tuple[float, ...]] = []
        self.results: list[int] = []
        self.trace: Trace = []
        self._leaves = {place: f"Leaf{i}" for i, place in enumerate(places)}
        self._calls: list[str] = []
        self._root = FAILURE

    def node(self, place: int, status: int) -> None:
        """See `Observer`."""
        if place == 0 and status != ABORTED:
            self._root = status
        if (leaf := self._leaves.get(place)) is None:
            return
        if status == ABORTED:
            self._calls.append(f"-{leaf}")
        else:
            self._calls.append(leaf)
            self.results.append(RUNNING if status == AGAIN else status)

    def tick(self, board: Sequence[float], _: Scene | None) -> None:
        """See `Observer`."""
        self.boards.append(tuple(map(float, board)))
        self.trace.append(" ".join([*self._calls, "=", STATUS_NAMES[self._root]]))
        self._calls = []

    def credit(self, component: str, points: float, event: str, action: str) -> None:
        """See `Observer`; it does not matter here."""


def recorded(tree: Node, problem: Problem, *, seed: int = 1, stage: int = 3) -> Case:
    """A whole episode of a tree: what it saw, what its leaves returned, and their calls."""
    calls = Calls(tree)
    problem.at(stage).run_episode(tree, seed, problem.curriculum.multipliers(stage), calls)
    return Case(named(tree), calls.boards, calls.results or [RUNNING], calls.trace)


def example(path: Path) -> Node:
    """A tree of `grammar/examples`."""
    return parse(path.read_text(encoding="utf-8"), VOCABULARY)


def evolved(runs: int, generations: int = 12) -> list[Node]:
    """The different trees of the last generations of some runs.

    Every second run joins conditions with `and` and `or`.
    """
    texts: dict[str, None] = {}
    for seed in range(runs):
        overrides = ["supervisor=baseline", f"gp.generations={generations}"]
        overrides += ["+gp.mutation.operators.condition=4"] * (seed % 2)
        settings = composed(*overrides)
        supervisor = Baseline(BaselineSettings(**settings.supervisor.policy))
        for step in evolve(composed_plan(*overrides), seed, supervisor, Serial(settings.problem())):
            last = step.record.individuals
        texts |= dict.fromkeys(individual.tree for individual in last)
    return [parse(text, VOCABULARY) for text in texts]


@dataclass
class Row:
    """What a group of cases came to."""

    trees: int = 0
    ticks: int = 0
    calls: int = 0  # leaves started, resumed and halted
    differences: tuple[int | None, ...] = (0,) * len(ENGINES)  # ticks; None: export rejected


def differing(expected: Trace, run: Callable[[], Trace]) -> int | None:
    """In how many ticks another engine differs; None if the export rejects the tree."""
    try:
        trace = run()
    except DomainError:
        return None
    return sum(a != b for a, b in zip(expected, trace, strict=True))


def tried(cases: Iterable[Case], cpp: BehaviorTreeCpp) -> Row:
    """Runs the cases in all engines."""
    row = Row()
    for tree, boards, results, trace, restarting in cases:
        expected = ours(tree, boards, results, PLACES)
        if trace is not None:  # the case is the episode
            assert [tick.replace("!", "") for tick in expected] == trace
        library = partial(cpp.trace, tree, boards, results, restarting=restarting)
        engines: tuple[Callable[[], Trace], ...] = (
            partial(in_py_trees, tree, boards, results, PLACES),
            partial(library, tick_function="exactly"),
            partial(library, tick_function="once"),
        )
        differences = [differing(expected, run) for run in engines]
        row.trees += 1
        row.ticks += len(expected)
        row.calls += sum(len(tick.partition("=")[0].split()) for tick in expected)
        row.differences = tuple(
            None if before is None or ticks is None else before + ticks
            for before, ticks in zip(row.differences, differences, strict=True)
        )
    return row


def groups() -> Iterator[tuple[str, Iterable[Case]]]:
    """What is tried, by what it is called in the page."""
    yield "random trees, many guards that interrupt", random_cases(1000)
    yield (
        "random trees with named subtrees",
        (
            case._replace(tree=in_subtrees(case.tree, Random(seed)))
            for seed, case in enumerate(random_cases(300))
        ),
    )
    yield "random trees that compare two keys", comparing_keys(300)
    yield "random trees that write keys", writing(4000)
    yield "random trees with keys as counts and seconds", counted_by_keys(2400)
    for kind in (kind for kind in INNER if kind not in NAV2):
        yield f"`{kind}`", cases_with(kind, 1600 if kind == "if_else" else 50)
    for kind in (kind for kind in INNER if kind in NAV2):
        number = 400 if kind == "every" else 100  # its cases are short
        yield f"`{kind}`, models of Nav2's nodes", nav2_cases(kind, number)
    problem = composed().problem()
    first = random_trees(composed(), 100)
    yield (
        "random trees of evolution, a recorded episode each",
        (recorded(t, problem) for t in first),
    )
    for name, trees in (("examples", [*map(example, EXAMPLES)]), ("evolved trees", evolved(6))):
        rng = Random(1)
        yield (
            f"{name}, random blackboards",
            (Case(named(t), random_boards(rng, 400, inf), random_results(rng)) for t in trees),
        )
        yield f"{name}, a recorded episode each", (recorded(tree, problem) for tree in trees)


def exactness(cpp: BehaviorTreeCpp) -> Iterator[tuple[str, Row]]:
    """All groups in all engines."""
    return ((name, tried(cases, cpp)) for name, cases in groups())


def table(rows: dict[str, Row]) -> str:
    """The figures in Markdown."""
    lines = [
        f"| | trees | ticks | calls | {' | '.join(ENGINES)} |",
        f"|---|{'--:|' * (3 + len(ENGINES))}",
    ]
    for name, row in rows.items():
        numbers = (row.trees, row.ticks, row.calls, *row.differences)
        cells = ("rejected" if number is None else f"{number:,}" for number in numbers)
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def with_table(text: str, rows: dict[str, Row]) -> str:
    """The page's text with these figures."""
    part = re.compile(r"(<!-- begin exactness -->\n).*?(<!-- end -->)", re.DOTALL)
    return part.sub(lambda match: f"{match[1]}{table(rows)}\n{match[2]}", text)


def main() -> int:
    """Writes the figures; returns 1 where something differs."""
    with TemporaryDirectory() as folder:
        cpp = BehaviorTreeCpp(compiled(Path(folder)), VOCABULARY)
        rows = {}
        for name, row in exactness(cpp):
            rows[name] = row
            print(name, row, flush=True)
        cpp.close()
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8"), rows), encoding="utf-8")
    return int(any(any(row.differences) for row in rows.values()))


if __name__ == "__main__":
    sys.exit(main())
