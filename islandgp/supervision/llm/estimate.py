"""Estimates the costs of supervision by a language model before a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import reduce
from math import isnan
from operator import add
from typing import Final

from islandgp.scoring.generation_stats import GenerationStats
from islandgp.scoring.state import PopulationState, StateSettings, population_state
from islandgp.supervision.base import RunContext
from islandgp.supervision.llm.budget import Bill, most_tokens
from islandgp.supervision.llm.message import MAX_QUOTED, Request, ServerCapabilities, Usage
from islandgp.supervision.llm.questions import NEAR, Questions
from islandgp.supervision.llm.settings import LLMSettings
from islandgp.supervision.llm.transcript import Transcript

ANSWER: Final = 300  # assumed tokens of an answer: a paragraph, or a tree of 20 nodes
THOUGHTS: Final = 1_500  # assumed tokens of thinking before an answer
INFORMED_CHARACTERS: Final = {"rate": 4_300, "tree": 7_200}
"""Characters that the history adds to an informed prompt, by measurement."""
ADDED_EDITS: Final = 6_000  # approximate characters of trees and traces in the edits question
PROBES: Final = 4  # most calls of the probe
ADDED_MOST: Final = 30_000  # most further characters of informed prompts


@dataclass(frozen=True, slots=True)
class SupervisedRuns:
    """Runs that ask the same questions; they differ in the seed."""

    settings: LLMSettings
    context: RunContext
    lag: int  # generations
    number: int = 1


def upper_bound(runs: Sequence[SupervisedRuns]) -> str:
    """A line on the most that all runs together can cost."""
    bill = reduce(add, map(at_most, runs))
    number = sum(r.number for r in runs)
    dollars = "an unknown price" if isnan(bill.usd) else f"{bill.usd:,.2f} US dollars"
    return (
        f"The language model: at most {bill.requests:,.0f} requests, {bill.input:,.0f} tokens in,"
        f" {bill.output:,.0f} out, {dollars} in {number} run{'s' * (number != 1)};"
        " islandgp estimate has the expected costs, supervisor.policy.caps limits a run."
    )


def expected(runs: SupervisedRuns) -> Bill:
    """The expected bill: each question has one answer of ANSWER tokens.

    A model that thinks uses THOUGHTS further tokens. With `cache=true`, a cacheable system prompt
    is written to the cache once and then read.
    """
    settings, requests, times = runs.settings, _requests(runs), _times(runs)
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
    output = times * len(requests) * (ANSWER + most_thoughts(settings))
    usage = Usage(round(fresh), output, round(cache_reads), round(cache_writes))
    bill = Bill.of(times * len(requests) + 1, usage, settings.price)  # and the probe
    return bill.times(runs.number)


def most_thoughts(settings: LLMSettings) -> int:
    """Expected thinking tokens before an answer; 0 for a model that does not think."""
    return min(THOUGHTS, settings.reply_tokens - settings.max_tokens)


def at_most(runs: SupervisedRuns) -> Bill:
    """The upper bound of the bill: all attempts fail late, with repairs and the longest answers.

    Caps limit it.
    """
    settings, exchanges = runs.settings, _requests(runs)
    times = _times(runs) * settings.retry.attempts
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
    usd = bill.usd if isnan(bill.usd) else usd
    return Bill(requests, tokens, output, usd).times(runs.number)


def as_recorded(runs: SupervisedRuns, record: Transcript) -> Bill:
    """The bill with the mean costs of a generation in a recorded run."""
    attempts = record.attempts
    generations = len({a.call.generation for a in attempts if a.call.generation >= 0}) or 1
    share = _times(runs) / generations
    usages = [a.usage for a in attempts if a.usage is not None]
    requests = len(attempts) * share
    share *= len(attempts) / (len(usages) or 1)  # those without a count took as much
    sums = {f.name: round(sum(getattr(u, f.name) for u in usages) * share) for f in fields(Usage)}
    return Bill.of(requests, Usage(**sums), runs.settings.price).times(runs.number)


def _times(runs: SupervisedRuns) -> int:
    """Number of generations with questions; answers after the last generation have no use."""
    return max(0, runs.context.generations - 1 - runs.lag)


def _requests(runs: SupervisedRuns) -> list[tuple[Request, int]]:
    """The questions of a generation, for a state with numbers of typical length.

    Each has the number of characters that the history of the run adds to its prompt.
    """
    questions = Questions(runs.settings, runs.context)
    capabilities = ServerCapabilities(True, runs.settings.temperature, "")
    requests = questions.requests(_state(runs.context), capabilities)
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
