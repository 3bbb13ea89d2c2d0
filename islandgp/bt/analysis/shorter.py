"""Shorter forms of a tree that may change its behaviour: deletions, hoists, rounded numbers.

`simplify` makes changes that provably keep the behaviour. The forms here are candidates only:
`evolution.prune` evaluates them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from itertools import count
from math import floor, log10
from typing import Final, NamedTuple

from islandgp.bt.analysis.context import (
    NodeContext,
    child_contexts,
    contradictions,
    root_context,
)
from islandgp.bt.core.condition import Condition, ConditionExpr, combine, terms, with_term
from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.node import GuardArgs, Node, guard_of, replace_at, size, walk
from islandgp.bt.core.printer import condition_text, head
from islandgp.bt.core.vocabulary import Vocabulary

DIGITS: Final = 2  # significant digits of rounded numbers
MAX_WORDS: Final = 60  # characters of a node in a description
MAX_NAMES: Final = 3  # nodes in a description


class ShorterForm(NamedTuple):
    """A shorter form of a tree."""

    tree: Node
    change: str  # what is different, e.g. "without `when lap > 3` (4 nodes)"
    nodes: int  # that it saves, >= 0
    terms: int = 0  # terms of conditions and abort rules that it saves, if it saves no node
    above: tuple[str, ...] = ()  # the heads of the nodes from the root to the changed one


def shorter_forms(tree: Node) -> list[ShorterForm]:
    """All trees that are one change shorter, those that save most nodes first.

    A change removes a child of a composite or a repetition of several, replaces a node by one of
    its children, joins two neighbouring guards above equal children, or removes a term or the abort
    rule of a guard. A composite that is left with one child is replaced by it.

    Args:
        tree: any tree.

    Returns:
        Distinct trees, none of them equal to `tree`; empty for a single action.
    """
    forms: dict[Node, ShorterForm] = {}
    for place, (node, above) in enumerate(_with_heads(tree)):
        for new, change, saved in _changes(node):
            form = ShorterForm(
                replace_at(tree, place, new), change, size(node) - size(new), saved, above
            )
            if form.tree != tree:
                forms.setdefault(form.tree, form)
    return sorted(forms.values(), key=lambda form: (-form.nodes, -form.terms))


def _with_heads(node: Node, above: tuple[str, ...] = ()) -> Iterator[tuple[Node, tuple[str, ...]]]:
    """The nodes in document order, each with the heads of those above it and its own."""
    path = (*above, head(node))
    yield node, path
    for child in node.children:
        yield from _with_heads(child, path)


def removable(tree: Node) -> list[int]:
    """The places, in document order from 0, of the nodes that their parents can do without."""
    places: list[int] = []
    numbers = count()

    def visit(node: Node, among_others: bool) -> None:
        here = next(numbers)
        if among_others:
            places.append(here)
        for child in node.children:
            visit(child, _is_composite(node) and len(node.children) > 1)

    visit(tree, False)
    return places


def without(tree: Node, places: Collection[int]) -> Node | None:
    """The tree without some of its nodes and what is below them.

    Args:
        tree: any tree.
        places: of the nodes, some of `removable`.

    Returns:
        The shorter tree, in which no node is left without children. None if no node is left.
    """
    numbers = count()

    def visit(node: Node, gone: bool) -> Node | None:
        gone = next(numbers) in places or gone
        visited = [visit(child, gone) for child in node.children]
        children = tuple(child for child in visited if child is not None)
        if gone or (node.children and not children):
            return None
        return (
            _unwrapped(node, children)
            if len(children) < len(node.children)
            else node._replace(children=children)
        )

    return visit(tree, False)


def _is_composite(node: Node) -> bool:
    """True for kinds with any number of children."""
    return kind_of(node).children[0] == 1 < kind_of(node).children[1]


def _changes(node: Node) -> Iterator[tuple[Node, str, int]]:
    """Shorter nodes in the place of a node, with the change and the number of terms saved."""
    if _is_composite(node) and len(node.children) > 1:
        for index, child in enumerate(node.children):
            rest = (*node.children[:index], *node.children[index + 1 :])
            yield _unwrapped(node, rest), f"without {_named(child)}", 0
        yield from _joined(node)
        yield from _once(node)
    for child in node.children:
        dropped = size(node) - size(child)
        rest_words = "" if dropped == 1 else f" and {dropped - 1} more node{'s' * (dropped > 2)}"
        yield child, f"without the {_quoted(node)} above {_quoted(child)}{rest_words}", 0
    if node.guard is not None:
        yield from _plainer_guards(node, node.guard)


def _unwrapped(node: Node, children: Sequence[Node]) -> Node:
    """The composite with these children; with a single one, this child."""
    return children[0] if len(children) == 1 else node._replace(children=tuple(children))


def _joined(node: Node) -> Iterator[tuple[Node, str, int]]:
    """Neighbouring guards above equal children, with their conditions joined by `or`."""
    for index, (left, right) in enumerate(zip(node.children, node.children[1:], strict=False)):
        a, b = left.guard, right.guard
        if a is None or b is None or left.children != right.children or a.abort != b.abort:
            continue
        guard = GuardArgs(combine("or", (a.condition, b.condition)), a.abort)
        both = Node(left.kind, guard, left.children)
        children = (*node.children[:index], both, *node.children[index + 2 :])
        yield _unwrapped(node, children), f"with {_quoted(left)} and {_quoted(right)} joined", 0


def _once(node: Node) -> Iterator[tuple[Node, str, int]]:
    """The composite without a repetition of several children, as `A B` for `A B A B`."""
    children = node.children
    for length in range(2, len(children) // 2 + 1):
        for start in range(len(children) - 2 * length + 1):
            middle, end = start + length, start + 2 * length
            if children[start:middle] == children[middle:end]:
                rest = (*children[:middle], *children[end:])
                yield node._replace(children=rest), f"without a repetition in {_quoted(node)}", 0


def _plainer_guards(node: Node, guard: GuardArgs) -> Iterator[tuple[Node, str, int]]:
    """A guard without one of its terms, or without its abort rule."""
    parts = list(terms(guard.condition))
    for index, part in enumerate(parts if len(parts) > 1 else ()):
        shorter = with_term(guard.condition, index, None)
        assert shorter is not None  # a term is left
        change = f"without `{condition_text(part)}` of {_quoted(node)}"
        yield node._replace(args=guard._replace(condition=shorter)), change, 2
    if guard.abort != GuardArgs(guard.condition).abort:
        change = f"without `abort {guard.abort}` of `when {condition_text(guard.condition)}`"
        yield node._replace(args=GuardArgs(guard.condition)), change, 1


def freed_forms(tree: Node, vocabulary: Vocabulary) -> list[ShorterForm]:
    """The tree with a guard that no longer stops an action before it can succeed.

    Args:
        tree: any tree.
        vocabulary: declares what actions need to succeed.

    Returns:
        A tree for each guard with such an action below it; the innermost guards come first.
    """
    stopping: list[int] = []  # places of guards
    place = count()

    def visit(node: Node, context: NodeContext, guards: tuple[int, ...]) -> None:
        here = next(place)
        if node.guard is not None and node.guard.checks_itself:
            guards = (here, *guards)
        if node.action and any(contradictions(node, context)):
            stopping.extend(guards)
        for child, below in zip(node.children, child_contexts(node, context), strict=True):
            visit(child, below, guards)

    visit(tree, root_context(tree, vocabulary), ())
    nodes, forms = list(walk(tree)), []
    for at in dict.fromkeys(stopping):
        guard = guard_of(nodes[at])
        freed = guard._replace(abort="lower" if guard.interrupts else "none")
        new = replace_at(tree, at, nodes[at]._replace(args=freed))
        forms.append(ShorterForm(new, f"with `abort {freed.abort}` of {_quoted(nodes[at])}", 0))
    return forms


def rounded_forms(tree: Node) -> list[ShorterForm]:
    """The tree with its thresholds rounded to two digits: first all of them, then each one alone.

    Args:
        tree: any tree.

    Returns:
        Distinct trees, none of them equal to `tree`; empty if all numbers are as short already.
    """
    places = [
        (place, index)
        for place, node in enumerate(walk(tree))
        if node.guard is not None
        for index, term in enumerate(terms(node.guard.condition))
        if term.number != rounded(term.number, DIGITS)
    ]
    everything = tree
    single: list[ShorterForm] = []
    for place, index in places:
        changed, words = _with_rounded(tree, place, index)
        single.append(ShorterForm(changed, words, 0))
        everything, _ = _with_rounded(everything, place, index)
    change = f"with {len(places)} numbers rounded to {DIGITS} digits"
    together = [ShorterForm(everything, change, 0)]
    return [*(together if len(places) > 1 else []), *single]


def rounded(number: float, digits: int) -> float:
    """A number rounded to significant digits."""
    if number == 0:
        return 0.0
    return round(number, digits - 1 - floor(log10(abs(number))))


def _with_rounded(tree: Node, place: int, index: int) -> tuple[Node, str]:
    """The tree with one threshold rounded, and the change in words."""
    node = list(walk(tree))[place]
    assert node.guard is not None
    before = list(terms(node.guard.condition))[index]
    after = before._replace(number=rounded(before.number, DIGITS))
    condition = _replaced(node.guard.condition, index, after)
    new = node._replace(args=node.guard._replace(condition=condition))
    return (
        replace_at(tree, place, new),
        f"with `{condition_text(after)}` for `{condition_text(before)}`",
    )


def _replaced(condition: ConditionExpr, index: int, term: Condition) -> ConditionExpr:
    changed = with_term(condition, index, term)
    assert changed is not None
    return changed


def removal(tree: Node, places: Collection[int]) -> str:
    """What `without` takes away, in words."""
    names, end = [], 0
    for place, node in enumerate(walk(tree)):
        if place in places and place >= end:
            names.append(_named(node))
            end = place + size(node)
    more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
    return f"without {', '.join(names[:MAX_NAMES])}{more}"


def _named(node: Node) -> str:
    """A node in words, with its size if it has children."""
    nodes = size(node)
    return _quoted(node) if nodes == 1 else f"{_quoted(node)} ({nodes} nodes)"


def _quoted(node: Node) -> str:
    text = head(node)
    return f"`{text if len(text) <= MAX_WORDS else text[: MAX_WORDS - 3] + '...'}`"
