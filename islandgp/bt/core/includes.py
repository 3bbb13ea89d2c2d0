"""Reads the files that a tree file includes, within its folder and within limits."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, NamedTuple

from islandgp.bt.core.source import Source, plain, shown
from islandgp.errors import LimitError

MAX_FILES: Final = 50  # most included files, directly or indirectly


class ParsedFile(NamedTuple):
    """The text of a file and its parse tree."""

    source: Source
    tree: Any  # lark.Tree; of its grammar's rule start or library


def load_includes(
    main: Source,
    folder: Path | None,
    grammar: Callable[[Source, str], Any],
    max_bytes: int,
    *,
    start: str = "start",
) -> list[ParsedFile]:
    """The included files, each before those that include it, and then the main one.

    Args:
        main: the text that includes others.
        folder: of the main file; nothing outside of it is read. None: it has none.
        grammar: (text, start rule) -> lark.Tree; raises TreeError.
        max_bytes: characters of all files together.
        start: the rule of the main text.

    Raises:
        TreeError: a file cannot be read, lies outside of the folder, includes itself, or is not
            in the language; the message names the place of the include.
        LimitError: there are too many files, or too much is in them.
    """
    parts: list[ParsedFile] = []
    done: set[Path] = set()
    remaining_chars = max_bytes - len(main.text)

    def visit(source: Source, rule: str, beside: Path | None, above: tuple[Path, ...]) -> None:
        nonlocal remaining_chars
        tree = grammar(source, rule)
        for part in tree.children:
            if getattr(part, "data", "") != "include":
                continue
            token = part.children[0]
            path = _included_path(source, token, folder, beside)
            if path in above:
                raise source.error_at(
                    token,
                    f"{shown(token[1:-1])} includes itself",
                    expected="files that do not include each other in a circle",
                )
            if path in done:
                continue
            if len(done) >= MAX_FILES:
                raise source.error_at(
                    token,
                    "too many files are included",
                    expected=f"at most {MAX_FILES}",
                    kind=LimitError,
                )
            text = _text(source, token, path, remaining_chars)
            remaining_chars -= len(text)
            done.add(path)
            visit(Source(text, _shown_name(path, folder)), "library", path.parent, (*above, path))
        parts.append(ParsedFile(source, tree))

    visit(main, start, folder, ())
    return parts


def _included_path(source: Source, token: Any, folder: Path | None, beside: Path | None) -> Path:
    filename = str(token)[1:-1]
    if folder is None or beside is None:
        raise source.error_at(
            token, "only a text in a file can include files", expected="a text without include"
        )
    if not filename or "\\" in filename or "\0" in filename or Path(filename).is_absolute():
        raise source.error_at(
            token,
            f"{shown(filename)} is not the name of a file beside this one",
            expected='a relative name with /, such as "lib/recharge.bt"',
        )
    try:
        top, path = folder.resolve(), (beside / filename).resolve()
    except (OSError, RuntimeError, ValueError):
        raise source.error_at(token, f"there is no file {shown(filename)}") from None
    if not path.is_relative_to(top):
        raise source.error_at(
            token,
            f"{shown(filename)} leads out of the folder of the tree",
            expected="a file in that folder or below it",
        )
    return path


def _text(source: Source, token: Any, path: Path, max_bytes: int) -> str:
    filename = str(token)[1:-1]
    if not path.is_file():
        raise source.error_at(token, f"there is no file {shown(filename)}", expected="a tree file")
    try:
        with path.open("rb") as file:
            data = file.read(4 * max_bytes + 4)
        text = data.decode("utf-8")
    except UnicodeDecodeError:
        if len(data) > 4 * max_bytes:
            text = " " * (max_bytes + 1)
        else:
            raise source.error_at(token, f"{shown(filename)} is not UTF-8 text") from None
    except OSError as error:
        raise source.error_at(token, f"{shown(filename)}: {error.strerror}") from None
    if len(text) > max_bytes:
        raise source.error_at(
            token,
            "the included files are too long",
            expected="fewer characters; all files together count as one",
            kind=LimitError,
        )
    return plain(text)


def _shown_name(path: Path, folder: Path | None) -> str:
    """The name of a file in messages."""
    assert folder is not None
    return str(folder / path.relative_to(folder.resolve()))
