"""`islandgp check`: errors and warnings for tree files."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import click

from islandgp.bt.analysis.lint import REFUSED, warnings
from islandgp.bt.core.language import tree_errors
from islandgp.bt.core.node import Node, depth, size
from islandgp.bt.core.source import Source, plain
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.commands.files import FILE, TreeText, read_tree_text
from islandgp.commands.options import DomainOptions, with_vocabulary_options
from islandgp.commands.setting import vocabulary_of
from islandgp.errors import (
    LimitError,
    OtherDomainError,
    SharedResourceError,
    TreeError,
    UnknownNameError,
)

CODES: Final[dict[type[TreeError], str]] = {
    UnknownNameError: "unknown-name",
    LimitError: "limit",
    SharedResourceError: "shared-resource",
    OtherDomainError: "domain",
}
"""Codes of errors in JSON; all other errors are syntax errors."""


@click.command()
@click.argument("files", nargs=-1, required=True, type=FILE)
@click.option("--strict", is_flag=True, help="Exit code 1 for warnings as well.")
@click.option("--json", "as_json", is_flag=True, help="Print the findings as a JSON list.")
@with_vocabulary_options
def check_command(
    files: tuple[str, ...], strict: bool, as_json: bool, options: DomainOptions
) -> None:
    """Report errors and warnings for the trees in FILES.

    A `use` counts as its whole subtree. Exit code 1 if a file is not a valid tree, or with
    --strict has warnings; 2 if a file cannot be read.
    """
    vocabulary_for = partial(vocabulary_of, options=options, in_world=True)
    everything: list[Finding] = []
    for file in files:
        source = read_tree_text(file)
        tree, found = findings(source, vocabulary_for)
        everything += found
        if as_json:
            continue
        for each in found:
            message = str(each.error)
            is_placed = message.startswith(f"{source.name}:")
            click.echo(message if is_placed else f"{source.name}: {message}")
        if tree is not None:
            click.echo(f"{source.name}: {_summary(tree, len(found))}")
    if as_json:
        click.echo(json.dumps([each.plain() for each in everything], indent=1))
    sys.exit(1 if any(strict or each.severity == "error" for each in everything) else 0)


@dataclass(frozen=True, slots=True)
class Finding:
    """An error in a tree file, or a warning about it."""

    file: str
    error: TreeError
    code: str
    severity: str = "error"  # or warning

    def plain(self) -> dict[str, Any]:
        """The finding as JSON values; `file` is the included file if the error is there."""
        error = self.error
        first, *rest = str(error).splitlines()
        placed = re.fullmatch(r"(.*?):\d+:\d+: (?:warning: )?(.*)", first)
        file, message = placed.groups() if placed else (self.file, first)
        # An error with a place shows the line and a caret, which JSON leaves out.
        hints = rest[2:] if error.source or placed else rest
        word = re.match(r"\w+|.?", error.source[error.column - 1 :])
        return {
            "file": file,
            "line": error.line,
            "column": error.column,
            "end": error.column + (word.end() if word else 0),  # the column after the word
            "severity": self.severity,
            "code": self.code,
            "message": " ".join([f"{message}.", *hints] if hints else [message]),
        }


def findings(
    source: TreeText, vocabulary_for: Callable[[TreeText], Vocabulary]
) -> tuple[Node | None, list[Finding]]:
    """The tree of a text with its warnings; None with its errors.

    Raises:
        IslandError: raised by `vocabulary_for`, other than a TreeError.
    """
    text, name, folder = source
    try:
        vocabulary = vocabulary_for(source)
        if errors := tree_errors(text, vocabulary, name=name, folder=folder):
            return None, [Finding(name, error, _code(error)) for error in errors]
        tree, found = source.tree(vocabulary), warnings(text, vocabulary, name=name, folder=folder)
    except TreeError as error:
        return None, [Finding(name, error, _code(error))]
    file = Source(plain(text), name)
    at = [(each, (each.line, each.column)) for each in found]
    if errors := [file.error(place, w.message) for w, place in at if w.code in REFUSED]:
        return None, [Finding(name, error, "shared-resource") for error in errors]
    return tree, [
        Finding(name, file.error(place, f"warning: {w.message}"), w.code, "warning")
        for w, place in at
    ]


def _code(error: TreeError) -> str:
    return next((code for kind, code in CODES.items() if isinstance(error, kind)), "syntax")


def _summary(tree: Node, warned: int) -> str:
    """The size of a tree and the number of its warnings, in words."""
    nodes = f"{size(tree)} node{'s' * (size(tree) != 1)}"
    return f"{nodes}, depth {depth(tree)}, {warned or 'no'} warning{'s' * (warned != 1)}"
