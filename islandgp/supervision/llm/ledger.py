"""Costs of supervision and the caps on them (section 3.9, Table 14).

The ledger sums up the transcript, so a resumed run continues with the right sums. Before an
attempt its upper bound is added and compared with the caps: a cap is never exceeded, not even by
an answer that is lost. The caps of a sweep apply to the sum over all runs in its folder.

Prices and other properties of models are in the dated table of `conf/prices`.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, astuple, dataclass, replace
from math import inf, isnan, nan
from operator import add, neg
from pathlib import Path
from typing import Final

from filelock import FileLock

from islandgp.plain import DECODE_ERRORS, read_json
from islandgp.supervision.llm.message import CHARGED, UNSENT, Failure, Reply, Request, Usage
from islandgp.supervision.llm.settings import Caps, Price, SweepCaps
from islandgp.supervision.llm.transcript import NAME, Attempt, Transcript

TOKENS_PER_PRICE: Final = 1e6  # tokens per price


def cost(usage: Usage, price: Price) -> float:
    """Cost of tokens in US dollars."""
    return (
        usage.input * price.input
        + usage.output * price.output
        + usage.cache_read * price.cache_read
        + usage.cache_write * price.cache_write
    ) / TOKENS_PER_PRICE


def dearest(price: Price) -> Price:
    """Upper bound of a price, with or without writing to the cache."""
    return price.model_copy(update={"cache_write": max(price.input, price.cache_write)})


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
    """The sum of the costs of requests."""

    requests: float
    input: float  # tokens
    output: float  # tokens
    usd: float  # nan: an unknown price

    @classmethod
    def of(cls, requests: float, usage: Usage, price: Price | None) -> Bill:
        """The bill of requests with known tokens; `usage` is their sum."""
        return cls(requests, usage.read, usage.output, nan if price is None else cost(usage, price))

    @classmethod
    def at_most(cls, requests: float, usage: Usage, price: Price | None) -> Bill:
        """Upper bound of the bill of requests; `usage` is the upper bound of their tokens."""
        return cls.of(requests, usage, price and dearest(price))

    def __add__(self, other: Bill) -> Bill:
        return Bill(*map(add, astuple(self), astuple(other)))

    def __neg__(self) -> Bill:
        return Bill(*map(neg, astuple(self)))

    def over(self, caps: SweepCaps) -> str:
        """The first cap that the bill exceeds, as NAME=VALUE; "" for none."""
        for name, (amount, cap) in self.against(caps).items():
            if cap is not None and amount > cap:
                return f"{name}={cap}"
        return ""

    def against(self, caps: SweepCaps) -> dict[str, tuple[float, float | None]]:
        """Pairs of an amount and its cap, by the cap's name."""
        names = ("requests", "input_tokens", "output_tokens", "usd")
        return {
            n: (amount, getattr(caps, n)) for n, amount in zip(names, astuple(self), strict=True)
        }


def known_usage(answer: Reply | Failure) -> Usage | None:
    """The tokens of an answer; None if unknown, for a lost answer or a server without counts.

    Rejected requests are not charged.
    """
    if isinstance(answer, Reply):
        return answer.usage
    return None if answer.kind in CHARGED else Usage()


