"""What a run's supervision will cost, told before it starts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from islandgp.scoring.snapshot import Snapshot
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import RunContext
from islandgp.supervision.llm.adviser import Adviser
from islandgp.supervision.llm.capabilities import Dialect
from islandgp.supervision.llm.ledger import Caps, cost, most_tokens
from islandgp.supervision.llm.message import QUOTED, Request, Usage
from islandgp.supervision.llm.settings import LLMSettings
from islandgp.supervision.llm.transcript import Transcript

ANSWER: Final = 300  # tokens of an answer; an assumption: a paragraph, or a tree of 20 nodes
CANDIDATE: Final = 150  # tokens of each tree more; an assumption
TOLD: Final = (4_300, 7_200)  # characters that a run adds to informed questions, as measured
TOLD_MOST: Final = 30_000  # the same at most, as `informed` bounds it


@dataclass(frozen=True, slots=True)
class Bill:
    """What supervision takes."""

    requests: float
    input: float  # tokens
    output: float  # tokens
    usd: float | None  # None: an unknown price

    def __add__(self, other: Bill) -> Bill:
        both = None if self.usd is None or other.usd is None else self.usd + other.usd
        return Bill(
            self.requests + other.requests,
            self.input + other.input,
            self.output + other.output,
            both,
        )


def expected(settings: LLMSettings, setup: RunContext, lag: int = 0) -> Bill:
    """The bill where every question is answered at once, with ANSWER tokens."""
    asked = _requests(settings, setup)
    times = _times(setup, lag)
    sizes = [told + sum(map(len, (r.system, *r.turns))) for r, told in asked]
    more = CANDIDATE * (settings.candidates - 1) if setup.inject else 0
    return _bill(
        settings,
        times * len(asked) + 1,  # and the probe
        times * sum(sizes) / settings.facts.characters,
        times * (len(asked) * ANSWER + more),
    )


def at_most(settings: LLMSettings, setup: RunContext, lag: int = 0) -> Bill:
    """The bill where everything fails late, is repaired, and is as long as it may be.

    Caps cut it short.
    """
    asked = _requests(settings, setup)
    times = _times(setup, lag) * settings.retry.attempts
    turns = 1 + settings.repairs
    most = [
        most_tokens(request, longer=QUOTED * settings.repairs + (TOLD_MOST if told else 0))
        for request, told in asked
    ]
    bill = _bill(
        settings,
        times * turns * len(asked) + 3 * settings.retry.attempts,
        times * turns * sum(m.input for m in most),
        times * turns * sum(m.output for m in most),
    )
    return _capped(bill, settings.caps)


def as_recorded(settings: LLMSettings, setup: RunContext, record: Transcript, lag: int = 0) -> Bill:
    """The bill where each generation takes what it took in a recorded run, on the mean."""
    attempts = record.attempts
    generations = len({a.call.generation for a in attempts if a.call.generation >= 0}) or 1
    share = _times(setup, lag) / generations
    usages = [a.usage for a in attempts if a.usage is not None]
    requests = len(attempts) * share
    share *= len(attempts) / (len(usages) or 1)  # those without a count took as much
    return _bill(
        settings,
        requests,
        sum(u.input + u.cache_read + u.cache_write for u in usages) * share,
        sum(u.output for u in usages) * share,
    )


def _times(setup: RunContext, lag: int) -> int:
    """Generations that are asked about: an answer after the last one would come too late."""
    return max(0, setup.generations - 1 - lag)


def _bill(settings: LLMSettings, requests: float, tokens: float, output: float) -> Bill:
    usage = Usage(round(tokens), round(output))
    price = settings.price
    return Bill(requests, usage.input, usage.output, None if price is None else cost(usage, price))


def _capped(bill: Bill, caps: Caps) -> Bill:
    def least(found: float, cap: float | None) -> float:
        return found if cap is None else min(found, cap)

    return Bill(
        least(bill.requests, caps.requests),
        least(bill.input, caps.input_tokens),
        least(bill.output, caps.output_tokens),
        None if bill.usd is None else least(bill.usd, caps.usd),
    )


def _requests(settings: LLMSettings, setup: RunContext) -> list[tuple[Request, int]]:
    """One generation's questions, about a state with numbers of the usual length.

    With each the characters that the run adds to it, where its prompt tells of the run.
    """
    adviser, dialect = Adviser(settings, setup), Dialect(True, settings.temperature, "")
    state = _state(setup)
    told = TOLD if adviser.tells_of_run else (0, 0)
    asked = []
    if setup.adapt_mutation:
        asked.append((adviser.rate_request(state, dialect), told[0]))
    if setup.inject:
        asked.append((adviser.tree_request(state, dialect), told[1]))
    return asked


def _state(setup: RunContext) -> PopulationState:
    classes = setup.classes
    now = Snapshot(
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
        counters=dict.fromkeys(setup.schema.counters, 123.4),
        size=23.4,
        rate=0.234,
    )
    return PopulationState(
        now=now,
        history=(now,) * 5,
        best_rose=True,
        best_rise=0.123,
        best_change=1234.0,
        mean_change=123.0,
        best_trend=1234.0,
        mean_trend=123.0,
        diversity_change=-0.023,
        diversity_trend=0.012,
        stagnant_generations=3,
        stagnant_epochs=0.6,
        crisis="",
        diversity_warning=False,
        reached=dict.fromkeys(classes.milestones, True),
        dominant=classes.specialists.of[0],
        lacking=tuple(classes.behaviours),
        targets=classes.targets,
        mutation_rate=0.234,
        crossover_rate=0.8,
        population=30,
        generations=setup.generations,
        multipliers=dict.fromkeys(setup.schema.components, 1.8),
    )
