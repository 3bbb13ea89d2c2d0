"""Costs of supervision, estimates of them, and the caps on them (section 3.9, Table 14).

The ledger sums up the transcript, so a resumed run continues with the right sums. Before an
attempt its upper bound is added and compared with the caps: a cap is never exceeded, not even by
an answer that is lost.

Prices and other properties of models are in the dated table of `conf/prices`.
"""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, astuple, dataclass
from getpass import getuser
from math import inf, isnan, nan
from operator import add
from pathlib import Path
from tempfile import gettempdir
from typing import Final

from filelock import FileLock

from islandgp.supervision.base import RunContext
from islandgp.supervision.llm.message import (
    CHARGED,
    MAX_QUOTED,
    Failure,
    FailureKind,
    Reply,
    Request,
    Usage,
    sha256_of,
)
from islandgp.supervision.llm.questions import Questions
from islandgp.supervision.llm.settings import Caps, LLMSettings, PerMinute, Price
from islandgp.supervision.llm.transcript import Attempt, Transcript

LONGEST_TURN: Final = 3600.0  # s; a later one is of a wrong clock
TOKENS_PER_PRICE: Final = 1e6  # tokens per price
ANSWER: Final = 300  # assumed tokens of an answer: a paragraph, or a tree of 20 nodes
THOUGHTS: Final = 1_500  # assumed tokens of thinking before an answer
ADDED: Final = {"rate": 1_600, "tree": 1_900, "edits": 6_000}
"""Characters of a generation in a prompt, by measurement: the state, or the trees to edit."""
ADDED_INFORMED: Final = {"rate": 3_500, "tree": 7_000, "edits": 0}
"""Characters that informed prompts add to them, by measurement."""
ADDED_MOST: Final = 40_000  # most characters of a generation in a prompt
PROBES: Final = 4  # most requests of the probe that are answered


def cost(usage: Usage, price: Price) -> float:
    """Cost of tokens in US dollars."""
    return (
        usage.input * price.input
        + usage.output * price.output
        + usage.cache_read * price.cache_read
        + usage.cache_write * price.cache_write
    ) / TOKENS_PER_PRICE