class Ledger:
    """The costs of a run, summed over its transcript."""

    def __init__(
        self,
        transcript: Transcript,
        price: Price | None,
        caps: Caps,
        *,
        prices: Mapping[str, Price] | None = None,
        sweep: SweepLedger | None = None,
    ) -> None:
        """Makes the ledger of a run.

        Args:
            transcript: of the run.
            price: upper bound for all models of the run; None: dollars are not counted.
            caps: of the run.
            prices: by model, if there are several.
            sweep: the ledger of the run's sweep; None: it has no caps.
        """
        self.transcript, self.price, self.caps = transcript, price, caps
        self.prices, self.sweep = prices or {}, sweep

    def usd(self, usage: Usage, model: str) -> float | None:
        """Cost of an answer in US dollars; None if the price is unknown."""
        price = self.prices.get(model, self.price)
        return None if price is None else cost(usage, price)

    def reserve(self, next_at_most: Usage, waited: float = 0.0) -> str:
        """Reserves a request in the sweep's ledger, unless it could exceed a cap; see `over`."""
        reason = self.over(next_at_most, waited)
        if reason or self.sweep is None:
            return reason
        return self.sweep.reserve(Bill.at_most(1, next_at_most, self.price))

    def settle(self, attempt: Attempt, reserved: Usage) -> None:
        """Replaces a reservation in the sweep's ledger by the attempt's costs, if known."""
        if self.sweep is not None and attempt.usage is not None:
            price = self.prices.get(attempt.request.model, self.price)
            bill = Bill.of(int(is_sent(attempt)), attempt.usage, price)
            self.sweep.add(bill + -Bill.at_most(1, reserved, self.price))

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
        _, unanswered = self.transcript.requests()
        spent = sum(a.seconds + a.waited for a in list(self.transcript.attempts))
        return max(0.0, self.caps.seconds - spent - sum(request.seconds for request in unanswered))

    def room_for(self, requests: int, at_most: Usage, *, seconds: float) -> bool:
        """True if further requests cannot exceed a cap, in any order of their answers.

        Args:
            requests: their number.
            at_most: upper bound of the sum of their tokens.
            seconds: upper bound of the sum of their seconds.
        """
        bill = Bill.at_most(requests, at_most, self.price)
        if self.sweep is not None and self.sweep.over(bill):
            return False
        return seconds <= self.seconds_left() and not (self.most() + bill).over(self.caps)

    def most(self) -> Bill:
        """Upper bound of the costs of all requests so far."""
        attempts, unanswered = self.transcript.requests()
        bills = [Bill.of(0, Usage(), self.price)]
        bills += [Bill.at_most(1, request.at_most, self.price) for request in unanswered]
        for a in filter(is_sent, attempts):
            if a.usage is None:
                bills.append(Bill.at_most(1, a.at_most, self.price))
            else:
                bills.append(Bill.of(1, a.usage, self.prices.get(a.request.model, self.price)))
        return sum(bills[1:], bills[0])

    def totals(self) -> dict[str, float]:
        """Sums since the run's start by name, for the costs of a generation and for MLflow."""
        attempts, unanswered = self.transcript.requests()
        sent, parts = list(filter(is_sent, attempts)), list(self.transcript.parts)
        requests = len(sent) + len(unanswered)
        usages = [a.usage for a in sent if a.usage is not None]
        failures = Counter(a.answer.kind for a in attempts if isinstance(a.answer, Failure))
        rejected = Counter(stage for part in parts for stage in part.rejected)
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
            "fallback_rates": sum(p.source == "fallback" and p.part == "rate" for p in parts),
            "fallback_trees": sum(p.source == "fallback" and p.part == "tree" for p in parts),
        }
        played = list(self.transcript.played)
        if played:
            sums["episodes"] = sum(p.episodes for p in played)
        if trials := [p for p in played if p.purpose == "trial"]:
            sums["trials"] = len(trials)
            sums["trial_gain"] = sum(p.gain for p in trials)
        if not isnan(most := self.most().usd):
            sums["cost_usd"] = sum(a.usd or 0.0 for a in sent)
            sums["cost_usd_at_most"] = most
        sums |= {f"failures_{kind}": count for kind, count in sorted(failures.items())}
        sums |= {f"rejected_{stage}": count for stage, count in sorted(rejected.items())}
        return sums


class SweepLedger:
    """The sum of the costs of all runs in a folder; changes are lines of `spending.jsonl`.

    The upper bound of a request is reserved before it is sent and replaced after the answer; the
    reservation of a killed process stays. Processes share the file with a lock.
    """

    def __init__(self, folder: Path, price: Price | None, caps: SweepCaps) -> None:
        """Sums up the transcripts of the folder's runs if the file is missing."""
        self.path, self.caps = folder / "spending.jsonl", caps
        self._lock = FileLock(folder / ".spending.lock")
        self._read, self._total = 0, Bill(0, 0, 0, 0.0)  # bytes that are in the total
        folder.mkdir(parents=True, exist_ok=True)
        with self._lock:
            if not self.path.exists():
                run = Caps(seconds=None)
                bills = [
                    Ledger(Transcript(file, fixed=True), price, run).most()
                    for file in sorted(folder.glob(f"*/{NAME}"))
                ]
                self._write(sum(bills, self._total))

    def over(self, bill: Bill) -> str:
        """A text on the cap that a bill could exceed; "" for none."""
        with self._lock:
            return self._over(bill)

    def reserve(self, bill: Bill) -> str:
        """Records a bill before its request is sent, unless it could exceed a cap; see `over`."""
        with self._lock:
            if not (reason := self._over(bill)):
                self._write(bill)
        return reason

    def add(self, change: Bill) -> None:
        """Records a change of the sum."""
        with self._lock:
            self._write(change)

    def _over(self, bill: Bill) -> str:
        with self.path.open("rb") as file:
            file.seek(self._read)
            new = file.read()
        end = new.rfind(b"\n") + 1
        for line in new[:end].splitlines():
            with suppress(*DECODE_ERRORS):  # an incomplete line of a killed process
                self._total += Bill(**read_json(line))
        self._read += end
        cap = (self._total + bill).over(self.caps)
        return f"another request could pass the cap sweep_caps.{cap}" if cap else ""

    def _write(self, bill: Bill) -> None:
        line = json.dumps(asdict(replace(bill, usd=0.0 if isnan(bill.usd) else bill.usd))).encode()
        with self.path.open("ab") as file:
            file.write(b"\n" + line + b"\n")  # the first line end completes an incomplete line
            file.flush()
            os.fsync(file.fileno())


def recorded_requests(folder: Path) -> int:
    """Number of requests in the recorded costs of a run's generations; 0 without records."""
    try:
        lines = (folder / "costs.jsonl").read_bytes().splitlines()
    except FileNotFoundError:
        return 0
    requests = 0
    for line in lines:
        with suppress(*DECODE_ERRORS):  # damaged lines are reported when records are read
            requests = max(requests, int(read_json(line)["llm"].get("requests", 0)))
    return requests


def is_sent(attempt: Attempt) -> bool:
    """True if the request was sent; False if there was no connection."""
    return isinstance(attempt.answer, Reply) or attempt.answer.kind not in UNSENT
