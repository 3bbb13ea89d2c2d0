"""`islandgp estimate`: estimates the costs of supervision by a language model before a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from functools import reduce
from math import isnan
from operator import add
from pathlib import Path
from typing import Final

import click

from islandgp.scoring.generation_stats import GenerationStats
from islandgp.scoring.state import PopulationState, StateSettings, population_state
from islandgp.supervision.base import RunContext
from islandgp.supervision.llm.budget import Bill, most_tokens
from islandgp.supervision.llm.message import MAX_QUOTED, Request, ServerCapabilities, Usage
from islandgp.supervision.llm.questions import NEAR, Questions
from islandgp.supervision.llm.settings import LLMSettings
from islandgp.supervision.llm.transcript import Transcript, find_transcript

Job = tuple[LLMSettings, RunContext, int]  # (settings, context, lag in generations)
HEAD = ("", "requests", "input tokens", "output tokens", "US dollars")
ANSWER: Final = 300  # assumed tokens of an answer: a paragraph, or a tree of 20 nodes
THOUGHTS: Final = 1_500  # assumed tokens of thinking before an answer
INFORMED_CHARACTERS: Final = {"rate": 4_300, "tree": 7_200}
"""Characters that the history adds to an informed prompt, by measurement."""
ADDED_EDITS: Final = 6_000  # approximate characters of trees and traces in the edits question
PROBES: Final = 4  # most calls of the probe
ADDED_MOST: Final = 30_000  # most further characters of informed prompts


@click.command(
    context_settings={"ignore_unknown_options": True, "help_option_names": ["-h", "--help"]}
)
@click.option(
    "--record",
    type=click.Path(exists=True, path_type=Path),
    help="Folder of a run with supervisor=llm: add an estimate from its measured costs.",
)
@click.argument("overrides", nargs=-1, type=click.UNPROCESSED)
def command(overrides: tuple[str, ...], record: Path | None) -> None:
    """Estimate the costs of a command's runs, e.g. supervisor=llm 'seed=range(5)' -m.

    Nothing is sent and no key is needed.
    """
    jobs, free = _jobs(overrides)
    if not jobs:
        click.echo(f"Nothing: none of the {free} runs asks a language model.")
        return
    prices = f"prices of {jobs[0][0].prices.date}"
    models = ", ".join(sorted({settings.model_name for settings, *_ in jobs}))
    sizes = {f"{settings.facts.characters:g}" for settings, *_ in jobs}
    characters = " or ".join(sorted(sizes, reverse=True))
    thoughts = max(_thoughts(settings) for settings, *_ in jobs)
    thought = f" and {thoughts} of thought before it" if thoughts else ""
    text = f"expected, {characters} characters a token, {ANSWER} tokens an answer{thought}"
    bills = {text: [expected(*job) for job in jobs]}
    if record is not None:
        transcript = Transcript(find_transcript(record))
        bills["as measured in the record"] = [as_recorded(*job, transcript) for job in jobs]
    bills["at most: failures, repairs and the longest answers"] = [at_most(*job) for job in jobs]
    click.echo(f"Supervision by {models}, {prices}.\n")
    for name, each in bills.items():
        click.echo(f"{name}:")
        total = reduce(add, each)
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
    usd = "unknown" if isnan(bill.usd) else f"{bill.usd / runs:,.2f}"
    counts = (bill.requests, bill.input, bill.output)
    return (name, *(f"{count / runs:,.0f}" for count in counts), usd)


def _jobs(overrides: Sequence[str]) -> tuple[list[Job], int]:
    """The jobs that ask a model, and the number of those that do not."""
    from islandgp.config.compose import planned
    from islandgp.running.app import parsed_argv
    from islandgp.running.parts import run_context

    args, argv = parsed_argv(overrides)
    jobs, free = [], 0
    for job in planned(args, argv, Path.cwd()):
        settings = job.settings.supervisor.settings()
        if isinstance(settings, LLMSettings):
            jobs.append((settings, run_context(job.settings), job.settings.supervisor.lag))
        else:
            free += 1
    return jobs, free


def expected(settings: LLMSettings, context: RunContext, lag: int = 0) -> Bill:
    """The expected bill: each question has one answer of ANSWER tokens.

    A model that thinks uses THOUGHTS further tokens. With `cache=true`, a cacheable system prompt
    is written to the cache once and then read.
    """
    requests, times = _requests(settings, context), _times(context, lag)
    shortest = settings.facts.caches_from if settings.cache else None
    fresh = cache_writes = cache_reads = 0.0
    for request, added in requests:
        system, *turns = (
            len(text) / settings.facts.characters for text in (request.system, *request.turns)
        )
        fresh += times * (sum(turns) + added / settings.facts.characters)
        if shortest is not None and system >= NEAR * shortest:
            cache_writes += min(1, times) * system
            cache_reads += max(0, times - 1) * system
        else:
            fresh += times * system
    output = times * len(requests) * (ANSWER + _thoughts(settings))
    usage = Usage(round(fresh), output, round(cache_reads), round(cache_writes))
    return Bill.of(times * len(requests) + 1, usage, settings.price)  # and the probe


def _thoughts(settings: LLMSettings) -> int:
    """Expected thinking tokens before an answer; 0 for a model that does not think."""
    return min(THOUGHTS, settings.reply_tokens - settings.max_tokens)


def at_most(settings: LLMSettings, context: RunContext, lag: int = 0) -> Bill:
    """The upper bound of the bill: all attempts fail late, with repairs and the longest answers.

    Caps limit it.
    """
    exchanges = _requests(settings, context)
    times = _times(context, lag) * settings.retry.attempts
    turns = 1 + settings.repairs
    most = [
        most_tokens(request, longer=MAX_QUOTED * settings.repairs + (ADDED_MOST if added else 0))
        for request, added in exchanges
    ]
    usage = Usage(
        times * turns * sum(m.input for m in most), times * turns * sum(m.output for m in most)
    )
    n = times * turns * len(exchanges) + PROBES * settings.retry.attempts
    bill = Bill.of(n, usage, settings.price)
    requests, tokens, output, usd = (
        cost if cap is None else min(cost, cap)
        for cost, cap in bill.against(settings.caps).values()
    )
    return Bill(requests, tokens, output, bill.usd if isnan(bill.usd) else usd)


def as_recorded(settings: LLMSettings, context: RunContext, lag: int, record: Transcript) -> Bill:
    """The bill with the mean costs of a generation in a recorded run."""
    attempts = record.attempts
    generations = len({a.call.generation for a in attempts if a.call.generation >= 0}) or 1
    share = _times(context, lag) / generations
    usages = [a.usage for a in attempts if a.usage is not None]
    requests = len(attempts) * share
    share *= len(attempts) / (len(usages) or 1)  # those without a count took as much
    sums = {f.name: round(sum(getattr(u, f.name) for u in usages) * share) for f in fields(Usage)}
    return Bill.of(requests, Usage(**sums), settings.price)


def _times(context: RunContext, lag: int) -> int:
    """Number of generations with questions; answers after the last generation have no use."""
    return max(0, context.generations - 1 - lag)


def _requests(settings: LLMSettings, context: RunContext) -> list[tuple[Request, int]]:
    """The questions of a generation, for a state with numbers of typical length.

    Each has the number of characters that the history of the run adds to its prompt.
    """
    questions = Questions(settings, context)
    capabilities = ServerCapabilities(True, settings.temperature, "")
    requests = questions.requests(_state(context), capabilities)
    added = dict.fromkeys(requests, ADDED_EDITS)
    added |= (
        INFORMED_CHARACTERS if questions.uses_history else dict.fromkeys(INFORMED_CHARACTERS, 0)
    )
    return [(request, added[part]) for part, request in requests.items()]


def _state(context: RunContext) -> PopulationState:
    """A state in the middle of a run."""
    classes = context.classes
    now = GenerationStats(
        generation=20,
        epoch=4,
        stage=1,
        best=23456.0,
        mean=12345.0,
        sd=1234.0,
        diversity=0.567,
        overlapping=0.654,
        working=0.867,
        specialists=dict.fromkeys(classes.specialist_names, 11),
        behaviour_counts=dict.fromkeys(classes.behaviours, 14),
        tiers=dict.fromkeys(classes.tiers, 4),
        counters=dict.fromkeys(context.schema.counters, 123.4),
        size=23.4,
        rate=0.234,
    )
    history = [
        replace(now, best=now.best - 1234 * ago, mean=now.mean - 123 * ago)
        for ago in range(4, -1, -1)
    ]
    return population_state(
        history,
        StateSettings(window=5, improvement=0, low_diversity=0),
        context.crisis,
        classes,
        crossover_rate=0.8,
        population=30,
        generations=context.generations,
        generations_per_epoch=5,
        multipliers=dict.fromkeys(context.schema.components, 1.8),
    )