def most_tokens(request: Request, *, longer: int = 0) -> Usage:
    """Upper bound of the tokens of a request that quotes `longer` further characters.

    Prompts and JSON have three to four bytes per token; the bound assumes two. A quoted answer may
    be in any script, with as little as one byte per token, but has at most `max_tokens`. The
    constant is for the frame of the message.
    """
    system = len(request.system.encode()) // 2
    texts = (*request.turns[::2], json.dumps([request.schema, request.extra]))
    rest = sum(len(text.encode()) for text in texts) // 2 + 500
    quoted = longer + sum(len(text.encode()) for text in request.turns[1::2])
    rest += max(quoted // 2, min(quoted, request.max_tokens))
    if request.cache:
        return Usage(input=rest, output=request.max_tokens, cache_write=system)
    return Usage(input=system + rest, output=request.max_tokens)


@dataclass(frozen=True, slots=True)
class Bill:
    """The sum of the costs of requests. The fields but `usd` have the names of caps."""

    requests: float = 0
    input_tokens: float = 0
    output_tokens: float = 0
    usd: float = 0.0  # nan: an unknown price

    @classmethod
    def of(cls, requests: float, usage: Usage, price: Price | None) -> Bill:
        """The bill of requests with known tokens; `usage` is their sum."""
        usd = nan if price is None else cost(usage, price)
        return cls(requests, usage.read, usage.output, usd)

    @classmethod
    def at_most(cls, requests: float, usage: Usage, price: Price | None) -> Bill:
        """Upper bound of a bill, with or without writing to the cache; `usage` is one, too."""
        if price is not None:
            write = max(price.input, price.cache_write)
            price = price.model_copy(update={"cache_write": write})
        return cls.of(requests, usage, price)

    def __add__(self, other: Bill) -> Bill:
        return Bill(*map(add, astuple(self), astuple(other)))

    def times(self, number: int) -> Bill:
        """The bill of a number of equal runs."""
        return Bill(*(number * amount for amount in astuple(self)))

    def capped(self, caps: Caps) -> Bill:
        """The bill, each sum limited by its cap; an unknown price remains so."""
        limits = {name: getattr(caps, name) for name in asdict(self)}
        sums = asdict(self).items()
        return Bill(*(n if limits[name] is None else min(n, limits[name]) for name, n in sums))

    def over(self, caps: Caps) -> str:
        """The first cap that the bill exceeds, as NAME=VALUE; "" for none."""
        for name, amount in asdict(self).items():
            if (cap := getattr(caps, name)) is not None and amount > cap:
                return f"{name}={cap}"
        return ""


def known_usage(answer: Reply | Failure) -> Usage | None:
    """The tokens of an answer; None if unknown, for a lost answer or a server without counts.

    Rejected requests are not charged.
    """
    if isinstance(answer, Reply):
        return answer.usage
    return None if answer.kind in CHARGED else Usage()


class Pace:
    """Takes turns with the other runs of the user on this machine, by a file under a lock."""

    def __init__(self, limits: PerMinute, place: str, folder: Path, characters: float) -> None:
        """Waits for nothing yet.

        Args:
            limits: of the account.
            place: the server's address or name; runs that ask the same one take turns.
            folder: of the file, which has the time from which the next request may be sent.
            characters: per token, approximately.
        """
        self.limits, self.characters = limits, characters
        self.path = folder / f"islandgp-{sha256_of([place, getuser()])[:16]}.turn"

    @classmethod
    def of(cls, settings: LLMSettings) -> Pace | None:
        """The turns of a run; None without limits."""
        limits, folder = settings.per_minute, Path(gettempdir())
        if limits.requests is None and limits.input_tokens is None:
            return None
        return cls(limits, settings.place, folder, settings.facts.characters)

    def wait(
        self,
        request: Request,
        sleep: Callable[[float], None] = time.sleep,
        clock: Callable[[], float] = time.time,
    ) -> float:
        """Waits for the turn of a request; returns the seconds that it took.

        Args:
            request: to be sent next.
            sleep: replaces time.sleep in tests.
            clock: replaces time.time in tests.
        """
        needs = {
            self.limits.requests: 1.0,
            self.limits.input_tokens: request.characters / self.characters,
        }
        gap = max(60 * n / limit for limit, n in needs.items() if limit is not None)
        began = clock()
        with FileLock(f"{self.path}.lock"):  # also while it sleeps: the others are after it
            try:
                free = float(self.path.read_text())
            except (OSError, ValueError):
                free = 0.0
            if 0 < (left := free - clock()) < LONGEST_TURN:
                sleep(left)
            self.path.write_text(repr(clock() + gap))
        return clock() - began


class Ledger:
    """The costs of a run, summed over its transcript."""

    def __init__(self, transcript: Transcript, price: Price | None, caps: Caps) -> None:
        """Makes the ledger of a run; price=None: dollars are not counted."""
        self.transcript, self.price, self.caps = transcript, price, caps

    def usd(self, usage: Usage) -> float | None:
        """Cost of an answer in US dollars; None if the price is unknown."""
        return None if self.price is None else cost(usage, self.price)

    def over(self, next_at_most: Usage, waited: float = 0.0) -> str:
        """A text on the cap that another request could exceed; "" for none.

        Args:
            next_at_most: upper bound of the request's tokens.
            waited: seconds of waiting before it that are in no attempt yet.
        """
        if cap := (self.most() + Bill.at_most(1, next_at_most, self.price)).over(self.caps):
            return f"another request could pass the cap {cap}"
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
        bills = [
            (Bill.at_most if a.usage is None else Bill.of)(1, a.at_most, self.price)
            for a in self._sent
        ]
        bills += [Bill.at_most(1, r.at_most, self.price) for r in self.transcript.unanswered()]
        return sum(bills, Bill.of(0, Usage(), self.price))

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
    """The expected bill: each question has one answer of ANSWER tokens, nothing is cached.

    A model that thinks uses THOUGHTS further tokens.
    """
    settings, times, questions = runs.settings, runs.times, Questions(runs.settings, runs.context)
    characters = sum(
        questions.request(part).characters + ADDED[part] + ADDED_INFORMED[part] * questions.informed
        for part in questions.parts
    )
    output = times * len(questions.parts) * answer_tokens(settings)
    usage = Usage(round(times * characters / settings.facts.characters), output)
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
