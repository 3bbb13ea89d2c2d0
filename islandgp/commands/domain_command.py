"""`islandgp domain`: what a domain declares, and whether it keeps its contract."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import click

from islandgp.bt.node import STATUS_NAMES
from islandgp.commands.setting import Chosen, configured, with_domain_options
from islandgp.domain import Domain, Schema


@click.command()
@click.argument("name", required=False)
@click.option("--check", is_flag=True, help="Run the contract's tests against the domain.")
@click.option("--json", "as_json", is_flag=True, help="Print the declaration as JSON.")
@with_domain_options
def command(name: str | None, check: bool, as_json: bool, chosen: Chosen) -> None:
    """Show the actions, keys, events and counters of the domain NAME; default: the island.

    With --check: exit code 1 when the domain breaks its contract.
    """
    named = (f"domain={name}",) if name else ()
    domain = configured((*named, *chosen.overrides), chosen.config_dir).make_domain()
    if check:
        sys.exit(_check(domain))
    if as_json:
        click.echo(json.dumps(_plain(domain.schema), indent=1))
        return
    for line in _lines(domain.schema):
        click.echo(line)


def _lines(schema: Schema) -> Iterator[str]:
    words = schema.vocabulary
    yield f"Domain {words.domain}"
    yield schema.task
    for heading, entries in (
        ("Actions", {name: action.meaning for name, action in words.actions.items()}),
        ("Keys that are yes or no", {n: k.meaning for n, k in words.keys.items() if k.flag}),
        ("Keys that are numbers", {n: k.meaning for n, k in words.keys.items() if not k.flag}),
        ("Events", {name: event.meaning for name, event in schema.events.items()}),
        ("Counters", {name: counter.meaning for name, counter in schema.counters.items()}),
        ("Components of the fitness", schema.components),
    ):
        if entries:
            width = max(map(len, entries))
            yield f"\n{heading}"
            yield from (f"  {name:<{width}}  {meaning}" for name, meaning in entries.items())


def _plain(schema: Schema) -> dict[str, Any]:
    """The schema as JSON values; statuses by name."""
    found = asdict(schema)
    for action in found["vocabulary"]["actions"].values():
        action["statuses"] = [STATUS_NAMES[status] for status in sorted(action["statuses"])]
    return found


def _check(domain: Domain) -> int:
    """Runs the contract suite; returns the exit code."""
    from islandgp.testing.domain_suite import DomainSuite, run_suite

    class Suite(DomainSuite):
        def make_domain(self) -> Domain:
            return domain

    faults = 0
    for promise, fault in run_suite(Suite()):
        click.echo(f"{'FAILED' if fault else 'ok':<6}  {promise}")
        if fault:
            faults += 1
            click.echo(f"        {fault.splitlines()[0]}")
    return 1 if faults else 0
