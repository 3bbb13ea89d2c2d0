"""The kinds of nodes: their syntax, appearance, and the properties that analyses use.

Each kind is declared once, in KINDS. The parser, the printer, pictures, `check`, `simplify` and
evolution use this declaration. Only `engine`, which ticks nodes, and `export`, which maps them to
those of other libraries, treat kinds by name. docs/semantics.md specifies the behaviour of each.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from math import inf
from typing import Any, Final, NamedTuple

from islandgp.bt.core.node import (
    FAILURE,
    SUCCESS,
    ActionArgs,
    AlwaysArgs,
    Args,
    CountArgs,
    GuardArgs,
    Node,
    ParallelArgs,
    SecondsArgs,
    walk,
)

UNLIMITED: Final = 1_000_000  # "as many children as the limits allow"


class Sort(Enum):
    """Type of an argument."""

    NAME = auto()  # of an action
    CONDITION = auto()  # a ConditionExpr
    COUNT = auto()  # a whole number within `range`
    SECONDS = auto()  # a number within `range`
    WORD = auto()  # one of `words`
    POLICY = auto()  # one of `words`, or a whole number within `range`
    VALUES = auto()  # of the arguments of an action


@dataclass(frozen=True, slots=True)
class Argument:
    """An argument of a node kind.

    An argument with a default is written after its name and may be left out, as in `abort lower`;
    one without a default follows the keyword of the kind, as in `repeater 3`.
    """

    name: str  # in JSON, and in a text if it has a default
    sort: Sort
    meaning: str = ""  # one line, for editors
    words: Mapping[str, str] = field(default_factory=dict)  # each with its meaning
    range: tuple[float, float] = (0, 0)
    default: str | None = None


class Look(NamedTuple):
    """Appearance of the nodes of a kind; kinds differ in colour, shape and sign."""

    sign: str  # the symbol of the literature
    style: str  # of rich, for terminals with colours
    fill: str
    line: str
    dot: str = "box"  # shape of Graphviz
    mermaid: tuple[str, str] = ("[", "]")  # brackets around its label
    ends: str = "square"  # left and right end of its box in an SVG: square, round or pointed


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeKind:
    """A kind of node: its arguments, children and appearance, and the rules for its status."""

    meaning: str  # one line, for documentation
    children: tuple[int, int]  # fewest and most
    look: Look
    args: type[Any] = tuple  # the class of Node.args
    arguments: tuple[Argument, ...] = ()  # the fields of args, in order

    advance_status: int | None = None
    """Of a selector or sequence: the status of a child with which the next one starts."""
    dual: str = ""
    """Of a selector or sequence: the kind that is the same with SUCCESS and FAILURE exchanged."""
    reactive: bool = False
    """Of a selector or sequence: it begins with its first child in each tick. It observes no
    guards."""
    concurrent: bool = False
    """It ticks all its children in each tick; its args are the numbers of successes and failures
    that end it."""
    ends: tuple[int, int] = (FAILURE, SUCCESS)
    """Of a decorator: its status when its child fails, and when its child succeeds."""
    counts: int | None = None
    """Of a decorator: the status of its child after which the child starts again in the next tick,
    until the count in its args is reached."""

    def make_args(self, values: Sequence[Any]) -> Args:
        """The args of a node of this kind, from the values of its arguments in order."""
        args: Args = self.args(*values) if values else ()
        return args

    may_fail: bool = False
    """Of a decorator: it can fail while its child has not ended."""
    delayed: bool = False
    """Of a decorator: its child starts in a later tick."""
    opaque: bool = False
    """Analyses assume that its children start in any of its ticks, and that it ends in any way."""
    remembers_end: bool = False
    """Its behaviour depends on its last status."""

    paper: bool = True
    """One of the paper's node types, section 2.2.3; prompts describe these."""

    @property
    def remembers_branch(self) -> bool:
        """True for selectors and sequences that resume their running child."""
        return self.advance_status is not None and not self.reactive

    @property
    def decorates(self) -> bool:
        """True if it has exactly one child; a composite observes guards through it."""
        return self.children == (1, 1)

    @property
    def forces(self) -> bool:
        """True if it ends with one status only."""
        return self.ends[FAILURE] == self.ends[SUCCESS]

    @property
    def inverts(self) -> bool:
        """True if it exchanges success and failure."""
        return self.ends == (SUCCESS, FAILURE)


ABORTS: Final = {
    "none": "a change of the condition stops nothing",
    "self": "the child is stopped when the condition becomes false",
    "lower": "later branches are stopped when the condition becomes true",
    "both": "self and lower",
}
"""The abort rules of a `when`, with their meanings."""
POLICIES: Final = {"one": "one child", "all": "all children"}
"""Thresholds of a parallel, with their meanings."""
ALWAYS: Final = {
    "success": "succeeds at once",
    "failure": "fails at once",
    "running": "runs until it is stopped",
}
"""Statuses of an `always`, with their meanings."""
COUNTS: Final = (1, 1_000_000)
"""Fewest and most repetitions, or children that decide."""
REPEATS: Final = (1, 100)
"""`COUNTS` in evolution and prompts."""
SECONDS: Final = (0.001, 100_000)
"""Shortest and longest time, in s."""

