"""`islandgp domain`: shows a domain's declaration, or checks its contract."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING

import click

from islandgp.bt.core.parameters import adapter, described, signature
from islandgp.bt.core.vocabulary import Key
from islandgp.commands.options import DomainOptions, with_domain_options
from islandgp.commands.setting import configured, default_domain
from islandgp.domain import Schema
from islandgp.installed import domain_files

if TYPE_CHECKING:
    from islandgp.config.settings import Settings


@click.command()
@click.argument("name", required=False)
@click.option("--check", is_flag=True, help="Run the contract's tests against the domain.")
@click.option("--json", "as_json", is_flag=True, help="Print the declaration as JSON.")
@with_domain_options
def domain_command(name: str | None, check: bool, as_json: bool, options: DomainOptions) -> None:
    """Show the actions, keys, events and counters of the domain NAME; default: the island.

    With --check: test the domain's contract by running trees. The trees are the .bt files of the
    library and next to the domain's module that name it, each action, random trees, and one that
    tries the actions in random order. Events, actions and keys that no tree reaches are listed.
    Exit code 1 if the domain breaks its contract.
    """
    if check and as_json:
        raise click.UsageError("expected --check or --json, found both")
    named = (f"domain={name}",) if name else ()
    settings = configured((*named, *options.overrides), options.config_dir)
    if check:
        sys.exit(_check(settings, options.timeout))
    schema = settings.make_domain().schema
    if as_json:
        plain = adapter(Schema).dump_python(schema, mode="json", exclude_defaults=True)
        click.echo(json.dumps(plain, indent=1))
        return
    file = domain_files(options.config_dir).get(schema.vocabulary.domain, "")
    click.echo("\n".join(_lines(schema, file)))


def _lines(schema: Schema, file: Path | str) -> Iterator[str]:
    vocabulary = schema.vocabulary
    keys = vocabulary.keys.items()
    yield f"Domain {vocabulary.domain}, configured in {file}"
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


def _check(settings: Settings, timeout: float) -> int:
    """Runs the contract suite; returns the exit code."""
    from islandgp.testing.check import check_domain, known_trees

    trees, left_out = known_trees(settings.make_domain(), settings.library.folder, default_domain())
    for line in left_out:
        click.echo(f"left out: {line}")
    with redirect_stdout(StringIO()) as printed:  # of thousands of episodes
        check = check_domain(settings.make_domain, trees=dict.fromkeys(trees), timeout=timeout)
        lines = [*check.lines()]
    if said := printed.getvalue().strip():
        lines += ["", f"Its code prints while episodes run, e.g. {said.splitlines()[0]!r}"]
    click.echo("\n".join(lines))
    return 1 if check.faults else 0
