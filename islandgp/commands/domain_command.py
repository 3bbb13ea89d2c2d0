"""`islandgp domain`: shows a domain's declaration, or checks its contract."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import redirect_stdout
from inspect import getfile
from io import StringIO
from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING, Final

import click

from islandgp.bt.core.language import domain_of, parse
from islandgp.bt.core.node import Node
from islandgp.bt.core.parameters import adapter, described, signature
from islandgp.bt.core.vocabulary import Key
from islandgp.commands.files import FILE, STDIN, read_tree_text
from islandgp.commands.options import DomainOptions, with_domain_options, with_timeout_option
from islandgp.commands.setting import configured, default_domain, domain_file, settings_of
from islandgp.domain import Domain, Schema
from islandgp.errors import IslandError
from islandgp.plugin import short_repr
from islandgp.resources import resource

if TYPE_CHECKING:
    from islandgp.config.settings import Settings


MAX_PATTERNS: Final = 100
"""Patterns of tree files next to a domain's module."""


@click.command()
@click.argument("arguments", nargs=-1, metavar="[NAME] [TREE.bt]...")
@click.option("--check", is_flag=True, help="Run the contract's tests against the domain.")
@click.option(
    "--strict", is_flag=True, help="With --check: exit code 1 if anything was not reached."
)
@click.option("--json", "as_json", is_flag=True, help="Print the declaration as JSON.")
@click.option("--yaml", "as_yaml", is_flag=True, help="Print the domain's configuration file.")
@with_domain_options
@with_timeout_option
def command(
    arguments: tuple[str, ...],
    check: bool,
    strict: bool,
    as_json: bool,
    as_yaml: bool,
    options: DomainOptions,
    timeout: float,
) -> None:
    """Show the actions, keys, events and counters of the domain NAME; default: the island.

    With --check: test the domain's contract by running trees. The trees are those of the library,
    the .bt files next to the domain's module that name it, the given FILES, each action,
    random trees and growing sequences of actions. Events, actions and keys that no tree reaches
    are listed. Exit code 1 if the domain breaks its contract.
    """
    name, files = _parted(arguments)
    if files and not check:
        raise click.UsageError(f"expected --check with tree files, found {files[0]} without it")
    if strict and not check:
        raise click.UsageError("expected --check with --strict, found --strict alone")
    if sum((check, as_json, as_yaml)) > 1:
        raise click.UsageError("expected one of --check, --json and --yaml, found more")
    if as_yaml:
        click.echo(domain_file(name, options).read_text(encoding="utf-8"), nl=False)
        return
    settings = _settings(name, files, options)
    domain = settings.make_domain()
    if check:
        sys.exit(_check(settings, domain, files, strict=strict, timeout=timeout))
    if as_json:
        plain = adapter(Schema).dump_python(domain.schema, mode="json", exclude_defaults=True)
        click.echo(json.dumps(plain, indent=1))
        return
    click.echo("\n".join(_lines(domain.schema)))


def _parted(arguments: Sequence[str]) -> tuple[str, list[str]]:
    """The name of the domain, or "", and the tree files."""
    first = arguments[0] if arguments else ""
    named = bool(first) and not first.endswith(".bt") and first != STDIN
    context = click.get_current_context()
    parameter = next(each for each in context.command.params if each.name == "arguments")
    files = [str(FILE.convert(word, parameter, context)) for word in arguments[named:]]
    return first if named else "", files


def _settings(name: str, files: Sequence[str], options: DomainOptions) -> Settings:
    """The settings of the named domain, or of the one that the first file is for."""
    if name or not files:
        named = (f"domain={name}",) if name else ()
        return configured((*named, *options.overrides), options.config_dir)
    return settings_of(read_tree_text(files[0]), options)


class _Printed(StringIO):
    """A standard output for the domain's code that stores the first line printed."""

    first = ""

    def write(self, text: str) -> int:
        """See `io.TextIOBase`."""
        self.first = self.first or text.strip()
        return len(text)


