"""`islandgp estimate`: what supervision by a language model will cost, before anything is run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from operator import add
from pathlib import Path

import click

from islandgp.supervision.base import RunContext
from islandgp.supervision.llm.estimate import ANSWER, as_recorded, at_most, expected
from islandgp.supervision.llm.ledger import Bill
from islandgp.supervision.llm.settings import LLMSettings
from islandgp.supervision.llm.transcript import Transcript, find_transcript

Job = tuple[LLMSettings, RunContext, int]  # the last is the lag, generations
HEAD = ("", "requests", "input tokens", "output tokens", "US dollars")


@click.command(
    context_settings={"ignore_unknown_options": True, "help_option_names": ["-h", "--help"]}
)
@click.option(
    "--record",
    type=click.Path(exists=True, path_type=Path),
    help="Folder of a run with supervisor=llm: also tell what it takes as measured there.",
)
@click.argument("overrides", nargs=-1, type=click.UNPROCESSED)
def command(overrides: tuple[str, ...], record: Path | None) -> None:
    """Tell what the runs of a command would cost, e.g. supervisor=llm 'seed=range(5)' -m.

    Nothing is sent and no key is needed.
    """
    jobs, free = _jobs(overrides)
    if not jobs:
        click.echo(f"Nothing: none of the {free} runs asks a language model.")
        return
    first = jobs[0][0]
    prices = f"prices of {first.prices.date}"
    models = ", ".join(sorted({settings.model_name for settings, *_ in jobs}))
    characters = " or ".join(
        sorted({f"{settings.facts.characters:g}" for settings, *_ in jobs}, reverse=True)
    )
    click.echo(f"Supervision by {models}, {prices}.\n")
    rows: list[tuple[str, Callable[[LLMSettings, RunContext, int], Bill]]] = [
        (f"expected, {characters} characters a token, {ANSWER} tokens an answer", expected),
        ("at most: failures, repairs and the longest answers", at_most),
    ]
    if record is not None:
        found = Transcript(find_transcript(record))
        rows.insert(
            1,
            ("as measured in the record", lambda s, setup, lag: as_recorded(s, setup, found, lag)),
        )
    for name, bill in rows:
        click.echo(f"{name}:")
        total = reduce(add, (bill(*job) for job in jobs))
        lines = [HEAD, _row("a run" if len(jobs) == 1 else "a run, mean", total, len(jobs))]
        if len(jobs) > 1:
            lines.append(_row(f"all {len(jobs)} runs", total, 1))
        for line in lines:
            click.echo(f"  {line[0]:<14}" + "".join(f"{cell:>16}" for cell in line[1:]))
        click.echo()
    if any(settings.price is None for settings, *_ in jobs):
        click.echo("No price is known for some model; add it to supervisor.policy.prices.models.")
    if free:
        click.echo(f"{free} other runs ask no language model.")


def _row(name: str, bill: Bill, runs: int) -> tuple[str, ...]:
    usd = "unknown" if bill.usd is None else f"{bill.usd / runs:,.2f}"
    counts = (bill.requests, bill.input, bill.output)
    return (name, *(f"{count / runs:,.0f}" for count in counts), usd)


def _jobs(overrides: Sequence[str]) -> tuple[list[Job], int]:
    """The jobs that ask a model, and how many do not."""
    from hydra._internal.utils import get_args_parser

    from islandgp.config.compose import planned
    from islandgp.running.run import run_context

    args = get_args_parser().parse_args(list(overrides))
    jobs, free = [], 0
    for job in planned(args, overrides, Path.cwd()):
        settings = job.settings.supervisor.settings()
        if isinstance(settings, LLMSettings):
            jobs.append((settings, run_context(job.settings), job.settings.supervisor.lag))
        else:
            free += 1
    return jobs, free
