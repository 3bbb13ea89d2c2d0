"""What is known of incomplete texts, for messages and editors."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final

from islandgp.bt.core.includes import MAX_FILES, included_path, read_included
from islandgp.bt.core.language import parser_of
from islandgp.bt.core.source import plain

if TYPE_CHECKING:
    from lark import Token

_INCLUDE: Final = re.compile(r'^\s*include\s*"([^"\n]+)"', re.MULTILINE)


def following(text: str, rule: str = "library") -> frozenset[str]:
    """The terminals of the grammar that can follow a text; none if the text is not valid."""
    from lark.exceptions import UnexpectedInput

    interactive = parser_of().parse_interactive(plain(text), start=rule)
    try:
        interactive.exhaust_lexer()
    except UnexpectedInput:
        return frozenset()
    return frozenset(interactive.accepts())  # type: ignore[no-untyped-call] # lark types it not


def words(text: str, rule: str = "library") -> Iterator[Token]:
    """The words of a text with their places in `plain(text)`. Raises lark's error at a fault."""
    return parser_of().parse_interactive(plain(text), start=rule).iter_parse()


def find_includes(text: str, folder: Path) -> dict[Path, str]:
    """The files that a text includes, directly or indirectly, with their texts.

    Does not raise: a file that cannot be read is "", and invalid includes are skipped. For editors,
    which read incomplete files.
    """
    texts: dict[Path, str] = {}
    waiting = [(text, folder)]
    while waiting:
        source, beside = waiting.pop()
        for name in _INCLUDE.findall(source):
            path = included_path(name, folder, beside)
            if path is None or path in texts or len(texts) == MAX_FILES:
                continue
            texts[path] = ""
            with suppress(OSError, ValueError):
                texts[path] = read_included(path)
            waiting.append((texts[path], path.parent))
    return texts
