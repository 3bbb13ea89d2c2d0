"""Estimates the costs of supervision by a language model before a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan
from typing import Final

from islandgp.supervision.base import RunContext
from islandgp.supervision.llm.budget import Bill, most_tokens
from islandgp.supervision.llm.message import MAX_QUOTED, Usage
from islandgp.supervision.llm.questions import Questions
from islandgp.supervision.llm.settings import LLMSettings

ANSWER: Final = 300  # assumed tokens of an answer: a paragraph, or a tree of 20 nodes
THOUGHTS: Final = 1_500  # assumed tokens of thinking before an answer
ADDED: Final = {"rate": 1_600, "tree": 1_900, "edits": 6_000}
"""Characters of a generation in a prompt, by measurement: the state, or the trees to edit."""
ADDED_INFORMED: Final = {"rate": 3_500, "tree": 7_000, "edits": 0}
"""Characters that informed prompts add to them, by measurement."""
ADDED_MOST: Final = 40_000  # most characters of a generation in a prompt
PROBES: Final = 4  # most requests of the probe that are answered
NEAR: Final = 1.2  # factor on the shortest cached length, as tokens are only estimated


@dataclass(frozen=True, slots=True)
class SupervisedRuns:
    """Runs that ask the same questions; they differ in the seed."""

    settings: LLMSettings
    context: RunContext
    lag: int  # generations
    number: int = 1

    @property
    def times(self) -> int:
        """Generations with questions; answers after the last generation have no use."""
        return max(0, self.context.generations - 1 - self.lag)


def costs(runs: Sequence[SupervisedRuns]) -> str:
    """A line on what all runs together are expected to cost, and on the most they can cost."""
    number = sum(r.number for r in runs)
    likely, most = (sum(map(bill, runs), Bill()) for bill in (expected, at_most))
    return (
        f"The language model ({', '.join(sorted({r.settings.model_name for r in runs}))}):"
        f" {_words(likely)} are expected in {number} run{'s' * (number != 1)}, at most"
        f" {_words(most)}; supervisor.policy.caps limits a run."
    )


def _words(bill: Bill) -> str:
    dollars = "an unknown price" if isnan(bill.usd) else f"{bill.usd:,.2f} US dollars"
    tokens = f"{bill.input_tokens:,.0f} tokens in, {bill.output_tokens:,.0f} out"
    return f"{bill.requests:,.0f} requests, {tokens}, {dollars}"


def expected(runs: SupervisedRuns) -> Bill:
    """The expected bill: each question has one answer of ANSWER tokens.

    A model that thinks uses THOUGHTS further tokens. With `cache=true`, a cacheable system prompt
    is written to the cache once and then read.
    """
    settings, times = runs.settings, runs.times
    questions = Questions(settings, runs.context)
    shortest = settings.facts.caches_from if settings.cache else None
    usage = Usage(output=times * len(questions.parts) * answer_tokens(settings))
    for part in questions.parts:
        request = questions.request(part)
        added = ADDED[part] + ADDED_INFORMED[part] * questions.informed
        characters = settings.facts.characters
        system = round(len(request.system) / characters)
        usage += Usage(round(times * (len(request.turns[0]) + added) / characters))
        if shortest is not None and system >= NEAR * shortest:
            reads, writes = max(0, times - 1) * system, min(1, times) * system
            usage += Usage(cache_read=reads, cache_write=writes)
        else:
            usage += Usage(times * system)
    bill = Bill.of(times * len(questions.parts) + 1, usage, settings.price)  # and the probe
    return bill.times(runs.number)


def answer_tokens(settings: LLMSettings) -> int:
    """Expected tokens of an answer, with thinking before it."""
    return ANSWER + min(THOUGHTS, settings.reply_tokens - settings.max_tokens)


def at_most(runs: SupervisedRuns) -> Bill:
    """The upper bound of the bill: all attempts fail late, with repairs and the longest answers.

    Caps limit it.
    """
    settings = runs.settings
    times = runs.times * settings.retry.attempts * (1 + settings.repairs)
    longer = MAX_QUOTED * settings.repairs + ADDED_MOST
    bill = Bill.of(PROBES * settings.retry.attempts, Usage(), settings.price)
    questions = Questions(settings, runs.context)
    for part in questions.parts:
        tokens = most_tokens(questions.request(part), longer=longer)
        bill += Bill.at_most(1, tokens, settings.price).times(times)
    return bill.capped(settings.caps).times(runs.number)
