"""Reads the files that a tree file includes, within its folder and within limits."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

from islandgp.bt.core.source import Source, shown
from islandgp.errors import LimitError

_INCLUDE: Final = re.compile(r'^\s*include\s*"([^"\n]+)"', re.MULTILINE)
MAX_FILES: Final = 50  # most included files, directly or indirectly
MAX_CHARACTERS: Final = 100_000  # most characters of a text with what it includes


class ParsedFile(NamedTuple):
    """The text of a file and its parse tree."""

    source: Source
    tree: Any  # lark.Tree; of its grammar's rule start or library


def load_includes(
    main: Source, folder: Path | None, grammar: Callable[[Source, str], Any], rule: str
) -> list[ParsedFile]:
    """The included files, each before those that include it, and then the main one.

    Args:
        main: the text that includes others.
        folder: of the main file; nothing outside of it is read. None: it has none.
        grammar: (text, start rule) -> lark.Tree; raises TreeError.
        rule: the start rule of the main text.

    Raises:
        TreeError: a file cannot be read, lies outside of the folder, includes itself, or is not
            in the language; the message names the place of the include.
        LimitError: there are too many files, or too much is in them.
    """
    parts: list[ParsedFile] = []
    texts: dict[Path, str] = {}

    def visit(source: Source, rule: str, beside: Path | None, above: tuple[Path, ...]) -> None:
        tree = grammar(source, rule)
        for part in tree.children:
            if part.data != "include":
                continue
            token, name = part.children[0], str(part.children[0])[1:-1]
            if folder is None or beside is None:
                message = "only a text in a file can include files"
                raise source.error(token, message, "a text without include")
            path = included_path(name, folder, beside)
            if path is None or path in above:
                raise source.error(
                    token,
                    f"{shown(name)} is not another file in the folder of the tree",
                    'a relative name with /, such as "lib/recharge.bt", and no circle of includes',
                )
            if path in texts:
                continue
            try:
                texts[path] = read_included(path)
            except (OSError, UnicodeDecodeError) as error:
                reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
                raise source.error(
                    token, f"can't read {shown(name)}: {reason}", "a tree file"
                ) from None
            size = len(main.text) + sum(map(len, texts.values()))
            if len(texts) > MAX_FILES or size > MAX_CHARACTERS:
                raise source.error(
                    token,
                    "the included files are too many or too long",
                    f"at most {MAX_FILES} files, and {MAX_CHARACTERS} characters in all",
                    kind=LimitError,
                )
            shown_name = str(folder / path.relative_to(folder.resolve()))
            visit(Source(texts[path], shown_name), "library", path.parent, (*above, path))
        parts.append(ParsedFile(source, tree))

    visit(main, rule, folder, ())
    return parts


def included_path(name: str, folder: Path, beside: Path) -> Path | None:
    """The path of an included file; None if it is not in the folder or below."""
    if not name or "\\" in name or Path(name).is_absolute():
        return None
    with suppress(OSError, RuntimeError, ValueError):
        path = (beside / name).resolve()
        if path.is_relative_to(folder.resolve()):
            return path
    return None


def read_included(path: Path) -> str:
    """The text of a file, or more than MAX_CHARACTERS of it. Raises OSError, UnicodeDecodeError."""
    if not path.is_file():  # reading a pipe could block
        raise FileNotFoundError(0, "there is no such file")
    with path.open(encoding="utf-8-sig") as file:
        return file.read(MAX_CHARACTERS + 1)


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