KINDS: Final[dict[str, NodeKind]] = {
    "selector": NodeKind(
        meaning="tries its children in order until one succeeds",
        children=(1, UNLIMITED),
        look=Look("?", "bold cyan", "#d7ecfa", "#0072b2"),
        advance_status=FAILURE,
        dual="sequence",
    ),
    "sequence": NodeKind(
        meaning="runs its children in order until one fails",
        children=(1, UNLIMITED),
        look=Look("\N{RIGHTWARDS ARROW}", "bold blue", "#dfe6f7", "#3f5fa8"),
        advance_status=SUCCESS,
        dual="selector",
    ),
    "parallel": NodeKind(
        meaning="runs all its children at once",
        children=(1, UNLIMITED),
        args=ParallelArgs,
        arguments=(
            Argument("success", Sort.POLICY, "how many must succeed", POLICIES, COUNTS, "all"),
            Argument("failure", Sort.POLICY, "how many must fail", POLICIES, COUNTS, "one"),
        ),
        look=Look("\N{RIGHTWARDS PAIRED ARROWS}", "bold magenta", "#f3e0ec", "#a8437e"),
        concurrent=True,
    ),
    "inverter": NodeKind(
        meaning="turns success into failure and failure into success",
        children=(1, 1),
        look=Look("\N{NOT SIGN}", "red", "#fbe3d6", "#d55e00"),
        ends=(SUCCESS, FAILURE),
    ),
    "repeater": NodeKind(
        meaning="repeats its child until it has succeeded a number of times",
        children=(1, 1),
        args=CountArgs,
        arguments=(Argument("count", Sort.COUNT, "successes of the child", range=COUNTS),),
        look=Look("\N{CLOCKWISE OPEN CIRCLE ARROW}", "magenta", "#efe3f5", "#7f4fa3"),
        counts=SUCCESS,
    ),
    "retry": NodeKind(
        meaning="repeats its child until it succeeds, or has failed a number of times",
        children=(1, 1),
        args=CountArgs,
        arguments=(Argument("count", Sort.COUNT, "failures of the child", range=COUNTS),),
        look=Look("\N{ANTICLOCKWISE OPEN CIRCLE ARROW}", "magenta", "#f7e3f0", "#a23f7e"),
        counts=FAILURE,
        paper=False,
    ),
    "force_success": NodeKind(
        meaning="turns failure into success",
        children=(1, 1),
        look=Look("\N{CHECK MARK}", "green", "#e3f3df", "#3f7f2f"),
        ends=(SUCCESS, SUCCESS),
        paper=False,
    ),
    "force_failure": NodeKind(
        meaning="turns success into failure",
        children=(1, 1),
        look=Look("\N{BALLOT X}", "red", "#fbe0e0", "#b02f2f"),
        ends=(FAILURE, FAILURE),
        paper=False,
    ),
    "reactive_selector": NodeKind(
        meaning="tries its children in order in each tick until one does not fail",
        children=(1, UNLIMITED),
        look=Look("?\N{CLOCKWISE OPEN CIRCLE ARROW}", "bold cyan", "#d7ecfa", "#0072b2"),
        advance_status=FAILURE,
        dual="reactive_sequence",
        reactive=True,
        paper=False,
    ),
    "reactive_sequence": NodeKind(
        meaning="runs its children in order in each tick until one does not succeed",
        children=(1, UNLIMITED),
        look=Look(
            "\N{RIGHTWARDS ARROW}\N{CLOCKWISE OPEN CIRCLE ARROW}", "bold blue", "#dfe6f7", "#3f5fa8"
        ),
        advance_status=SUCCESS,
        dual="reactive_selector",
        reactive=True,
        paper=False,
    ),
    "wait": NodeKind(
        meaning="waits for a number of seconds, then runs its child",
        children=(1, 1),
        args=SecondsArgs,
        arguments=(Argument("seconds", Sort.SECONDS, "before its child starts", range=SECONDS),),
        look=Look("\N{HOURGLASS}", "magenta", "#efe3f5", "#7f4fa3"),
        delayed=True,
        paper=False,
    ),
    "timeout": NodeKind(
        meaning="fails when its child has run for a number of seconds",
        children=(1, 1),
        args=SecondsArgs,
        arguments=(Argument("seconds", Sort.SECONDS, "of its child at most", range=SECONDS),),
        look=Look("\N{STOPWATCH}", "red", "#fbe0e0", "#b02f2f"),
        may_fail=True,
        paper=False,
    ),
    "cooldown": NodeKind(
        meaning="fails for a number of seconds after its child has ended",
        children=(1, 1),
        args=SecondsArgs,
        arguments=(Argument("seconds", Sort.SECONDS, "after an end of its child", range=SECONDS),),
        look=Look("\N{SNOWFLAKE}", "cyan", "#e0eefb", "#2f6fb0"),
        may_fail=True,
        paper=False,
    ),
    "pipeline": NodeKind(
        meaning="runs its children as a sequence that repeats the earlier ones in each tick, as"
        " Nav2's PipelineSequence",
        children=(1, UNLIMITED),
        look=Look("\N{RIGHTWARDS TWO HEADED ARROW}", "bold blue", "#dfe6f7", "#3f5fa8"),
        opaque=True,
        paper=False,
    ),
    "round_robin": NodeKind(
        meaning="tries its children in turn, beginning after the one that succeeded last, as Nav2's"
        " RoundRobin",
        children=(1, UNLIMITED),
        look=Look("\N{ANTICLOCKWISE GAPPED CIRCLE ARROW}", "bold cyan", "#d7ecfa", "#0072b2"),
        opaque=True,
        remembers_end=True,
        paper=False,
    ),
    "recovery": NodeKind(
        meaning="runs its first child; after a failure the second, then the first again, as Nav2's"
        " RecoveryNode",
        children=(2, 2),
        args=CountArgs,
        arguments=(Argument("count", Sort.COUNT, "recoveries at most", range=COUNTS),),
        look=Look("\N{LEFTWARDS ARROW WITH HOOK}", "magenta", "#f7e3f0", "#a23f7e"),
        opaque=True,
        paper=False,
    ),
    "until_failure": NodeKind(
        meaning="repeats its child until it fails",
        children=(1, 1),
        look=Look("\N{INFINITY}", "magenta", "#efe3f5", "#7f4fa3"),
        counts=SUCCESS,
        paper=False,
    ),
    "until_success": NodeKind(
        meaning="repeats its child until it succeeds",
        children=(1, 1),
        look=Look("\N{INFINITY}", "magenta", "#f7e3f0", "#a23f7e"),
        counts=FAILURE,
        paper=False,
    ),
    "every": NodeKind(
        meaning="starts its child again no earlier than a number of seconds after its success,"
        " as Nav2's RateController",
        children=(1, 1),
        args=SecondsArgs,
        arguments=(Argument("seconds", Sort.SECONDS, "after a success", range=SECONDS),),
        look=Look("\N{WATCH}", "magenta", "#efe3f5", "#7f4fa3"),
        opaque=True,
        paper=False,
    ),
    "when": NodeKind(
        meaning="runs its child while a condition holds",
        children=(1, 1),
        args=GuardArgs,
        arguments=(
            Argument("condition", Sort.CONDITION),
            Argument(
                "abort", Sort.WORD, "what a change of the condition stops", ABORTS, default="both"
            ),
        ),
        look=Look(
            "\N{WHITE DIAMOND}", "yellow", "#fdf0cf", "#b57a00", "hexagon", ("{{", "}}"), "pointed"
        ),
    ),
    "always": NodeKind(
        meaning="succeeds, fails or runs, and does nothing",
        children=(0, 0),
        args=AlwaysArgs,
        arguments=(Argument("status", Sort.WORD, "its status", ALWAYS),),
        look=Look("\N{BULLET}", "green", "#e3f3df", "#3f7f2f", "ellipse", ("([", "])"), "round"),
        opaque=True,
        paper=False,
    ),
    "action": NodeKind(
        meaning="acts on the world",
        children=(0, 0),
        args=ActionArgs,
        arguments=(Argument("name", Sort.NAME), Argument("values", Sort.VALUES)),
        look=Look("", "green", "#d6f1e6", "#00775a", "ellipse", ("([", "])"), "round"),
    ),
}
"""By keyword; `action` is not a keyword of the language."""

