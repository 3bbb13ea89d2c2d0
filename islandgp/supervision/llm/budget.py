"""Costs of supervision, estimates of them, and the caps on them (section 3.9, Table 14).

The ledger sums up the transcript, so a resumed run continues with the right sums. Before an
attempt its upper bound is added and compared with the caps: a cap is never exceeded, not even by
an answer that is lost.

Prices and other properties of models are in the dated table of `conf/prices`.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from getpass import getuser
from math import inf, isnan, nan
from pathlib import Path
from tempfile import gettempdir
from typing import Final, NamedTuple

import numpy as np
from filelock import FileLock

from islandgp.supervision.base import RunContext
from islandgp.supervision.llm.message import MAX_QUOTED, FailureKind, Request, Usage, sha256_of
from islandgp.supervision.llm.questions import Questions
from islandgp.supervision.llm.settings import Caps, LLMSettings, Price
from islandgp.supervision.llm.transcript import Attempt, Transcript

LONGEST_TURN: Final = 3600.0  # s; a later one is of a wrong clock
TOKENS_PER_PRICE: Final = 1e6  # tokens per price
ANSWER: Final = 300  # assumed tokens of an answer: a paragraph, or a tree of 20 nodes
THOUGHTS: Final = 1_500  # assumed tokens of thinking before an answer
ADDED: Final = {"rate": 1_600, "tree": 1_900, "edits": 6_000}
"""Characters of a generation in a prompt, by measurement: the state, or the trees to edit."""
ADDED_INFORMED: Final = {"rate": 2_500, "tree": 4_000, "edits": 0}
"""Characters that informed prompts add to them, by measurement."""
ADDED_MOST: Final = 40_000  # most characters of a generation in a prompt
PROBES: Final = 4  # most requests of the probe that are answered


def cost(usage: Usage, price: Price) -> float:
    """Cost of tokens in US dollars."""
    prices = price.model_dump()
    return sum(float(n * prices[name]) for name, n in asdict(usage).items()) / TOKENS_PER_PRICE


class Bill(NamedTuple):
    """The sum of the costs of requests. The fields have the names of caps."""

    requests: float = 0
    input_tokens: float = 0
    output_tokens: float = 0
    usd: float = 0.0  # nan: an unknown price

    @classmethod
    def of(cls, requests: float, usage: Usage, price: Price | None) -> Bill:
        """The bill of requests; `usage` is the sum of their tokens."""
        usd = nan if price is None else cost(usage, price)
        return cls(requests, usage.read, usage.output, usd)


def limits(caps: Caps) -> list[float]:
    """The caps of a bill's sums; infinite without a cap."""
    values = (getattr(caps, name) for name in Bill._fields)
    return [inf if cap is None else cap for cap in values]


def wait_for_turn(
    settings: LLMSettings,
    request: Request,
    sleep: Callable[[float], None] = time.sleep,
    clock: Callable[[], float] = time.time,
) -> float:
    """Waits for the turn of a request among the user's runs on this machine; returns the seconds.

    Runs that ask the same server share a file under a lock, which has the time from which the next
    request may be sent. Without limits nobody waits.

    Args:
        settings: have the limits of the account.
        request: to be sent next.
        sleep: replaces time.sleep in tests.
        clock: replaces time.time in tests.
    """
    account, tokens = settings.per_minute, request.characters / settings.facts.characters
    needs = ((account.requests, 1.0), (account.input_tokens, tokens))
    gaps = [60 * need / limit for limit, need in needs if limit is not None]
    if not gaps:
        return 0.0
    name = f"islandgp-{sha256_of([settings.place, getuser()])[:16]}.turn"
    path, began = Path(gettempdir()) / name, clock()
    with FileLock(f"{path}.lock"):  # also while it sleeps: the others are after it
        try:
            free = float(path.read_text())
        except (OSError, ValueError):
            free = 0.0
        if 0 < (left := free - clock()) < LONGEST_TURN:
            sleep(left)
        path.write_text(repr(clock() + max(gaps)))
    return clock() - began


