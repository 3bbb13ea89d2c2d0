"""Actions that would use one resource, such as the base of a robot, in the same tick.

An action holds the resources of its declaration (`Action.uses`) until it ends. So only nodes that
run several children in one tick can make two actions share one: a parallel, a pipeline, and a
reactive composite in which an earlier action succeeds in each tick while a later one runs.
"""

from __future__ import annotations

from itertools import combinations, islice
from typing import NamedTuple

from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.node import FAILURE, SUCCESS, Node, replace_at, size, walk
from islandgp.bt.core.printer import head
from islandgp.bt.core.vocabulary import Vocabulary


class Conflict(NamedTuple):
    """Two actions that share a resource and can run in the same tick."""

    first: int  # place of an action in document order
    second: int  # place of the other
    resource: str
    node: int  # place of the node that runs both
    branch: int  # index of its child with the second action


class _User(NamedTuple):
    """A leaf that uses resources."""

    place: int
    uses: frozenset[str]
    goes_on: frozenset[int]  # statuses of the present node in a tick in which the action succeeds


def conflicts(tree: Node, vocabulary: Vocabulary) -> list[Conflict]:
    """The pairs of actions of a tree that share a resource and can run in the same tick."""
    if not any(action.uses for action in vocabulary.actions.values()):
        return []
    if not any(len(node.children) > 1 and _joins(node) for node in walk(tree)):
        return []
    found: list[Conflict] = []
    _users(tree, 0, vocabulary, found)
    return sorted(found)


def conflict_in_words(tree: Node, vocabulary: Vocabulary) -> str:
    """A clause on the first conflict of a tree; "" if there is none."""
    for first, second, resource, *_ in conflicts(tree, vocabulary)[:1]:
        nodes = list(walk(tree))
        names = f"{head(nodes[first])} and {head(nodes[second])}"
        return f"{names} can run in the same tick, but both use {resource}"
    return ""


def _users(node: Node, place: int, vocabulary: Vocabulary, found: list[Conflict]) -> list[_User]:
    """The users of resources below a node; its conflicts are added to `found`."""
    if node.action:
        uses = frozenset(vocabulary.action(node.action).uses)
        return [_User(place, uses, frozenset({SUCCESS}))] if uses else []
    branches: list[list[_User]] = []
    below = place + 1
    for child in node.children:
        branches.append(_users(child, below, vocabulary, found))
        below += size(child)
    for (_, earlier), (at, later) in combinations(enumerate(branches), 2):
        for one in earlier:
            for other in later:
                shared = one.uses & other.uses
                if shared and _together(node, one):
                    found.append(Conflict(one.place, other.place, min(shared), place, at))
    return [_above(node, user) for users in branches for user in users]


def _joins(node: Node) -> bool:
    """True if a node can run several of its children in one tick."""
    kind = kind_of(node)
    return kind.concurrent or kind.reactive or node.kind == "pipeline"


def _together(node: Node, earlier: _User) -> bool:
    """True if a later child can run in a tick in which an action of an earlier one did."""
    kind = kind_of(node)
    return _joins(node) and (not kind.reactive or kind.advance_status in earlier.goes_on)


def _above(node: Node, user: _User) -> _User:
    """The user as seen from the node above its branch."""
    kind = kind_of(node)
    if kind.decorates and not kind.opaque:
        return user._replace(goes_on=frozenset(kind.ends[status] for status in user.goes_on))
    if kind.decorates or kind.advance_status in user.goes_on or kind.concurrent or kind.opaque:
        return user._replace(goes_on=frozenset({FAILURE, SUCCESS}))
    return user


def without_conflicts(tree: Node, vocabulary: Vocabulary) -> Node:
    """The tree without the branches whose actions would share a resource with an earlier one."""
    while found := conflicts(tree, vocabulary):
        node, branch = found[0].node, found[0].branch
        parent = next(islice(walk(tree), node, None))
        children = parent.children[:branch] + parent.children[branch + 1 :]
        tree = replace_at(tree, node, parent._replace(children=children))
    return tree
