"""`islandgp check`: errors and warnings for tree files."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any, Final

import click

from islandgp.bt.analysis.lint import LintWarning, warnings
from islandgp.bt.core.language import parse, plain, tree_errors
from islandgp.bt.core.node import Limits, Node, check_limits, depth, size
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.commands.files import FILE, display_name, folder_of, read_text
from islandgp.commands.options import DomainOptions, with_vocabulary_options
from islandgp.commands.rerun import with_rerun_option
from islandgp.commands.setting import vocabulary_of
from islandgp.errors import LimitError, OtherDomainError, TreeError, UnknownNameError

CODES: Final[dict[type[TreeError], str]] = {
    UnknownNameError: "unknown-name",
    LimitError: "limit",
    OtherDomainError: "domain",
}
"""Codes of errors in JSON; all other errors are syntax errors."""


@click.command()
@click.argument("files", nargs=-1, required=True, type=FILE)
@click.option("--strict", is_flag=True, help="Exit code 1 for warnings as well.")
@click.option("--max-depth", type=click.IntRange(1), help="Maximum depth; default: unlimited.")
@click.option("--max-nodes", type=click.IntRange(1), help="Maximum size; default: unlimited.")
@click.option("-q", "--quiet", is_flag=True, help="Do not print files without findings.")
@click.option("--json", "as_json", is_flag=True, help="Print the findings as a JSON list.")
@with_rerun_option
@with_vocabulary_options
def command(
    files: tuple[str, ...],
    strict: bool,
    max_depth: int | None,
    max_nodes: int | None,
    quiet: bool,
    as_json: bool,
    options: DomainOptions,
) -> None:
    """Report errors and warnings for the trees in FILES.

    A `use` counts as its whole subtree. Exit code 1 if a file is not a tree.
    """
    limits = Limits(max_depth or 10**9, max_nodes or 10**9)
    wrong = doubtful = 0
    entries: list[dict[str, Any]] = []
    for file in files:
        text, name, folder = read_text(file), display_name(file), folder_of(file)
        errors: list[TreeError] = []
        try:
            vocabulary = vocabulary_of(text, options, name=name, folder=folder, in_world=True)
            if errors := tree_errors(text, vocabulary, name=name, folder=folder):
                raise errors[0]
            tree, diagnostics = checked(text, vocabulary, name, folder, limits)
        except TreeError as error:
            wrong += 1
            for each in errors or [error]:
                message = str(each)
                if as_json:
                    entries.append(plain_error(each, name))
                else:
                    click.echo(message if message.startswith(f"{name}:") else f"{name}: {message}")
            continue
        doubtful += bool(diagnostics)
        if as_json:
            entries += [plain_finding(finding, text, name) for finding in diagnostics]
            continue
        for finding in diagnostics:
            click.echo(finding.text(text, name=name))
        if not quiet:
            warnings_text = (
                f"{len(diagnostics)} warning{'s' * (len(diagnostics) != 1)}"
                if diagnostics
                else "no warnings"
            )
            nodes = f"{size(tree)} node{'s' * (size(tree) != 1)}"
            click.echo(f"{name}: {nodes}, depth {depth(tree)}, {warnings_text}")
    if as_json:
        click.echo(json.dumps(entries, indent=1))
    sys.exit(1 if wrong or (strict and doubtful) else 0)


def checked(
    text: str, vocabulary: Vocabulary, name: str, folder: Path, limits: Limits
) -> tuple[Node, list[LintWarning]]:
    """The tree of a text and its warnings. Raises TreeError."""
    tree = parse(text, vocabulary, name=name, folder=folder)
    check_limits(tree, limits)
    return tree, warnings(text, vocabulary, name=name, folder=folder)


def plain_error(error: TreeError, name: str) -> dict[str, Any]:
    """An error as JSON values; `file` is the included file if the error is there."""
    first, *rest = str(error).splitlines()
    placed = re.fullmatch(r"(.*?):\d+:\d+: (.*)", first)
    file, message = placed.groups() if placed else (name, first)
    hints = rest[2:] if error.source or placed else rest  # without the line and its caret
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
