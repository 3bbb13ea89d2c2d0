"""What is declared of a node kind: its syntax, tick function, outcomes, exports and appearance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Any, NamedTuple

from islandgp.bt.core.engine import Maker
from islandgp.bt.core.node import FAILURE, SUCCESS


class Sort(Enum):
    """Type of an argument."""

    CONDITION = auto()  # a ConditionExpr
    COUNT = auto()  # a whole number within `range`
    SECONDS = auto()  # a number within `range`
    WORD = auto()  # one of `words`
    POLICY = auto()  # one of `words`, or a whole number within `range`
    ASSIGNMENT = auto()  # a Condition with the operator =


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


class Target(NamedTuple):
    """A node of BehaviorTree.CPP and of py_trees."""

    tag: str  # of BehaviorTree.CPP; "": there is none
    ports: tuple[str, ...] = ()  # our arguments there, in order
    python: str = ""
    """Of py_trees: the class, or the text of its call before the children; "": there is none."""
    category: str = ""  # in Groot, Control or Decorator, if it is one of ours; else ""


class Look(NamedTuple):
    """Appearance of the nodes of a kind; kinds differ in colour, shape and sign."""

    sign: str  # the symbol of the literature
    style: str  # of rich, for terminals with colours
    fill: str
    line: str
    ends: str = "square"  # left and right end of its box in an SVG: square, round or pointed


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeKind:
    """A kind of node: its arguments, children and appearance, and the rules for its status."""

    meaning: str  # one line, for documentation
    look: Look
    tick: Maker
    children: tuple[int, int] = (1, 1)  # fewest and most
    args: type[Any] = tuple  # the class of Node.args
    arguments: tuple[Argument, ...] = ()  # the fields of args, in order; not of an action

    advance_status: int | None = None
    """Of a selector or sequence: the status of a child with which the next one starts."""
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

    may_fail: bool = False  # of a decorator: it can fail while its child has not ended
    delayed: bool = False  # of a decorator: its child starts in a later tick
    statuses: Callable[[Any], frozenset[int]] | None = None
    """Of a leaf other than an action: the statuses that it can return, from its args."""
    opaque: bool = False
    """Analyses assume that its children start in any of its ticks, and that it ends in any way."""
    remembers_end: bool = False  # its behaviour depends on its last status
    stock: Target | None = None
    """The node of the libraries, unless it differs in meaning; None: there is none."""
    ours: Target | None = None
    """Our own node for these libraries, for trees in which theirs differs."""

    instead: str = ""  # what is nearest to it in a library without such a node

    paper: bool = False  # one of the paper's node types, section 2.2.3; prompts describe these

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
