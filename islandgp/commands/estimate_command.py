"""`islandgp estimate`: estimates the costs of supervision by a language model before a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from math import isnan
from operator import add
from pathlib import Path

import click

from islandgp.supervision.llm.budget import Bill
from islandgp.supervision.llm.estimate import (
    ANSWER,
    SupervisedRuns,
    at_most,
    expected,
    most_thoughts,
)

HEAD = ("", "requests", "input tokens", "output tokens", "US dollars")


@click.command(
    context_settings={"ignore_unknown_options": True, "help_option_names": ["-h", "--help"]}
)
@click.argument("overrides", nargs=-1, type=click.UNPROCESSED)
def command(overrides: tuple[str, ...]) -> None:
    """Estimate the costs of a command's runs, e.g. supervisor=llm 'seed=range(5)' -m.

    Nothing is sent and no key is needed.
    """
    jobs, free = _jobs(overrides)
    if not jobs:
        click.echo(f"Nothing: none of the {free} runs asks a language model.")
        return
    every = [job.settings for job in jobs]
    models = ", ".join(sorted({settings.model_name for settings in every}))
    sizes = {f"{settings.facts.characters:g}" for settings in every}
    characters = " or ".join(sorted(sizes, reverse=True))
    thoughts = max(map(most_thoughts, every))
    thought = f" and {thoughts} of thought before it" if thoughts else ""
    text = f"expected, {characters} characters a token, {ANSWER} tokens an answer{thought}"
    estimates: dict[str, Callable[[SupervisedRuns], Bill]] = {
        text: expected,
        "at most: failures, repairs and the longest answers": at_most,
    }
    number = sum(job.number for job in jobs)
    click.echo(f"Supervision by {models}, prices of {every[0].prices.date}.\n")
    for name, estimate in estimates.items():
        click.echo(f"{name}:")
        total = reduce(add, map(estimate, jobs))
        lines = [HEAD, _row("a run" if number == 1 else "a run, mean", total, number)]
        if number > 1:
            lines.append(_row(f"all {number} runs", total, 1))
        for line in lines:
            click.echo(f"  {line[0]:<14}" + "".join(f"{cell:>16}" for cell in line[1:]))
        click.echo()
    if any(settings.price is None for settings in every):
        click.echo("No price is known for some model; add it to supervisor.policy.prices.models.")
    if free:
        click.echo(f"{free} other runs ask no language model.")


def _row(name: str, bill: Bill, runs: int) -> tuple[str, ...]:
    usd = "unknown" if isnan(bill.usd) else f"{bill.usd / runs:,.2f}"
    counts = (bill.requests, bill.input, bill.output)
    return (name, *(f"{count / runs:,.0f}" for count in counts), usd)


def _jobs(overrides: Sequence[str]) -> tuple[list[SupervisedRuns], int]:
    """The runs that ask a model, and the number of those that do not."""
    from islandgp.config.compose import planned
    from islandgp.running.app import parsed_argv
    from islandgp.running.parts import supervised_runs

    args, argv = parsed_argv(overrides)
    settings = [job.settings for job in planned(args, argv, Path.cwd())]
    jobs = supervised_runs(settings)
    return jobs, len(settings) - sum(job.number for job in jobs)
