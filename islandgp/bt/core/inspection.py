"""What commands and editors ask of a text: places, all errors, and the files that it includes."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

from islandgp.bt.core.builder import Builder, SourceSpan
from islandgp.bt.core.includes import MAX_FILES
from islandgp.bt.core.language import built, files_of
from islandgp.bt.core.node import Node
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import TreeError

_INCLUDE: Final = re.compile(r'^\s*include\s*"([^"\n]+)"', re.MULTILINE)

MAX_READ: Final = 100_000  # most characters that `find_includes` reads of a file


class PlacedTree(NamedTuple):
    """The tree that a text means, with the places of its nodes."""

    node: Node
    places: list[SourceSpan]  # of each node, in document order
    file: Any  # lark.Tree of the text


def parse_placed(
    text: str,
    vocabulary: Vocabulary | None = None,
    *,
    name: str = "<tree>",
    folder: Path | None = None,
    named: bool = True,
) -> PlacedTree:
    """The tree of a text with the places of its nodes. Arguments and errors as in `parse`.

    `named`: numbers of constants and parameters are printed by their names.
    """
    parts = files_of(text, vocabulary, name=name, folder=folder, placed=True)
    built(Builder(parts[-1].source, vocabulary), parts)
    builder = Builder(parts[-1].source, vocabulary, named=named)
    return PlacedTree(builder.build(parts), builder.places(), parts[-1].tree)


def tree_errors(
    text: str, vocabulary: Vocabulary | None, *, name: str, folder: Path | None
) -> list[TreeError]:
    """The distinct errors in a text, in its order. Arguments as in `parse`.

    All errors of names and numbers, or else the first syntax error.
    """
    errors: list[TreeError] = []
    try:
        parts = files_of(text, vocabulary, name=name, folder=folder)
        built(Builder(parts[-1].source, vocabulary, errors=errors), parts)
    except TreeError as error:
        errors.append(error)
    return list({str(error): error for error in errors}.values())


def find_includes(text: str, folder: Path) -> dict[Path, str]:
    """The files that a text includes, directly or indirectly, with their texts.

    Does not raise: a file that cannot be read is "", and invalid includes are skipped. For editors,
    which read incomplete files.
    """
    top = folder.resolve()
    texts: dict[Path, str] = {}
    waiting = [(text, top)]
    while waiting:
        source, beside = waiting.pop()
        for name in _INCLUDE.findall(source):
            with suppress(OSError, RuntimeError, ValueError):
                path = (beside / name).resolve()
                if path in texts or not path.is_relative_to(top) or len(texts) == MAX_FILES:
                    continue
                texts[path] = ""
                if path.is_file():  # not a pipe: reading it could block
                    with path.open(encoding="utf-8") as stream:
                        texts[path] = stream.read(MAX_READ)
                waiting.append((texts[path], path.parent))
    return texts