KEYWORDS: Final = tuple(name for name in KINDS if name != "action")
"""The kinds of nodes with a keyword."""

INNER: Final = tuple(name for name, kind in KINDS.items() if kind.children != (0, 0))
"""The kinds of nodes with children."""


NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")

RESERVED: Final = frozenset((
    "domain", "include", "constant", "subtree", "use", "when", "and", "or", "not",
))  # fmt: skip
"""No action or key can have such a name. Other keywords are names where the grammar expects one."""

CALLABLE: Final = frozenset(KEYWORDS) - {"when"}
"""Keywords that are the name of an action in front of a parenthesis: `timeout()`."""

COUNTED: Final = tuple(n for n, k in KINDS.items() if k.args is CountArgs)
"""The kinds whose keyword is followed by a count."""

TIMED: Final = tuple(n for n, k in KINDS.items() if k.args is SecondsArgs)
"""The kinds whose keyword is followed by a number of seconds."""

GUARDS: Final = tuple(n for n, k in KINDS.items() if k.args is GuardArgs)
"""The kinds whose keyword is followed by a condition."""


def kind_of(node: Node) -> NodeKind:
    """The record of a node's kind."""
    return KINDS[node.kind]


def advance_status(node: Node) -> int:
    """The status of a child after which a selector or sequence starts the next one."""
    status = kind_of(node).advance_status
    assert status is not None
    return status


def needs_each_tick(tree: Node) -> bool:
    """True if a tree has a node that counts seconds or remembers its last status."""
    return any(node.kind in TIMED or kind_of(node).remembers_end for node in walk(tree))


def count_of(node: Node) -> float:
    """The count of a node whose kind counts; infinite without an argument."""
    return int(node.args.times) if isinstance(node.args, CountArgs) else inf
