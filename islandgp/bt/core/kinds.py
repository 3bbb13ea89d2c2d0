"""The kinds of nodes, one entry each: the only place that says what a kind is.

The parser, the printer, the engine, pictures, `check`, `simplify`, exports, imports and evolution
use the entries. docs/semantics.md specifies the behaviour of each.
"""

from __future__ import annotations

import re
from typing import Final

from islandgp.bt.core import closures, steered
from islandgp.bt.core.kind import Argument, Look, NodeKind, Sort, Target
from islandgp.bt.core.node import (
    COUNTS,
    FAILURE,
    SECONDS,
    STATUS_NAMES,
    SUCCESS,
    ActionArgs,
    AlwaysArgs,
    CountArgs,
    GuardArgs,
    Node,
    ParallelArgs,
    SecondsArgs,
    SetArgs,
    keys_of,
    walk,
)

UNLIMITED: Final = 1_000_000  # "as many children as the limits allow"

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
REPEATS: Final = (1, 100)  # `COUNTS` in evolution and prompts


def _in_ticks(tag: str) -> Target:
    """Our node for a time, which counts ticks."""
    return Target(tag, ("seconds",), f"{tag}({{seconds}}, step_s, child=", "Decorator")


KINDS: Final[dict[str, NodeKind]] = {
    "selector": NodeKind(
        paper=True,
        meaning="tries its children in order until one succeeds",
        children=(1, UNLIMITED),
        tick=closures.ordered(FAILURE),
        look=Look("?", "bold cyan", "#d7ecfa", "#0072b2"),
        advance_status=FAILURE,
        stock=Target("Fallback", (), "Selector('selector', memory=True, children=["),
        ours=Target("InterruptibleFallback", (), "InterruptibleSelector", "Control"),
    ),
    "sequence": NodeKind(
        paper=True,
        meaning="runs its children in order until one fails",
        children=(1, UNLIMITED),
        tick=closures.ordered(SUCCESS),
        look=Look("\N{RIGHTWARDS ARROW}", "bold blue", "#dfe6f7", "#3f5fa8"),
        advance_status=SUCCESS,
        stock=Target("Sequence", (), "Sequence('sequence', memory=True, children=["),
        ours=Target("InterruptibleSequence", (), "InterruptibleSequence", "Control"),
    ),
    "parallel": NodeKind(
        paper=True,
        meaning="runs all its children at once",
        children=(1, UNLIMITED),
        args=ParallelArgs,
        arguments=(
            Argument("success", Sort.POLICY, "how many must succeed", POLICIES, COUNTS, "all"),
            Argument("failure", Sort.POLICY, "how many must fail", POLICIES, COUNTS, "one"),
        ),
        tick=closures.parallel,
        look=Look("\N{RIGHTWARDS PAIRED ARROWS}", "bold magenta", "#f3e0ec", "#a8437e"),
        concurrent=True,
        stock=Target(
            "Parallel",
            ("success_count", "failure_count"),
            "Parallel({name!r}, ParallelPolicy.{policy}, children=[",
        ),
        ours=Target(
            "JudgedParallel",
            ("success", "failure"),
            "JudgedParallel('parallel', {success!r}, {failure!r}, children=[",
            "Control",
        ),
    ),
    "inverter": NodeKind(
        paper=True,
        meaning="turns success into failure and failure into success",
        tick=closures.ending((SUCCESS, FAILURE)),
        look=Look("\N{NOT SIGN}", "red", "#fbe3d6", "#d55e00"),
        ends=(SUCCESS, FAILURE),
        stock=Target("Inverter", (), "Inverter"),
    ),
    "repeater": NodeKind(
        paper=True,
        meaning="repeats its child until it has succeeded a number of times",
        args=CountArgs,
        arguments=(Argument("count", Sort.COUNT, "successes of the child", range=COUNTS),),
        tick=closures.repeating(SUCCESS),
        look=Look("\N{CLOCKWISE OPEN CIRCLE ARROW}", "magenta", "#efe3f5", "#7f4fa3"),
        counts=SUCCESS,
        stock=Target("Repeat", ("num_cycles",), "Repeat('repeater', num_success={count}, child="),
        ours=Target("RepeatPerTick", ("num_cycles",), category="Decorator"),
    ),
    "retry": NodeKind(
        meaning="repeats its child until it succeeds, or has failed a number of times",
        args=CountArgs,
        arguments=(Argument("count", Sort.COUNT, "failures of the child", range=COUNTS),),
        tick=closures.repeating(FAILURE),
        look=Look("\N{ANTICLOCKWISE OPEN CIRCLE ARROW}", "magenta", "#f7e3f0", "#a23f7e"),
        counts=FAILURE,
        stock=Target(
            "RetryUntilSuccessful",
            ("num_attempts",),
            "Retry('retry', num_failures={count}, child=",
        ),
        ours=Target("RetryPerTick", ("num_attempts",), category="Decorator"),
    ),
    "force_success": NodeKind(
        meaning="turns failure into success",
        tick=closures.ending((SUCCESS, SUCCESS)),
        look=Look("\N{CHECK MARK}", "green", "#e3f3df", "#3f7f2f"),
        ends=(SUCCESS, SUCCESS),
        stock=Target("ForceSuccess", (), "FailureIsSuccess"),
    ),
    "force_failure": NodeKind(
        meaning="turns success into failure",
        tick=closures.ending((FAILURE, FAILURE)),
        look=Look("\N{BALLOT X}", "red", "#fbe0e0", "#b02f2f"),
        ends=(FAILURE, FAILURE),
        stock=Target("ForceFailure", (), "SuccessIsFailure"),
    ),
    "reactive_selector": NodeKind(
        meaning="tries its children in order in each tick until one does not fail",
        children=(1, UNLIMITED),
        tick=closures.reactive(FAILURE),
        look=Look("?\N{CLOCKWISE OPEN CIRCLE ARROW}", "bold cyan", "#d7ecfa", "#0072b2"),
        advance_status=FAILURE,
        reactive=True,
        stock=Target("ReactiveFallback", (), "Selector('selector', memory=False, children=["),
    ),
    "reactive_sequence": NodeKind(
        meaning="runs its children in order in each tick until one does not succeed",
        children=(1, UNLIMITED),
        tick=closures.reactive(SUCCESS),
        look=Look(
            "\N{RIGHTWARDS ARROW}\N{CLOCKWISE OPEN CIRCLE ARROW}", "bold blue", "#dfe6f7", "#3f5fa8"
        ),
        advance_status=SUCCESS,
        reactive=True,
        stock=Target("ReactiveSequence", (), "Sequence('sequence', memory=False, children=["),
    ),
    "wait": NodeKind(
        meaning="waits for a number of seconds, then runs its child",
        args=SecondsArgs,
        arguments=(Argument("seconds", Sort.SECONDS, "before its child starts", range=SECONDS),),
        tick=closures.wait,
        look=Look("\N{HOURGLASS}", "magenta", "#efe3f5", "#7f4fa3"),
        delayed=True,
        stock=Target("Delay", ("delay_msec",)),
        ours=_in_ticks("WaitTicks"),
    ),
    "timeout": NodeKind(
        meaning="fails when its child has run for a number of seconds",
        args=SecondsArgs,
        arguments=(Argument("seconds", Sort.SECONDS, "of its child at most", range=SECONDS),),
        tick=closures.timeout,
        look=Look("\N{STOPWATCH}", "red", "#fbe0e0", "#b02f2f"),
        may_fail=True,
        stock=Target("Timeout", ("msec",)),
        ours=_in_ticks("TimeoutTicks"),
    ),
    "cooldown": NodeKind(
        meaning="fails for a number of seconds after its child has ended",
        args=SecondsArgs,
        arguments=(Argument("seconds", Sort.SECONDS, "after an end of its child", range=SECONDS),),
        tick=closures.cooldown,
        look=Look("\N{SNOWFLAKE}", "cyan", "#e0eefb", "#2f6fb0"),
        may_fail=True,
    ),
    "pipeline": NodeKind(
        meaning="runs its children as a sequence that repeats the earlier ones in each tick, as"
        " Nav2's PipelineSequence",
        children=(1, UNLIMITED),
        tick=closures.pipeline,
        look=Look("\N{RIGHTWARDS TWO HEADED ARROW}", "bold blue", "#dfe6f7", "#3f5fa8"),
        opaque=True,
        stock=Target("PipelineSequence"),
        instead="`reactive_sequence`, which ticks no running child before a later one",
    ),
    "random_selector": NodeKind(
        meaning="tries its children in an order that it draws at each start until one succeeds, as"
        " NPBehave's RandomSelector",
        children=(1, UNLIMITED),
        tick=steered.random_selector,
        look=Look("?\N{GAME DIE}", "bold cyan", "#d7ecfa", "#0072b2"),
        opaque=True,
        remembers_end=True,
    ),
    "if_else": NodeKind(
        meaning="runs its first child; after a success the second, after a failure the third, as"
        " BehaviorTree.CPP's IfThenElse",
        children=(2, 3),
        tick=steered.if_else,
        look=Look("\N{DOWNWARDS ARROW WITH TIP LEFTWARDS}", "yellow", "#fdf0cf", "#b57a00"),
        opaque=True,
        stock=Target("IfThenElse"),
        instead="`selector { sequence { test x } y }`, which goes on to y if x fails",
    ),
    "round_robin": NodeKind(
        meaning="tries its children in turn, beginning after the one that succeeded last, as Nav2's"
        " RoundRobin",
        children=(1, UNLIMITED),
        tick=steered.round_robin,
        look=Look("\N{ANTICLOCKWISE GAPPED CIRCLE ARROW}", "bold cyan", "#d7ecfa", "#0072b2"),
        opaque=True,
        remembers_end=True,
        stock=Target("RoundRobin", ("wrap_around",)),
        instead="`selector`, which begins with its first child",
    ),
    "recovery": NodeKind(
        meaning="runs its first child; after a failure the second, then the first again, as Nav2's"
        " RecoveryNode",
        children=(2, 2),
        args=CountArgs,
        arguments=(Argument("count", Sort.COUNT, "recoveries at most", range=COUNTS),),
        tick=steered.recovery,
        look=Look("\N{LEFTWARDS ARROW WITH HOOK}", "magenta", "#f7e3f0", "#a23f7e"),
        opaque=True,
        stock=Target("RecoveryNode", ("number_of_retries",)),
        instead="`retry` above a `selector` of both, the second in a `force_failure`",
    ),
    "until_failure": NodeKind(
        meaning="repeats its child until it fails",
        tick=closures.repeating(SUCCESS),
        look=Look("\N{INFINITY}", "magenta", "#efe3f5", "#7f4fa3"),
        counts=SUCCESS,
        stock=Target("KeepRunningUntilFailure", (), "SuccessIsRunning"),
    ),
    "until_success": NodeKind(
        meaning="repeats its child until it succeeds",
        tick=closures.repeating(FAILURE),
        look=Look("\N{INFINITY}", "magenta", "#f7e3f0", "#a23f7e"),
        counts=FAILURE,
    ),
    "every": NodeKind(
        meaning="starts its child again no earlier than a number of seconds after its success,"
        " as Nav2's RateController",
        args=SecondsArgs,
        arguments=(Argument("seconds", Sort.SECONDS, "after a success", range=SECONDS),),
        tick=closures.every,
        look=Look("\N{WATCH}", "magenta", "#efe3f5", "#7f4fa3"),
        opaque=True,
        stock=Target("RateController", ("hz",)),
        instead="`wait` above the child",
    ),
    "when": NodeKind(
        paper=True,
        meaning="runs its child while a condition holds",
        args=GuardArgs,
        arguments=(
            Argument("condition", Sort.CONDITION),
            Argument(
                "abort", Sort.WORD, "what a change of the condition stops", ABORTS, default="both"
            ),
        ),
        tick=closures.when,
        look=Look("\N{WHITE DIAMOND}", "yellow", "#fdf0cf", "#b57a00", "pointed"),
        ours=Target(
            "When", ("condition", "abort"), "When({condition}, abort={abort!r}, child=", "Decorator"
        ),
    ),
    "always": NodeKind(
        meaning="succeeds, fails or runs, and does nothing",
        children=(0, 0),
        args=AlwaysArgs,
        arguments=(Argument("status", Sort.WORD, "its status", ALWAYS),),
        tick=closures.always,
        look=Look("\N{BULLET}", "green", "#e3f3df", "#3f7f2f", "round"),
        statuses=lambda args: frozenset({STATUS_NAMES.index(args.status.upper())}),
    ),
    "set": NodeKind(
        meaning="writes a key of the blackboard and succeeds; a tree reads the value at once",
        children=(0, 0),
        args=SetArgs,
        arguments=(Argument("assigned", Sort.ASSIGNMENT),),
        tick=closures.assign,
        look=Look("\N{COLON EQUALS}", "green", "#e3f3df", "#3f7f2f", "round"),
        statuses=lambda _: frozenset({SUCCESS}),
        stock=Target("Script", ("code",), "SetKey({assignment}"),
    ),
    "action": NodeKind(
        paper=True,
        meaning="acts on the world",
        children=(0, 0),
        args=ActionArgs,
        tick=closures.action,
        look=Look("", "green", "#d6f1e6", "#00775a", "round"),
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

SHORT: Final = ("for", "switch")  # keywords of what is expanded to several nodes

NODES: Final = (*KINDS, *SHORT, "use", "case", "otherwise")
"""The rules of the grammar that are nodes."""

CALLABLE: Final = frozenset((*KEYWORDS, *SHORT)) - {"when"}
"""Keywords that are the name of an action in front of a parenthesis: `timeout()`."""

COUNTED: Final = tuple(n for n, k in KINDS.items() if k.args is CountArgs)
"""The kinds whose keyword is followed by a count."""

TIMED: Final = tuple(n for n, k in KINDS.items() if k.args is SecondsArgs)
"""The kinds whose keyword is followed by a number of seconds."""

TARGETS: Final = {
    target.tag: (name, target)
    for name, kind in KINDS.items()
    for target in (kind.stock, kind.ours)
    if target and target.tag
}
"""The nodes of BehaviorTree.CPP and of our header, by tag: our kind and the node."""

NAV2: Final = frozenset(("pipeline", "round_robin", "recovery", "every"))
"""The kinds with an equivalent in Nav2 only."""


def kind_of(node: Node) -> NodeKind:
    """The record of a node's kind."""
    return KINDS[node.kind]


def is_opaque(node: Node) -> bool:
    """True if analyses conclude nothing from a node: by its kind, or as its count is a key."""
    return kind_of(node).opaque or (isinstance(node.args, CountArgs) and bool(keys_of(node.args)))


def advance_status(node: Node) -> int:
    """The status of a child after which a selector or sequence starts the next one."""
    status = kind_of(node).advance_status
    assert status is not None
    return status


def needs_each_tick(tree: Node) -> bool:
    """True if a tree has a node that counts seconds, or the next ticks may differ although no
    condition changes: it remembers its last status, or its count is a key."""
    return any(
        node.kind in TIMED
        or kind_of(node).remembers_end
        or (isinstance(node.args, CountArgs) and keys_of(node.args))
        for node in walk(tree)
    )
