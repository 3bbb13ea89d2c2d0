"""Random walks over a grammar: its texts, without any judgement."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from islandgp.bt.export.grammar import Grammar

_LITERAL: Final = re.compile(r'^"(.*)"$', re.DOTALL)
_TOKEN: Final = re.compile(r"\[((?:\\.|[^\]\\])+)\]|[()|?]|\{(\d+),(\d+)\}")


def random_text(grammar: Grammar, rng: np.random.Generator) -> str:
    """A text of a grammar, each alternative of a rule being equally likely."""

    def walk(name: str) -> str:
        if literal := _LITERAL.match(name):
            return literal[1].replace("\\n", "\n").replace('\\"', '"').replace("\\\\", "\\")
        if name in grammar.patterns:
            return _sample(grammar.patterns[name], rng)
        choices = grammar.rules[name]
        return "".join(map(walk, choices[rng.integers(len(choices))]))

    return walk(next(iter(grammar.rules)))


def _sample(pattern: str, rng: np.random.Generator) -> str:
    """A random text of a pattern of a `Grammar`: classes, groups, `|`, `?` and {m,n}."""

    def text_of(choices: list[Any]) -> str:
        parts = choices[rng.integers(len(choices))]
        return "".join(
            item[rng.integers(len(item))] if isinstance(item, str) else text_of(item)
            for item, low, high in parts
            for _ in range(rng.integers(low, min(high, low + 4) + 1))
        )

    return text_of(_parsed(_TOKEN.finditer(pattern)))


def _parsed(tokens: Iterator[re.Match[str]]) -> list[Any]:
    """The alternatives of a pattern: items, each with its fewest and most repetitions."""
    choices: list[list[tuple[Any, int, int]]] = [[]]
    for token in tokens:
        if token[0] == ")":
            break
        if token[0] == "|":
            choices.append([])
        elif token[0][0] in "?{":
            low, high = (0, 1) if token[0] == "?" else (int(token[2]), int(token[3]))
            choices[-1].append((choices[-1].pop()[0], low, high))
        else:
            choices[-1].append((_characters(token[1]) if token[1] else _parsed(tokens), 1, 1))
    return choices


def _characters(body: str) -> str:
    """The characters of a class such as `0-9`."""
    ranges = re.findall(r"(\\?.)(?:-(\\?.))?", body.replace("\\n", "\n"), re.DOTALL)
    return "".join(
        chr(code)
        for first, last in ranges
        for code in range(ord(first[-1]), ord((last or first)[-1]) + 1)
    )