class Ledger:
    """The costs of a run, summed over its transcript."""

    def __init__(self, transcript: Transcript, settings: LLMSettings) -> None:
        """Makes the ledger of a run; without a price dollars are not counted."""
        self.transcript, self.price, self.caps = transcript, settings.price, settings.caps

    def over(self, next_at_most: Usage, waited: float = 0.0) -> str:
        """A text on the cap that another request could exceed; "" for none.

        Args:
            next_at_most: upper bound of the request's tokens.
            waited: seconds of waiting before it that are in no attempt yet.
        """
        sums = np.add(self.most(), Bill.of(1, next_at_most, self.price))
        for name, most, n in zip(Bill._fields, limits(self.caps), sums, strict=True):
            if n > most:
                return f"another request could pass the cap {name}={most:g}"
        if self.seconds_left() <= waited:
            return f"the cap seconds={self.caps.seconds:g} is reached"
        return ""

    def seconds_left(self) -> float:
        """Seconds until the cap on seconds is reached, >= 0; infinite without a cap.

        Waiting time counts. Requests without an outcome count with their upper bound.
        """
        if self.caps.seconds is None:
            return inf
        spent = sum(a.seconds + a.waited for a in self.transcript.attempts)
        spent += sum(request.seconds for request in self.transcript.unanswered())
        return max(0.0, self.caps.seconds - spent)

    def most(self) -> Bill:
        """Upper bound of the costs of all requests so far."""
        most = [a.at_most for a in self._sent] + [r.at_most for r in self.transcript.unanswered()]
        return Bill.of(len(most), sum(most, Usage()), self.price)

    @property
    def _sent(self) -> list[Attempt]:
        """The attempts that reached a server."""
        unsent = (FailureKind.BUDGET, FailureKind.UNREACHABLE)
        return [a for a in self.transcript.attempts if a.failed not in unsent]

    def totals(self) -> dict[str, float]:
        """Sums since the run's start by name, for the costs of a generation and for MLflow."""
        attempts, sent, parts = self.transcript.attempts, self._sent, self.transcript.parts
        requests = len(sent) + len(self.transcript.unanswered())
        usages = [a.usage for a in sent if a.usage is not None]
        failures = Counter(a.failed for a in attempts if a.failed)
        del failures[FailureKind.BUDGET]  # nothing was sent
        rejected = Counter(stage for part in parts for stage in part.rejected)
        fallbacks = Counter(part.part for part in parts if part.source == "fallback")
        sums: dict[str, float] = {
            "requests": requests,
            "calls": len({a.call for a in sent}),
            **{f"{name}_tokens": n for name, n in asdict(sum(usages, Usage())).items()},
            "latency_s": sum(a.seconds for a in attempts),
            "waited_s": sum(a.waited for a in attempts),
            "uncounted_requests": requests - len(usages),
            "failures": failures.total(),
            "rejections": rejected.total(),
            "repaired": sum("repaired" in part.source for part in parts),
            "fallback_rates": fallbacks["rate"],
            "fallback_trees": fallbacks["tree"],
            **{f"failures_{kind}": count for kind, count in sorted(failures.items())},
            **{f"rejected_{stage}": count for stage, count in sorted(rejected.items())},
        }
        if not isnan(most := self.most().usd):
            sums |= {"cost_usd": sum(a.usd or 0.0 for a in sent), "cost_usd_at_most": most}
        return sums


@dataclass(frozen=True, slots=True)
class SupervisedRuns:
    """Runs that ask the same questions; they differ in the seed."""

    settings: LLMSettings
    context: RunContext
    number: int = 1


def costs(runs: Sequence[SupervisedRuns]) -> str:
    """A line on what all runs together are expected to cost, and on the most they can cost."""
    number = sum(r.number for r in runs)
    sums = np.sum([np.multiply(r.number, bills(r)) for r in runs], axis=0)
    likely, most = (Bill(*own) for own in sums)
    return (
        f"The language model ({', '.join(sorted({r.settings.model_name for r in runs}))}):"
        f" {_words(likely)} are expected in {number} run{'s' * (number != 1)}, at most"
        f" {_words(most)}; supervisor.policy.caps limits a run."
    )


def _words(bill: Bill) -> str:
    dollars = "an unknown price" if isnan(bill.usd) else f"{bill.usd:,.2f} US dollars"
    tokens = f"{bill.input_tokens:,.0f} tokens in, {bill.output_tokens:,.0f} out"
    return f"{bill.requests:,.0f} requests, {tokens}, {dollars}"


def answer_tokens(settings: LLMSettings) -> int:
    """Expected tokens of an answer, with thinking before it."""
    return ANSWER + min(THOUGHTS, settings.reply_tokens - settings.max_tokens)


def bills(runs: SupervisedRuns) -> tuple[Bill, Bill]:
    """The expected bill of one run, and the upper bound of it within the run's caps.

    Expected is one answer to each question, with nothing read from a cache. At most, all attempts
    fail late, with repairs and the longest answers.
    """
    settings, questions = runs.settings, Questions(runs.settings, runs.context)
    attempts, price = settings.retry.attempts, settings.price
    times = runs.context.generations - 1  # an answer after the last generation has no use
    longer = MAX_QUOTED * settings.repairs + ADDED_MOST
    likely = np.array(Bill.of(1, Usage(), price))  # of the probe
    most = np.array(Bill.of(PROBES * attempts, Usage(), price))
    for part in questions.parts:
        request = questions.request(part)
        characters = request.characters + ADDED[part] + ADDED_INFORMED[part] * questions.informed
        tokens = Usage(round(characters / settings.facts.characters), answer_tokens(settings))
        likely += np.multiply(times, Bill.of(1, tokens, price))
        bound = Bill.of(1, request.most_tokens(longer=longer), price)
        most += np.multiply(times * attempts * (1 + settings.repairs), bound)
    return Bill(*likely), Bill(*np.minimum(most, limits(settings.caps)))
