"""Shorter forms of a tree that may change its behaviour: deletions, hoists, rounded numbers.

`simplify` makes changes that provably keep the behaviour. The forms here are candidates only:
`evolution.prune` evaluates them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from itertools import count, islice
from math import floor, log10
from typing import Final, NamedTuple

from islandgp.bt.analysis.context import contradictions, spots
from islandgp.bt.core.condition import Condition, combine, terms, with_term
from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.node import (
    GuardArgs,
    Node,
    guard_of,
    replace_at,
    size,
    spliced,
    walk,
    with_above,
)
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
    for place, (node, above) in enumerate(with_above(tree)):
        path = tuple(map(head, (*above, node)))
        for new, change, saved in _changes(node):
            shorter = replace_at(tree, place, new)
            if shorter != tree and shorter not in forms:
                nodes = size(node) - size(new)
                forms[shorter] = ShorterForm(shorter, change, nodes, saved, path)
    return sorted(forms.values(), key=lambda form: (-form.nodes, -form.terms))


def removable(tree: Node) -> list[int]:
    """The places, in document order from 0, of the nodes that their parents can do without."""
    parents = [above[-1:] for _, above in with_above(tree)]
    return [place for place, above in enumerate(parents) if any(map(_has_several, above))]


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
        kept = node._replace(children=children)
        return _unwrapped(kept) if len(children) < len(node.children) else kept

    return visit(tree, False)


def _has_several(node: Node) -> bool:
    """True for a node with several children of a kind with any number of children."""
    return kind_of(node).children[0] == 1 < len(node.children)


def _changes(node: Node) -> Iterator[tuple[Node, str, int]]:
    """Shorter nodes in the place of a node, with the change and the number of terms saved."""
    if _has_several(node):
        for index, child in enumerate(node.children):
            yield _unwrapped(spliced(node, index, 1)), f"without {_named(child)}", 0
        yield from _joined(node)
        yield from _once(node)
    for child in node.children:
        dropped = size(node) - size(child)
        rest_words = "" if dropped == 1 else f" and {dropped - 1} more node{'s' * (dropped > 2)}"
        yield child, f"without the {_quoted(node)} above {_quoted(child)}{rest_words}", 0
    if node.guard is not None:
        yield from _plainer_guards(node, node.guard)


def _unwrapped(node: Node) -> Node:
    """The composite; with a single child, this child."""
    return node.children[0] if len(node.children) == 1 else node


def _joined(node: Node) -> Iterator[tuple[Node, str, int]]:
    """Neighbouring guards above equal children, with their conditions joined by `or`."""
    for index, (left, right) in enumerate(zip(node.children, node.children[1:], strict=False)):
        a, b = left.guard, right.guard
        if a is None or b is None or left.children != right.children or a.abort != b.abort:
            continue
        guard = GuardArgs(combine("or", (a.condition, b.condition)), a.abort)
        both = _unwrapped(spliced(node, index, 2, left._replace(args=guard)))
        yield both, f"with {_quoted(left)} and {_quoted(right)} joined", 0


def _once(node: Node) -> Iterator[tuple[Node, str, int]]:
    """The composite without a repetition of several children, as `A B` for `A B A B`."""
    children = node.children
    for length in range(2, len(children) // 2 + 1):
        for start in range(len(children) - 2 * length + 1):
            middle, end = start + length, start + 2 * length
            if children[start:middle] == children[middle:end]:
                shorter = spliced(node, middle, length)
                yield shorter, f"without a repetition in {_quoted(node)}", 0


def _plainer_guards(node: Node, guard: GuardArgs) -> Iterator[tuple[Node, str, int]]:
    """A guard without one of its terms, or without its abort rule."""
    parts = list(terms(guard.condition))
    for index, part in enumerate(parts if len(parts) > 1 else ()):
        change = f"without `{condition_text(part)}` of {_quoted(node)}"
        yield _with_term(node, index, None), change, 2
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
    guards = {
        above.place: above.node
        for _, node, context, path in spots(tree, vocabulary)
        if node.action and any(contradictions(node, context))
        for above, _ in reversed(path)
        if above.node.guard is not None and above.node.guard.checks_itself
    }
    forms = []
    for place, node in guards.items():
        guard = guard_of(node)
        freed = guard._replace(abort="lower" if guard.interrupts else "none")
        new = replace_at(tree, place, node._replace(args=freed))
        forms.append(ShorterForm(new, f"with `abort {freed.abort}` of {_quoted(node)}", 0))
    return forms


def rounded_forms(tree: Node) -> list[ShorterForm]:
    """The tree with its thresholds rounded to two digits: first all of them, then each one alone.

    Args:
        tree: any tree.

    Returns:
        Distinct trees, none of them equal to `tree`; empty if all numbers are as short already.
    """
    everything = tree
    single: list[ShorterForm] = []
    for place, node in enumerate(walk(tree)):
        for index, before in enumerate(terms(node.guard.condition) if node.guard else ()):
            after = before._replace(number=rounded(before.number, DIGITS))
            if after == before:
                continue
            new = replace_at(tree, place, _with_term(node, index, after))
            change = f"with `{condition_text(after)}` for `{condition_text(before)}`"
            single.append(ShorterForm(new, change, 0))
            changed = next(islice(walk(everything), place, None))
            everything = replace_at(everything, place, _with_term(changed, index, after))
    change = f"with {len(single)} numbers rounded to {DIGITS} digits"
    return [*[ShorterForm(everything, change, 0)] * (len(single) > 1), *single]


def rounded(number: float, digits: int) -> float:
    """A number rounded to significant digits."""
    if number == 0:
        return 0.0
    return round(number, digits - 1 - floor(log10(abs(number))))


def _with_term(node: Node, index: int, term: Condition | None) -> Node:
    """The guard with a term of its condition replaced, or removed if another one is left."""
    guard = guard_of(node)
    condition = with_term(guard.condition, index, term)
    assert condition is not None
    return node._replace(args=guard._replace(condition=condition))


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
