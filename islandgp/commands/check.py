"""`islandgp check`: errors and warnings for tree files."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final, NamedTuple

import click

from islandgp.bt.analysis.lint import REFUSED, LintWarning, warnings
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
    files: tuple[str, ...],
    strict: bool,
    as_json: bool,
    options: DomainOptions,
) -> None:
    """Report errors and warnings for the trees in FILES.

    A `use` counts as its whole subtree. Exit code 1 if a file is not a valid tree, or with
    --strict has warnings; 2 if a file cannot be read.
    """
    vocabulary_for = partial(vocabulary_of, options=options, in_world=True)
    files_with_errors = files_with_warnings = 0
    entries: list[dict[str, Any]] = []
    for file in files:
        text, name, _ = source = read_tree_text(file)
        tree, errors, diagnostics = findings(source, vocabulary_for)
        files_with_errors += bool(errors)
        files_with_warnings += bool(diagnostics)
        if as_json:
            entries += [plain_error(error, name) for error in errors]
            entries += [plain_finding(finding, text, name) for finding in diagnostics]
            continue
        for error in errors:
            message = str(error)
            click.echo(message if message.startswith(f"{name}:") else f"{name}: {message}")
        for finding in diagnostics:
            click.echo(finding.text(text, name=name))
        if tree is not None:
            click.echo(f"{name}: {_summary(tree, diagnostics)}")
    if as_json:
        click.echo(json.dumps(entries, indent=1))
    sys.exit(1 if files_with_errors or (strict and files_with_warnings) else 0)


class Findings(NamedTuple):
    """The tree of a text with its warnings, or its errors."""

    tree: Node | None  # None: the text has errors
    errors: Sequence[TreeError] = ()
    warnings: Sequence[LintWarning] = ()


def findings(source: TreeText, vocabulary_for: Callable[[TreeText], Vocabulary]) -> Findings:
    """The errors of a text; if there are none, its tree and its warnings.

    Raises:
        IslandError: raised by `vocabulary_for`, other than a TreeError.
    """
    text, name, folder = source
    try:
        vocabulary = vocabulary_for(source)
        if errors := tree_errors(text, vocabulary, name=name, folder=folder):
            return Findings(None, errors)
        tree = source.tree(vocabulary)
        found = warnings(text, vocabulary, name=name, folder=folder)
        if refused := [each for each in found if each.code in REFUSED]:
            file = Source(plain(text), name)
            places = [((each.line, each.column), each.message) for each in refused]
            return Findings(None, [file.error(*at, kind=SharedResourceError) for at in places])
        return Findings(tree, (), found)
    except TreeError as error:
        return Findings(None, [error])


def _summary(tree: Node, diagnostics: Sequence[LintWarning]) -> str:
    """The size of a tree and the number of its warnings, in words."""
    nodes = f"{size(tree)} node{'s' * (size(tree) != 1)}"
    count = f"{len(diagnostics) or 'no'} warning{'s' * (len(diagnostics) != 1)}"
    return f"{nodes}, depth {depth(tree)}, {count}"


def plain_error(error: TreeError, name: str) -> dict[str, Any]:
    """An error as JSON values; `file` is the included file if the error is there."""
    first, *rest = str(error).splitlines()
    placed = re.fullmatch(r"(.*?):\d+:\d+: (.*)", first)
    file, message = placed.groups() if placed else (name, first)
    # An error with a place shows the line and a caret, which JSON leaves out.
    hints = rest[2:] if error.source or placed else rest
    code = next((code for kind, code in CODES.items() if isinstance(error, kind)), "syntax")
    place = _plain_place(error.line, error.column, error.source)
    return {
        "file": file,
        **place,
        "severity": "error",
        "code": code,
        "message": " ".join([f"{message}.", *hints] if hints else [message]),
    }


def plain_finding(finding: LintWarning, text: str, name: str) -> dict[str, Any]:
    """A warning as JSON values."""
    line = plain(text).split("\n")[finding.line - 1]
    place = _plain_place(finding.line, finding.column, line)
    about = {"severity": "warning", "code": finding.code, "message": finding.message}
    return {"file": name, **place, **about}


def _plain_place(line: int, column: int, source: str) -> dict[str, int]:
    """A place in a line; `end` is the column after the word there."""
    word = re.match(r"\w+|.?", source[column - 1 :])
    return {"line": line, "column": column, "end": column + (word.end() if word else 0)}
