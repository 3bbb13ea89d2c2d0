"""`islandgp verify-tree`: proves or refutes rules such as `never Drive while charge < 10`."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from typing import Any, Final

import click

from islandgp.bt.core.engine import ABORTED
from islandgp.bt.core.node import STATUS_NAMES, Node, walk
from islandgp.bt.core.printer import head
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.commands.files import FILE, display_name
from islandgp.commands.options import DomainOptions, with_vocabulary_options
from islandgp.commands.setting import read_in_domain
from islandgp_verify.rules import STEPS, CounterTick, RuleResult, check_rule, read_rule

STATUSES: Final = {**dict(enumerate(STATUS_NAMES)), ABORTED: "aborted"}
SHOWN: Final = 12  # ticks of a counterexample, the last ones


@click.command(
    epilog='\b\nExample:\n  islandgp verify-tree tree.bt "never Drive while energy < 10"'
)
@click.argument("file", type=FILE)
@click.argument("rules", nargs=-1, required=True)
@click.option(
    "--steps",
    type=click.IntRange(1, 2_000_000),
    default=STEPS,
    help="Maximum number of search steps per rule; 100,000 take some seconds.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the results as JSON.")
@with_vocabulary_options
def command(
    file: str, rules: tuple[str, ...], steps: int, as_json: bool, options: DomainOptions
) -> None:
    """Prove or refute that the tree in FILE keeps each of RULES.

    A rule is "never ACTION while CONDITION": the action is never called on a blackboard on
    which the condition holds, for all blackboards before it and all statuses that actions return.
    ACTION can have a condition on its arguments, "Drive(speed > 0.5)", or be the name of a
    resource, which is all actions that use it.
    A refutation has a sequence of blackboards that breaks the rule. Exit code 0 if all rules are
    proven, 1 if one is refuted or unknown.
    """
    _, vocabulary, tree = read_in_domain(file, options)
    parsed_rules = [read_rule(rule, vocabulary) for rule in rules]
    results = [check_rule(tree, rule, vocabulary, steps) for rule in parsed_rules]
    if as_json:
        nodes = [head(node) for node in walk(tree)]
        click.echo(json.dumps([_plain(result, nodes) for result in results], indent=1))
    else:
        for result in results:
            heading = f"{display_name(file)}: {result.rule.text}: {result.result}, {result.why}"
            click.echo("\n".join([heading, *_lines(tree, result, vocabulary)]))
    sys.exit(0 if all(result.result == "proven" for result in results) else 1)


def _plain(result: RuleResult, nodes: list[str]) -> dict[str, Any]:
    ticks = [
        {
            "board": tick.board,
            "nodes": [
                {"place": place, "node": nodes[place], "status": STATUSES[status]}
                for place, status in tick.statuses
            ],
        }
        for tick in result.ticks
    ]
    return {
        "rule": result.rule.text,
        "result": result.result,
        "why": result.why,
        "place": result.place,
        "ticks": ticks,
    }


def _lines(tree: Node, result: RuleResult, vocabulary: Vocabulary) -> Iterator[str]:
    """The counterexample: for each tick its blackboard, and the nodes with their statuses."""
    nodes = list(_levels(tree, 0))
    first = max(0, len(result.ticks) - SHOWN)
    if first:
        yield f"  ticks 1 to {first} are not shown; --json has all"
    for number, tick in enumerate(result.ticks[first:], first + 1):
        yield f"  tick {number}: {_board(tick, vocabulary)}"
        for place, status in tick.statuses:
            node, level = nodes[place]
            is_violation = number == len(result.ticks) and place == result.place
            mark = "  <- the rule is broken here" if is_violation else ""
            yield f"    {'  ' * level}{head(node)}: {STATUSES[status]}{mark}"


def _levels(node: Node, level: int) -> Iterator[tuple[Node, int]]:
    yield node, level
    for child in node.children:
        yield from _levels(child, level + 1)


def _board(tick: CounterTick, vocabulary: Vocabulary) -> str:
    """The values of a blackboard: flags by name, others by value."""
    keys = vocabulary.keys
    return ", ".join(
        (key if value else f"not {key}") if keys[key].flag else f"{key} {keys[key].text_of(value)}"
        for key, value in tick.board.items()
    )
