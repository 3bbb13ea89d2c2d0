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
        TreeError: a file cannot be read, lies outside of the folder, or is not in the language; the
            message names the place of the include.
        LimitError: there are too many files, or too much is in them.
    """
    parts: list[ParsedFile] = []
    texts: dict[Path, str] = {}  # by the paths of the files that are read
    if folder is not None:
        texts[(folder / Path(main.name).name).resolve()] = main.text

    def visit(source: Source, rule: str, beside: Path | None) -> None:
        tree = grammar(source, rule)
        for token in (part.children[0] for part in tree.children if part.data == "include"):
            name = token.strip('"')
            try:
                path = included_path(name, folder, beside)
                if path in texts:
                    continue
                texts[path] = read_included(path)
            except (OSError, ValueError) as error:
                reason = getattr(error, "strerror", error)
                expected = "a tree file in UTF-8, in the folder of the tree or below"
                raise source.error(token, f"can't read {shown(name)}: {reason}", expected) from None
            if len(texts) > 1 + MAX_FILES or sum(map(len, texts.values())) > MAX_CHARACTERS:
                raise source.error(
                    token,
                    "the included files are too many or too long",
                    f"at most {MAX_FILES} files, and {MAX_CHARACTERS} characters in all",
                    kind=LimitError,
                )
            visit(Source(texts[path], str(Path(source.name).parent / name)), "library", path.parent)
        parts.append(ParsedFile(source, tree))

    visit(main, rule, folder)
    return parts


def included_path(name: str, folder: Path | None, beside: Path | None) -> Path:
    """The path of an included file. Raises OSError or ValueError unless it is in the folder."""
    with suppress(RuntimeError):  # a circle of links
        if folder is not None and beside is not None:
            path = (beside / name).resolve()
            if path.is_relative_to(folder.resolve()):
                return path
    raise FileNotFoundError(0, "it is not in the folder of the tree")


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
    sources = [(text, folder)]
    for source, beside in sources:  # the list grows while it is iterated
        for name in _INCLUDE.findall(source):
            with suppress(OSError, ValueError):
                path = included_path(name, folder, beside)
                if path not in texts and len(texts) < MAX_FILES:
                    texts[path] = ""
                    texts[path] = read_included(path)
                    sources.append((texts[path], path.parent))
    return texts
