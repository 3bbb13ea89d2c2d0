"""What a run's supervision will cost, added before it starts."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from islandgp.scoring.generation_stats import GenerationStats
from islandgp.scoring.state import PopulationState, StateSettings, population_state
from islandgp.supervision.base import RunContext
from islandgp.supervision.llm.adviser import Adviser
from islandgp.supervision.llm.capabilities import Dialect
from islandgp.supervision.llm.ledger import Bill, most_tokens
from islandgp.supervision.llm.message import QUOTED, Request, Usage
from islandgp.supervision.llm.settings import LLMSettings
from islandgp.supervision.llm.transcript import Transcript

ANSWER: Final = 300  # tokens of an answer; an assumption: a paragraph, or a tree of 20 nodes
CANDIDATE: Final = 150  # tokens of each tree more; an assumption
ADDED: Final = {"rate": 4_300, "tree": 7_200}  # characters more of informed ones, as measured
ADDED_EDITS: Final = 6_000  # characters of trees and traces in the question for edits, about
PROBES: Final = 4  # calls at most
ADDED_MOST: Final = 30_000  # the same at most, as `informed` bounds it


def expected(settings: LLMSettings, context: RunContext, lag: int = 0) -> Bill:
    """The bill where every question is answered at once, with ANSWER tokens."""
    asked = _requests(settings, context)
    times = _times(context, lag)
    sizes = [added + sum(map(len, (r.system, *r.turns))) for r, added in asked]
    more = CANDIDATE * (settings.candidates - 1) if context.inject else 0
    return _bill(
        settings,
        times * len(asked) + 1,  # and the probe
        times * sum(sizes) / settings.facts.characters,
        times * (len(asked) * ANSWER + more),
    )


def at_most(settings: LLMSettings, context: RunContext, lag: int = 0) -> Bill:
    """The bill where everything fails late, is repaired, and is as long as it may be.

    Caps cut it short.
    """
    asked = _requests(settings, context)
    times = _times(context, lag) * settings.retry.attempts
    turns = 1 + settings.repairs
    most = [
        most_tokens(request, longer=QUOTED * settings.repairs + (ADDED_MOST if added else 0))
        for request, added in asked
    ]
    bill = _bill(
        settings,
        times * turns * len(asked) + PROBES * settings.retry.attempts,
        times * turns * sum(m.input for m in most),
        times * turns * sum(m.output for m in most),
    )
    requests, tokens, output, usd = (
        found if cap is None else min(found, cap)
        for found, cap in bill.against(settings.caps).values()
    )
    return Bill(requests, tokens, output, None if bill.usd is None else usd)


def as_recorded(
    settings: LLMSettings, context: RunContext, record: Transcript, lag: int = 0
) -> Bill:
    """The bill where each generation takes what it took in a recorded run, on the mean."""
    attempts = record.attempts
    generations = len({a.call.generation for a in attempts if a.call.generation >= 0}) or 1
    share = _times(context, lag) / generations
    usages = [a.usage for a in attempts if a.usage is not None]
    requests = len(attempts) * share
    share *= len(attempts) / (len(usages) or 1)  # those without a count took as much
    return _bill(
        settings,
        requests,
        sum(u.read for u in usages) * share,
        sum(u.output for u in usages) * share,
    )


def _times(context: RunContext, lag: int) -> int:
    """Generations that are asked about: an answer after the last one would come too late."""
    return max(0, context.generations - 1 - lag)


def _bill(settings: LLMSettings, requests: float, tokens: float, output: float) -> Bill:
    return Bill.of(requests, Usage(round(tokens), round(output)), settings.price)


def _requests(settings: LLMSettings, context: RunContext) -> list[tuple[Request, int]]:
    """One generation's questions, about a state with numbers of the usual length.

    With each the characters that the run adds to it, where its prompt shows the run.
    """
    adviser, dialect = Adviser(settings, context), Dialect(True, settings.temperature, "")
    state = _state(context)
    return [
        (
            adviser.request(part, state, dialect),
            ADDED_EDITS if part not in ADDED else ADDED[part] if adviser.uses_history else 0,
        )
        for part in adviser.parts
    ]


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
        doing=dict.fromkeys(classes.behaviours, 14),
        tiers=dict.fromkeys(classes.tiers, 4),
        counters=dict.fromkeys(context.schema.counters, 123.4),
        size=23.4,
        rate=0.234,
    )
    return population_state(
        [
            replace(now, best=now.best - 1234 * ago, mean=now.mean - 123 * ago)
            for ago in range(4, -1, -1)
        ],
        StateSettings(window=5, improvement=0, low_diversity=0),
        context.crisis,
        classes,
        crossover_rate=0.8,
        population=30,
        generations=context.generations,
        generations_per_epoch=5,
        multipliers=dict.fromkeys(context.schema.components, 1.8),
    )
