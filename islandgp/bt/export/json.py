"""Trees as JSON; reading a written file returns an equal tree.

docs/exports.md shows the format. An argument's name is that of `KINDS`. The condition of a `when`
is written as `key`, `op` and `number`, or as nested objects if it is joined. Comments and named
subtrees are left out, as they are not part of a tree.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any, Final, NoReturn

from islandgp.bt.core.condition import (
    FLAG_OPERATORS,
    OPERATORS,
    Compound,
    Condition,
    ConditionExpr,
    combine,
    negate,
)
from islandgp.bt.core.condition_builder import MAX_NESTED
from islandgp.bt.core.kinds import KINDS, Argument, Sort
from islandgp.bt.core.language import MAX_LEVELS, MAX_NODES, MAX_NUMBER, parse, to_text
from islandgp.bt.core.node import Node, Value
from islandgp.bt.core.parameters import is_text
from islandgp.bt.core.source import closest
from islandgp.bt.core.vocabulary import NAME, RESERVED, Vocabulary
from islandgp.errors import LimitError, TreeError

FORMAT: Final = "islandgp-tree"
VERSION: Final = 1

WORDS: Final[dict[str, tuple[str, ...]]] = {
    "op": (*OPERATORS, *FLAG_OPERATORS),
    **{a.name: (*a.words,) for kind in KINDS.values() for a in kind.arguments if a.words},
}
"""Arguments that are one of a few words."""


def to_json(tree: Node) -> str:
    """The text of a JSON file."""
    document = {"format": FORMAT, "version": VERSION, "tree": _plain(tree)}
    return json.dumps(document, indent=2) + "\n"


def from_json(text: str, vocabulary: Vocabulary | None = None, *, name: str = "<json>") -> Node:
    """The tree in a JSON text.

    Raises:
        TreeError: it is not JSON, or not such a tree; the message has the place.
    """
    try:
        document = json.loads(text.removeprefix("\ufeff"))
    except json.JSONDecodeError as error:
        raise TreeError(
            f"{name}:{error.lineno}:{error.colno}: not JSON: {error.msg}",
            line=error.lineno,
            column=error.colno,
        ) from None
    except ValueError:  # Python converts no more than some thousand digits
        raise TreeError(
            f"{name}: expected numbers from {-MAX_NUMBER} to {MAX_NUMBER}, found one of thousands"
            " of digits"
        ) from None
    except RecursionError:
        raise TreeError(f"{name}: the tree is nested too deeply") from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise TreeError(f'{name}: expected an object with "format": "{FORMAT}"')
    if document.get("version") != VERSION:
        raise TreeError(
            f'{name}: expected "version": {VERSION}, found {document.get("version")!r:.40}'
        )
    tree = _JsonReader(name).node(document.get("tree"), "tree", 1)
    # The text of the tree is parsed, as only the parser checks a whole tree.
    return parse(to_text(tree), vocabulary, name=f"{name}, as text")


def _plain(node: Node) -> dict[str, Any]:
    plain: dict[str, Any] = {"kind": node.kind}
    values: Iterable[Any] = node.args
    for argument, value in zip(KINDS[node.kind].arguments, values, strict=True):
        if isinstance(value, Condition):
            plain |= _plain_condition(value)
        elif isinstance(value, Compound):
            plain[argument.name] = _plain_condition(value)
        elif argument.sort is not Sort.VALUES:
            plain[argument.name] = _plain_value(value)
        elif value:
            plain[argument.name] = {name: _plain_value(each) for name, each in value}
    if node.children:
        plain["children"] = [_plain(child) for child in node.children]
    return plain


def _plain_condition(expr: ConditionExpr) -> dict[str, Any]:
    if isinstance(expr, Condition):
        right: dict[str, Any] = {"number": _plain_value(expr.number)}
        if word := expr.other or getattr(expr.number, "name", ""):
            right = {"word": word}
        return {"key": expr.key, "op": expr.operator, **right}
    parts = [_plain_condition(part) for part in expr.parts]
    return {expr.word: parts[0] if expr.word == "not" else parts}


def _right(value: dict[str, Any]) -> str:
    """The entry with the right side of a comparison: a number, or a word or a key."""
    return "word" if "word" in value else "number"


def _plain_value(value: Any) -> Any:
    """A value; a float without decimals as an integer."""
    return int(value) if isinstance(value, float) and value == int(value) else value


class _JsonReader:
    """Turns plain values into nodes and checks their types."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._nodes = 0

    def node(self, value: Any, at: str, level: int) -> Node:
        """The node at a path such as `tree.children[0]`."""
        if not isinstance(value, dict):
            self._fail(at, f"expected a node, found {value!r:.40}")
        self._nodes += 1
        if level > MAX_LEVELS or self._nodes > MAX_NODES:
            raise LimitError(
                f"{self._name}: {_shortened(at)}: expected a tree of at most {MAX_LEVELS} levels"
                f" and {MAX_NODES} nodes"
            )
        kind = value.get("kind")
        if not isinstance(kind, str) or kind not in KINDS:
            guess = closest(str(kind), KINDS)
            hint = f"; did you mean {guess!r}?" if guess else ""
            self._fail(at, f"expected a kind ({', '.join(KINDS)}), found {kind!r:.40}{hint}")
        arguments = KINDS[kind].arguments
        names = {argument.name for argument in arguments}
        if "condition" in names and "condition" not in value:
            names = {"key", "op", _right(value), *names} - {"condition"}
        extra = value.keys() - {"kind", "children", *names}
        if extra:
            self._fail(at, f"unknown entry {min(extra)!r:.40} of {kind}")
        children = value.get("children", [])
        fewest, most = KINDS[kind].children
        if not isinstance(children, list) or not fewest <= len(children) <= most:
            expected = fewest if fewest == most else f"at least {fewest}"
            self._fail(at, f"expected {expected} children of {kind}")
        values = [self._value(value, argument, at) for argument in arguments]
        places = ((child, f"{at}.children[{i}]") for i, child in enumerate(children))
        nodes = tuple(self.node(child, place, level + 1) for child, place in places)
        return Node(kind, KINDS[kind].make_args(values), nodes)

    def _values(self, arguments: Any, at: str) -> tuple[tuple[str, Value], ...]:
        """The values of an action's arguments."""
        if not isinstance(arguments, dict):
            self._fail(at, f"expected values by argument, found {arguments!r:.40}")
        for name in arguments:
            self._argument({"name": name}, "name", at)
        kinds = {
            name: "number" if isinstance(v, int | float) else "text"
            for name, v in arguments.items()
        }
        return tuple(
            (n, self._argument({k: arguments[n]}, k, f"{at}.{n}")) for n, k in kinds.items()
        )

    def _value(self, value: dict[str, Any], argument: Argument, at: str) -> Any:
        if argument.sort is Sort.VALUES:
            return self._values(value.get(argument.name, {}), f"{at}.{argument.name}")
        if argument.sort is not Sort.CONDITION:
            return self._argument(value, argument.name, at)
        if "condition" in value:
            return self._condition(value["condition"], f"{at}.condition", 1)
        return self._single(value, at)

    def _condition(self, value: Any, at: str, level: int) -> ConditionExpr:
        if not isinstance(value, dict):
            self._fail(at, f"expected a condition, found {value!r:.40}")
        if level > MAX_NESTED:
            self._fail(at, f"expected a condition of at most {MAX_NESTED} levels")
        if "key" in value:
            if extra := value.keys() - {"key", "op", _right(value)}:
                self._fail(at, f"unknown entry {min(extra)!r:.40} of a condition")
            return self._single({"number": 0, **value}, at)
        if len(value) != 1 or (word := next(iter(value))) not in ("and", "or", "not"):
            self._fail(at, 'expected one of "and", "or", "not", or "key", "op" and "number"')
        inside = [value[word]] if word == "not" else value[word]
        if not isinstance(inside, list) or not inside:
            self._fail(at, f"expected a list of conditions as {word!r}, found {inside!r:.40}")
        parts = [
            self._condition(each, f"{at}.{word}[{i}]", level + 1) for i, each in enumerate(inside)
        ]
        return negate(parts[0]) if word == "not" else combine(word, parts)

    def _single(self, value: dict[str, Any], at: str) -> Condition:
        key, operator, right = (
            self._argument(value, argument, at) for argument in ("key", "op", _right(value))
        )
        if operator in FLAG_OPERATORS and right != 0:
            self._fail(at, f'expected "number": 0 beside the op {operator}, found {right}')
        if isinstance(right, str):  # a key, or a word of the key, as the vocabulary has it
            return Condition(str(key), str(operator), 0.0, right)
        return Condition(str(key), str(operator), right)

    def _argument(self, value: dict[str, Any], argument: str, at: str) -> str | float:
        entry = value.get(argument)
        policy = argument in ("success", "failure") and isinstance(entry, int | float)
        if policy or argument in ("number", "count", "seconds"):
            if isinstance(entry, bool) or not isinstance(entry, int | float):
                self._fail(at, f"expected a number as {argument!r}, found {entry!r:.40}")
            if not abs(entry) <= MAX_NUMBER:
                self._fail(
                    at,
                    f"expected {argument!r} from {-MAX_NUMBER} to {MAX_NUMBER}: out of range is"
                    f" {entry!r:.40}",
                )
            return int(entry) if entry == int(entry) and argument != "number" else float(entry)
        if argument == "text" and isinstance(entry, str) and is_text(entry):
            return entry
        choices = WORDS.get(argument)
        if choices is not None and entry not in choices:
            guess = closest(str(entry), choices)
            hint = f"; did you mean {guess!r}?" if guess else ""
            self._fail(
                at, f"expected {argument!r}: one of {' '.join(choices)}, found {entry!r:.40}{hint}"
            )
        if not isinstance(entry, str) or (
            choices is None and (not NAME.fullmatch(entry) or entry in RESERVED)
        ):
            self._fail(at, f"expected a word as {argument!r}, found {entry!r:.40}")
        return entry

    def _fail(self, at: str, message: str) -> NoReturn:
        raise TreeError(f"{self._name}: {_shortened(at)}: {message}")


def _shortened(at: str) -> str:
    """A path whose middle is left out if it is very long."""
    return at if len(at) <= 100 else f"{at[:40]}...{at[-40:]}"