def _lines(schema: Schema) -> Iterator[str]:
    vocabulary = schema.vocabulary
    keys = vocabulary.keys.items()
    yield f"Domain {vocabulary.domain}"
    yield schema.task
    sections = {
        "Actions": {
            signature(name, action.arguments): described(
                action.meaning, action.arguments, action.uses
            )
            for name, action in vocabulary.actions.items()
        },
        "Keys that are yes or no": {n: k.meaning for n, k in keys if k.flag},
        "Keys that are numbers": {
            f"{n}, {_range(k)}": k.meaning for n, k in keys if not k.flag and not k.words
        },
        "Keys that are words": {
            n: f"{k.meaning}: {' | '.join(k.words)}" for n, k in keys if k.words
        },
        "Events": {name: event.meaning for name, event in schema.events.items()},
        "Counters": {name: counter.meaning for name, counter in schema.counters.items()},
        "Components of the fitness": schema.components,
    }
    for heading, entries in sections.items():
        if entries:
            width = max(map(len, entries))
            yield f"\n{heading}"
            yield from (f"  {name:<{width}}  {meaning}" for name, meaning in entries.items())


def _range(key: Key) -> str:
    """The values of a key that is a number, as text."""
    most = "" if key.most is None else f" to {key.most:g}"
    return f"{'whole, ' if key.whole else ''}{key.low:g}{most or ' or more'}"


def _check(
    settings: Settings, domain: Domain, files: Sequence[str], *, strict: bool, timeout: float
) -> int:
    """Runs the contract suite; returns the exit code."""
    from islandgp.testing.check import PROMISES, check_domain

    trees = [read_tree_text(file).tree(domain.schema.vocabulary) for file in files]
    known, left_out = known_trees(settings, domain)
    for line in left_out:
        click.echo(f"left out: {line}")
    own, printed = dict.fromkeys((*trees, *known)), _Printed()
    with redirect_stdout(printed):
        check = check_domain(settings.make_domain, trees=own, timeout=timeout)
    for promise in PROMISES if check.trees_run else check.faults:
        fault = check.faults.get(promise, "")
        click.echo(f"{'FAILED' if fault else 'ok':<6}  {promise}")
        if fault:
            click.echo(indent(fault, " " * 8))
    if printed.first:
        click.echo(f"\nIts code prints while episodes run, e.g. {short_repr(printed.first)}")
    if not check.trees_run:
        click.echo("The other promises are checked as soon as the episode of a tree runs.")
        return 1
    if unreached := check.unreached():
        click.echo(
            f"\nNot reached by any of {check.trees_run} trees (no failure without --strict):"
        )
        for line in unreached:
            click.echo(f"  {line}")
        click.echo("A tree that reaches them can be added: islandgp domain NAME --check TREE.bt")
    if shared := check.shared():
        click.echo(
            "\nActions that seem to share a resource; declare it as their `uses` if they do:"
        )
        for line in shared:
            click.echo(f"  {line}")
    return 1 if check.faults or (strict and unreached) else 0


def known_trees(settings: Settings, domain: Domain) -> tuple[list[Node], list[str]]:
    """The trees of a domain's library, and those of .bt files that are for it.

    Returns:
        The trees, and a line for each file or library that cannot be read.
    """
    trees: dict[Node, None] = {}
    left_out: dict[str, None] = {}
    vocabulary = domain.schema.vocabulary
    for file in (None, *_files(domain)):
        try:
            if file is None:
                trees |= dict.fromkeys(_library(settings, domain))
                continue
            source = read_tree_text(str(file))
            if (domain_of(source.text) or default_domain()) == vocabulary.domain:
                trees[source.tree(vocabulary)] = None
        except IslandError as error:
            left_out[str(error).splitlines()[0]] = None
    return list(trees), list(left_out)


def _library(settings: Settings, domain: Domain) -> Iterator[Node]:
    """The trees of the library's folder, or the stored ones of an earlier search."""
    from islandgp.running.automatic_library import kept_library, library_file
    from islandgp.running.parts import make_library

    if settings.library.folder is not None:
        yield from make_library(settings, domain).trees.values()
    elif (file := library_file(settings, domain)).exists():
        for name, text in kept_library(file).trees.items():
            yield parse(text, domain.schema.vocabulary, name=f"{file}: {name}")


def _files(domain: Domain) -> list[Path]:
    """Tree files next to the domain's module, in its folder `trees`, and in the examples."""
    beside = Path(getfile(type(domain))).parent
    folders = (beside, beside / "trees", resource("grammar") / "examples")
    return [file for folder in folders for file in sorted(folder.glob("*.bt"))][:MAX_PATTERNS]
