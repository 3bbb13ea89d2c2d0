"""Edits: changes of a tree that a supervisor advises.

An edit names an individual and a place in its tree, and has a reason. A place is a path such as
`0/2`, the third child of the root's first child; "" is the root. It can also be the text of a
subtree that occurs in the tree exactly once. EDITS has the kinds of edits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, ClassVar, Final

from pydantic import AfterValidator, ConfigDict, FiniteFloat, PlainSerializer, PlainValidator

from islandgp.bt.core.condition import terms, with_term
from islandgp.bt.core.kinds import REPEATS, kind_of
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import (
    FAILURE,
    CountArgs,
    Limits,
    Node,
    depth,
    replace_at,
    selector,
    size,
    spliced,
    within,
)
from islandgp.bt.core.printer import Named, condition_text
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import TreeError
from islandgp.plain import to_json

STRICT: Final = ConfigDict(strict=True, revalidate_instances="always")
"""Strict types, also for the fields of an instance, as supervisors create edits unchecked."""


def encodable(text: str) -> str:
    """The text. Raises ValueError if it cannot be encoded as UTF-8 (a lone surrogate)."""
    text.encode()  # its UnicodeEncodeError is a ValueError
    return text


@lru_cache(maxsize=64)  # supervisors return the same trees repeatedly
def _reparsed(tree: Node) -> Node:
    return parse(to_text(tree))


def _in_language(tree: object) -> Node:
    """The tree, printed and parsed. Raises ValueError for a tree outside the language."""
    try:
        # Texts are compared, as words of keys are known only with a vocabulary.
        if isinstance(tree, Node) and to_text(_reparsed(tree)) == to_text(tree):
            return tree
    except (TreeError, LookupError, TypeError, ValueError, AttributeError):
        pass
    raise ValueError("expected a tree of the language, as bt.core.language.parse makes of a text")


Text = Annotated[str, AfterValidator(encodable)]
CheckedTree = Annotated[Node, PlainValidator(_in_language), PlainSerializer(to_text)]

Path = tuple[int, ...]  # a place in a tree: the index of a child on each level, from the root on


@dataclass(frozen=True, slots=True)
class Edit:
    """A change of a tree, advised by a supervisor.

    Raises:
        ValueError: the kind is unknown, or a field is missing, or the kind does not use a field.
    """

    __pydantic_config__: ClassVar = STRICT

    kind: str  # a key of EDITS
    of: Text  # id of the individual whose tree is changed, "<generation>.<slot>"
    at: Text = ""  # place in its tree
    branch: CheckedTree | None = None  # front, insert, replace: the new branch
    number: FiniteFloat | None = None  # number: the new value
    term: int = 0  # number: index of the term in the condition of a `when`
    donor: Text = ""  # combine: id of the individual from which the branch is copied
    donor_at: Text = ""  # combine: place in the donor's tree
    reason: Text = ""  # for the record and for reports

    def __post_init__(self) -> None:
        """Check that the fields are those of the kind."""
        if self.kind not in EDITS:
            raise ValueError(
                f"expected an edit of one of the kinds {', '.join(EDITS)}, found {self.kind!r}"
            )
        needs = EDITS[self.kind].needs
        fields = {
            "branch": self.branch is not None,
            "number": self.number is not None,
            "donor": bool(self.donor),
        }
        for name, is_given in fields.items():
            if is_given != (name == needs):
                expected, actual = ("a", "none") if name == needs else ("no", "one")
                raise ValueError(
                    f"expected {expected} {name} in an edit {self.kind}, found {actual}"
                )


@dataclass(frozen=True, slots=True)
class EditKind:
    """A kind of edit: its fields and its function."""

    needs: str  # the field of `Edit` that it uses besides `of`, `at` and `reason`
    meaning: str  # one line, for documentation and prompts
    change: Callable[[Node, Path, Node], Node] | None
    """Returns the changed tree, for the tree, the place, and the branch of the edit or the donor.
    Raises ValueError if the edit is not possible there. None: `_with_number` changes the tree."""


@dataclass(frozen=True, slots=True)
class EditRecord:
    """An edit in a record, and whether it was accepted."""

    kind: str
    of: str
    at: str
    branch: str | None  # canonical text
    number: float | None
    term: int
    donor: str
    donor_at: str
    reason: str
    refused: str  # why it was refused, or ""


@dataclass(frozen=True, slots=True)
class EditTrial:
    """The fitness of an edited tree in its first generation, and of the tree before the edit.

    Both are measured in the same worlds.
    """

    id: str  # of the edited tree's individual
    parent: str  # id of the individual that was edited
    fitness: float  # of the edited tree, points
    parent_fitness: float  # of the tree before the edit, points


def node_at(tree: Node, path: Path) -> Node:
    """The node at a path. Raises ValueError if there is none."""
    for level, index in enumerate(path):
        if index >= len(tree.children):
            raise ValueError(
                f"expected a place in the tree, found {path_text(path)!r}: the node at"
                f" {path_text(path[:level])!r} has {len(tree.children)} children"
            )
        tree = tree.children[index]
    return tree


def path_text(path: Path) -> str:
    """A path as text: `0/2/1`, or "" for the root."""
    return "/".join(map(str, path))


def with_node(tree: Node, path: Path, new: Node) -> Node:
    """The tree with the node at a path replaced. Raises ValueError if there is none."""
    node_at(tree, path)
    return replace_at(tree, [place for place, _ in nodes_with_paths(tree)].index(path), new)


def nodes_with_paths(tree: Node, path: Path = ()) -> Iterator[tuple[Path, Node]]:
    """Each node of a tree and its path, in document order."""
    yield path, tree
    for index, child in enumerate(tree.children):
        yield from nodes_with_paths(child, (*path, index))


def path_of(tree: Node, at: str, vocabulary: Vocabulary | None = None) -> Path:
    """The path of a place. The last index may be the number of children, for an insertion.

    Args:
        tree: the tree.
        at: a place such as `0/2/1`, or the text of a subtree.
        vocabulary: of the domain, to read the text of a subtree.

    Raises:
        ValueError: the text is neither a path nor a tree, or the tree does not have this
            subtree exactly once.
    """
    steps = [step.strip() for step in at.strip().strip("/").split("/")]
    if steps == [""]:
        return ()
    if all(step.isascii() and step.isdigit() and len(step) < 7 for step in steps):
        return tuple(map(int, steps))
    try:
        target = parse(at, vocabulary)
    except TreeError:
        raise ValueError(
            f"expected a place such as 0/2/1, or the text of a subtree, found {at[:60]!r}"
        ) from None
    paths = [path for path, node in nodes_with_paths(tree) if node == target]
    if len(paths) == 1:
        return paths[0]
    if not paths:
        raise ValueError(f"expected a subtree of the tree as the place, found {at[:60]!r}")
    raise ValueError(
        f"expected a subtree that occurs in the tree once, found it {len(paths)} times, at"
        f" {' and '.join(map(path_text, paths[:3]))}; name one of these places"
    )


def is_selector(node: Node) -> bool:
    """True for a selector, also a reactive one."""
    return kind_of(node).advance_status == FAILURE


def put_in_front(tree: Node, path: Path, branch: Node) -> Node:
    """The tree with a branch that runs before the node at a path.

    If the node's parent is a selector, the branch becomes the sibling before the node. Otherwise,
    if the node is a selector, the branch becomes its first child. Otherwise a new selector with the
    two as children replaces the node.
    """
    node = node_at(tree, path)
    if path and is_selector(node_at(tree, path[:-1])):
        return _inserted(tree, path, branch)
    if is_selector(node):
        return with_node(tree, path, spliced(node, 0, 0, branch))
    return with_node(tree, path, selector(branch, node))


def _inserted(tree: Node, path: Path, branch: Node) -> Node:
    """The tree with a branch inserted as a child at a path."""
    parent = node_at(tree, path[:-1]) if path else None
    if parent is None or len(parent.children) >= kind_of(parent).children[1]:
        raise ValueError(
            "expected the place of a child of a selector, sequence or parallel, found"
            f" {path_text(path)!r}"
        )
    if path[-1] > len(parent.children):
        raise ValueError(
            f"expected a place among the {len(parent.children)} children of"
            f" {path_text(path[:-1])!r} or after the last, found {path_text(path)!r}"
        )
    return with_node(tree, path[:-1], spliced(parent, path[-1], 0, branch))


def _with_number(tree: Node, path: Path, number: float, place: int) -> Node:
    """The tree with a new count of a repeater, or a new number in a term of a guard."""
    node = node_at(tree, path)
    if isinstance(node.args, CountArgs):
        fewest, most = REPEATS
        if number != int(number) or not fewest <= number <= most:
            raise ValueError(f"expected a count of {fewest} to {most}, found {number:g}")
        return with_node(tree, path, node._replace(args=CountArgs(int(number))))
    if node.guard is None:
        raise ValueError(
            f"expected a `when` or a repeater at {path_text(path)!r}, found {node.kind}"
        )
    condition = node.guard.condition
    conditions = list(terms(condition))
    if not 0 <= place < len(conditions):
        raise ValueError(f"expected a term of 0 to {len(conditions) - 1}, found {place}")
    term = conditions[place]
    if term.operator in ("is", "not"):
        raise ValueError(f"expected a comparison with a number, found the flag {term.key}")
    if not term.single or isinstance(term.number, Named):
        raise ValueError(f"expected a comparison with a number, found {condition_text(term)}")
    changed = with_term(condition, place, term._replace(number=float(number)))
    assert changed is not None
    return with_node(tree, path, node._replace(args=node.guard._replace(condition=changed)))


EDITS: Final[Mapping[str, EditKind]] = {
    "front": EditKind(
        "branch", "inserts a branch that is tried before the node at the place", put_in_front
    ),
    "insert": EditKind(
        "branch",
        "inserts a branch into a selector, sequence or parallel; the place is the future one of the"
        " branch: 0/2 makes it the third child of the node 0",
        _inserted,
    ),
    "replace": EditKind("branch", "replaces the subtree at the place by a branch", with_node),
    "number": EditKind("number", "changes a number of a `when`, or the count of a repeater", None),
    "combine": EditKind(
        "donor",
        "inserts the donor's branch at `donor_at`; it is tried before the node at the place",
        put_in_front,
    ),
}


def edited(edit: Edit, trees: Mapping[str, Node], vocabulary: Vocabulary, limits: Limits) -> Node:
    """The edited tree.

    Args:
        edit: the change.
        trees: the trees that the edit can refer to, by id.
        vocabulary: of the domain.
        limits: of the edited tree.

    Raises:
        ValueError: the edit refers to a tree or place that does not exist, or changes nothing; or
            the edited tree exceeds the limits, is not in the language, or has a new part that can
            never run or never succeed.
    """
    tree, branch, change = _tree(edit.of, trees), edit.branch, EDITS[edit.kind].change
    if edit.donor:
        donor = _tree(edit.donor, trees)
        branch = node_at(donor, path_of(donor, edit.donor_at, vocabulary))
    path = path_of(tree, edit.at, vocabulary)
    if change is not None and branch is not None:
        changed = change(tree, path, branch)
    else:
        assert edit.number is not None
        changed = _with_number(tree, path, edit.number, edit.term)
    if changed == tree:
        raise ValueError("expected a change, found that the tree stays as it is")
    if not within(changed, limits):
        raise ValueError(
            f"expected at most {limits.max_nodes} nodes and {limits.max_depth} levels, found"
            f" {size(changed)} and {depth(changed)}"
        )
    try:
        text = to_text(changed)
        changed = parse(text, vocabulary)
    except TreeError as error:
        raise ValueError(str(error).splitlines()[0]) from None
    _check_working(to_text(tree), text, vocabulary)
    return changed


def _tree(name: str, trees: Mapping[str, Node]) -> Node:
    if name not in trees:
        raise ValueError(
            f"expected an individual of the population or of the archive, found {name[:60]!r}"
        )
    return trees[name]


def _check_working(before: str, after: str, vocabulary: Vocabulary) -> None:
    """Raises ValueError if an edit adds a part that can never run or never succeed."""
    from islandgp.bt.analysis.lint import warnings  # only for edits

    known, new = (
        [
            w.message
            for w in warnings(t, vocabulary)
            if w.code in ("unreachable", "never-succeeds", "shared-resource")
        ]
        for t in (before, after)
    )
    for message in new:
        if message not in known:
            raise ValueError(message)


def as_record(edit: Edit, refused: str) -> EditRecord:
    """The record of an edit; `refused` is the reason for its refusal, or ""."""
    return EditRecord(**to_json(edit), refused=refused)
