"""The language of one vocabulary as a grammar for constrained decoding, in Lark or GBNF notation.

Each text of the grammar is a tree that `parse` accepts with the vocabulary: names, operators,
words, arguments and their ranges are inserted, and the depth is limited. The number of nodes is
limited only with the number of children, so that a text may be too long for `parse`.

Each canonical text of
such a tree (`to_text`) is a text of the grammar, up to three limits: conditions are flat (up to 16
terms) or up to four terms and brackets with up to four terms each, texts of arguments are ASCII in
quotes, and thresholds have magnitudes below 1,000,000.

The kinds of nodes with their arguments come from `KINDS`, as those of `grammar/bt.lark` do.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from math import ceil, floor
from typing import Any, Final

from islandgp.bt.core.kind import Argument, Sort
from islandgp.bt.core.kinds import INNER, KINDS, REPEATS, UNLIMITED
from islandgp.bt.core.node import SECONDS
from islandgp.bt.core.node_builder import MAX_TERMS
from islandgp.bt.core.parameters import Parameter
from islandgp.bt.core.vocabulary import Key, Vocabulary
from islandgp.errors import DomainError

FORMATS: Final = ("lark", "gbnf")
MAX_WORDS: Final = 100  # most characters of an explanation
MAX_CHILDREN_NESTED: Final = 4  # most terms beside each other where brackets are allowed
MAX_TERMS_IN_JSON: Final = 3  # the same in JSON, and most terms: a small model would go on
COARSE: Final = 10  # in JSON, thresholds of wider ranges are whole numbers
_WORDS: Final = f"[A-Z][a-z ,]{{10,{MAX_WORDS}}}[.]"
_ANY_NUMBER: Final = "[-]?([0]|[1-9][0-9]{0,5})([.][0-9]{1,24})?"

Parts = tuple[str, ...]
"""One alternative: names of rules, names of patterns in upper case, and literals in quotes."""


@dataclass(frozen=True, slots=True)
class Grammar:
    """A context-free grammar. Its first rule is the start."""

    rules: Mapping[str, tuple[Parts, ...]]  # alternatives by name
    patterns: Mapping[str, str]  # regular expressions of character classes, by name in upper case

    def text(self, notation: str) -> str:
        """The grammar in a notation of FORMATS."""
        lark = notation == "lark"
        sign, first = (":", "start") if lark else ("::=", "root")
        names = dict.fromkeys(self.rules, "") | {next(iter(self.rules)): first}
        lines = [
            f"{names[name] or name} {sign} "
            + " | ".join(" ".join(names.get(p) or p for p in parts) or '""' for parts in choices)
            for name, choices in self.rules.items()
        ]
        fence = "/" if lark else ""
        lines += [f"{name} {sign} {fence}{each}{fence}" for name, each in self.patterns.items()]
        return "\n".join(lines) + "\n"


def tree_grammar(
    vocabulary: Vocabulary,
    depth: int,
    *,
    kinds: Collection[str] = INNER,
    children: int = UNLIMITED,
    in_json: bool = False,
) -> Grammar:
    """The grammar of the trees of a vocabulary.

    Args:
        vocabulary: the names.
        depth: most levels of a tree, >= 1.
        kinds: of inner nodes that a tree may have.
        children: most children of a composite, >= 1.
        in_json: True: for texts inside a JSON string: on one line, with quotes escaped, with an
            inner node as the root, with two children or more of each composite, with short
            conditions, and with thresholds within the ranges of their keys.

    Raises:
        DomainError: the vocabulary has no action.
    """
    if not vocabulary.actions:
        raise DomainError(
            f"Expected an action in the vocabulary of {vocabulary.domain}, found none: without one"
            " there is no tree."
        )
    writer = _Writer(vocabulary, in_json)
    root = f"node{depth}"
    writer.rule("wholetree", (root,), *[(root, '"\\n"')] * (not in_json))
    writer.rule("b", ('" "',), *[("LINE",)] * (not in_json))
    if not in_json:
        writer.patterns["LINE"] = f"[\\n][ ]{{0,{2 * depth}}}"
    known = [kind for kind in kinds if KINDS[kind].children != (0, 0)]
    heads = {k: writer.head(k) for k in known if k != "when" or vocabulary.keys}
    writer.rule("leaf", *(writer.action(n, i) for i, n in enumerate(vocabulary.actions)))
    for level in range(1, depth + 1):
        is_leaf = level < depth or depth == 1 or not in_json
        choices: list[Parts] = [("leaf",)] * is_leaf
        for kind, head in heads.items() if level > 1 else ():
            low, high = KINDS[kind].children
            if in_json and high > low:
                low = 2  # a model would nest composites of one child
            body = writer.body(level - 1, low, high, min(high, children))
            choices.append((*head, '" {"', "b", body, "b", '"}"'))
        writer.rule(f"node{level}", *choices)
    return Grammar(writer.rules, writer.patterns)


def answer_grammar(schema: Mapping[str, Any], tree: Grammar, rates: tuple[float, float]) -> Grammar:
    """The grammar of a model's JSON answer.

    Args:
        schema: JSON schema of the answer; its fields keep their order.
        tree: grammar of the field `tree`, for a JSON string.
        rates: lowest and highest number of the field `mutation_rate`.
    """
    rules: dict[str, tuple[Parts, ...]] = {"answer": (), "flag": (('"true"',), ('"false"',))}
    rules |= _STRINGS | {"tree": ((*_QUOTE, next(iter(tree.rules)), *_QUOTE),)}
    parts: list[str] = []
    for name, field in schema["properties"].items():
        parts.append(_literal(f'{", " if parts else "{"}"{name}": '))
        if "enum" in field:
            rules[f"word{len(parts)}"] = _choices(f'"{word}"' for word in field["enum"])
            parts.append(f"word{len(parts)}")
        elif name == "tree":
            parts.append("tree")
        else:
            parts.append({"boolean": "flag", "number": "RATE"}.get(field["type"], "text"))
    rules["answer"] = ((*parts, '"}"'),)
    if "tree" in parts:
        rules |= tree.rules
    else:
        del rules["tree"]
    rate = between(*rates, decimals=2)
    return Grammar(rules, {**tree.patterns, "WORDS": _WORDS, "RATE": rate})


def edit_grammar(tree: Grammar, places: Mapping[str, Sequence[str]]) -> Grammar:
    """The grammar of a model's JSON answer with one edit that adds or replaces a branch.

    A branch in front of a node has a guard, as the node could never run after one that never fails.

    Args:
        tree: grammar of the branch, for a JSON string.
        places: paths in the tree of each individual, by its id.
    """
    (root,) = tree.rules[next(iter(tree.rules))][0]
    guarded = tuple(parts for parts in tree.rules[root] if parts[0] == '"when"')
    branches = {"replace": tree.rules[root], **({"front": guarded} if guarded else {})}
    answer = (
        *(_literal('{"reasoning": '), "text", _literal(', "edits": [{"kind": '), "edit"),
        *(_literal(', "reason": '), "text", _literal("}]}")),
    )
    paths = (f'"{name}", "at": "{path}"' for name, each in places.items() for path in each)
    rules = {"answer": (answer,), **_STRINGS, "place": _choices(paths)}
    rules["edit"] = tuple(
        (
            _literal(f'"{kind}", "of": '),
            "place",
            _literal(', "branch": "'),
            f"{kind}branch",
            *_QUOTE,
        )
        for kind in branches
    )
    rules |= {f"{kind}branch": choices for kind, choices in branches.items()}
    return Grammar({**rules, **tree.rules}, {**tree.patterns, "WORDS": _WORDS})


def _literal(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _choices(texts: Iterable[str]) -> tuple[Parts, ...]:
    """One of some texts."""
    return tuple((_literal(text),) for text in texts)


_QUOTE: Final = ('"\\""',)
_STRINGS: Final[dict[str, tuple[Parts, ...]]] = {"text": ((*_QUOTE, "WORDS", *_QUOTE),)}


class _Writer:
    """Collects rules and patterns."""

    def __init__(self, vocabulary: Vocabulary, in_json: bool) -> None:
        self.vocabulary, self.in_json = vocabulary, in_json
        self.rules: dict[str, tuple[Parts, ...]] = {}
        self.patterns: dict[str, str] = {}

    def rule(self, name: str, *choices: Parts) -> str:
        """Adds a rule; returns its name."""
        self.rules[name] = choices
        return name

    def body(self, level: int, low: int, high: int, most: int) -> str:
        """The rule for `low` to `most` nodes of a level."""
        node, name = f"node{level}", f"body{low}to{high}of{level}"
        if high == UNLIMITED:
            name = f"list{level}"
        if most == UNLIMITED:
            return self.rule(name, (node,), (node, "b", name))
        return self.rule(name, *((node, *("b", node) * (n - 1)) for n in range(low, most + 1)))

    def head(self, kind: str) -> Parts:
        """A node before its brace."""
        parts = [_literal(kind)]
        for argument in KINDS[kind].arguments:
            values = self._values(argument)
            if argument.default is None:
                parts += ['" "', values]
            else:
                name = f"{kind}{argument.name}".replace("_", "")
                parts.append(self.rule(name, (), (_literal(f" {argument.name} "), values)))
        return tuple(parts)

    def _values(self, argument: Argument) -> str:
        match argument.sort:
            case Sort.CONDITION:
                return self._condition()
            case Sort.COUNT:
                return self._number("COUNT", *REPEATS, whole=True)
            case Sort.SECONDS:
                return self._number("SECONDS", *SECONDS)
        words = _choices(argument.words)
        if argument.sort is Sort.POLICY:
            words += ((self._number("COUNT", *REPEATS, whole=True),),)
        return self.rule(f"{argument.sort.name.lower()}of{argument.name}", *words)

    def _condition(self) -> str:
        """Rules for conditions; at most MAX_TERMS terms in all, fewer in JSON."""
        keys, n = self.vocabulary.keys, MAX_TERMS_IN_JSON if self.in_json else MAX_CHILDREN_NESTED
        terms = n if self.in_json else MAX_TERMS
        self.rule("atom", *(p for name in keys for p in self._comparisons(name, keys[name])))
        self.rule("term", ("atom",), ('"not "', "atom"))
        self.rule("joint", ('" and "',), ('" or "',))
        few = f"join2of{n}"
        self.rule("part", ("term",), ('"("', few, '")"'), ('"not ("', few, '")"'))
        for name, item, most in (("join", "term", terms), ("mixed", "part", n)):
            for k in range(1, most + 1):
                longer = [(item, "joint", f"{name}{k - 1}")] * (k > 1)
                self.rule(f"{name}{k}", (item,), *longer)
        self.rule(few, ("term", "joint", f"join{n - 1}"))
        return self.rule("condition", (f"join{terms}",), (f"mixed{n}",))

    def _comparisons(self, name: str, key: Key) -> list[Parts]:
        if key.flag:
            return [(_literal(name),)]
        rights = [*map(_literal, (*key.words, *self.vocabulary.comparable(name)))]
        rights += [] if key.words else [self._threshold(name, key)]
        return [(_literal(f"{name} {op} "), right) for op in key.operators for right in rights]

    def _threshold(self, name: str, key: Key) -> str:
        if not self.in_json:
            self.patterns["NUMBER"] = _ANY_NUMBER
            return "NUMBER"
        most = key.high if key.most is None else key.most
        is_whole = key.whole or most - key.low > COARSE
        pattern = f"KEY{self.vocabulary.key_index[name]}"
        return self._number(pattern, key.low, most, whole=is_whole, decimals=2)

    def action(self, name: str, index: int) -> Parts:
        """A leaf, with any of its arguments in their order."""
        rule, items = f"args{index}", [*self.vocabulary.actions[name].arguments.items()]
        if not items:
            return (_literal(name),)
        values = [
            (_literal(f"{key}: "), *self._value(f"{rule}v{i}", each))
            for i, (key, each) in enumerate(items)
        ]
        for first in range(len(items), -1, -1):  # the arguments from `first` on, after another
            later = range(first, len(items))
            nexts = (('", "', *values[i], f"{rule}from{i + 1}") for i in later)
            self.rule(f"{rule}from{first}", (), *nexts)
        begun = ((*values[i], f"{rule}from{i + 1}") for i in range(len(items)))
        self.rule(rule, (), *(('"("', *parts, '")"') for parts in begun))
        return (_literal(name), rule)

    def _value(self, name: str, parameter: Parameter) -> Parts:
        if parameter.words:
            return (self.rule(name, *_choices(parameter.words)),)
        if parameter.sort == "text":
            self.patterns["TEXT"] = "[ !#-\\[\\]-~]{0,60}"
            quote = _literal('\\"' if self.in_json else '"')
            return (quote, "TEXT", quote)
        is_whole = parameter.sort == "integer"
        return (self._number(name.upper(), parameter.low, parameter.high, whole=is_whole),)

    def _number(
        self, name: str, low: float, high: float, *, whole: bool = False, decimals: int = 3
    ) -> str:
        self.patterns[name] = between(low, high, whole=whole, decimals=decimals)
        return name


def between(low: float, high: float, *, whole: bool = False, decimals: int = 3) -> str:
    """A pattern of the numbers from `low` to `high`, without exponents; `whole`: integers.

    `decimals`: most decimals. With three or more it has longer numbers, too, other than those less
    than 0.001 from the ends.
    """
    choices: list[str] = []
    for places in range(1 if whole else decimals + 1):
        first, last = (Decimal(repr(float(end))).scaleb(places) for end in (low, high))
        point = "[.]" if places else ""
        for sign, least, most in (("", first, last), ("[-]", -last, -first)):
            smallest = max(ceil(least), len(sign) and 1, 0)
            ends = [(floor(most), ""), *[(ceil(most) - 1, "[0-9]{1,21}")] * (places >= 3)]
            for largest, tail in ends:
                for digits in _integers(smallest, largest, places + 1):
                    at = len(digits) - places
                    choices.append("".join((sign, *digits[:at], point, *digits[at:], tail)))
    return "|".join(choices)


def _integers(low: int, high: int, length: int) -> Iterator[list[str]]:
    """The integers from `low` to `high` as classes of digits; with zeros in front, of a length."""
    if low > high:
        return
    for digits in range(max(length, len(str(low))), max(length, len(str(high))) + 1):
        least = max(low, 10 ** (digits - 1) if digits > length else 0)
        most = min(high, 10**digits - 1)
        yield from _of_length(str(least).zfill(digits), str(most).zfill(digits))


def _of_length(low: str, high: str) -> list[list[str]]:
    """The digits between two texts of the same length."""
    if not low:
        return [[]]
    if low[0] == high[0]:
        return [[f"[{low[0]}]", *rest] for rest in _of_length(low[1:], high[1:])]
    n = len(low) - 1
    choices = [[f"[{low[0]}]", *rest] for rest in _of_length(low[1:], "9" * n)]
    choices += [[f"[{high[0]}]", *rest] for rest in _of_length("0" * n, high[1:])]
    if int(high[0]) - int(low[0]) > 1:
        choices.append([f"[{int(low[0]) + 1}-{int(high[0]) - 1}]", *["[0-9]"] * n])
    return choices
