"""What supervision has taken so far, and the caps that end it (section 3.9, Table 14).

The ledger is a sum over the transcript, so a resumed run goes on with the right
sums. Caps are compared with the most that an attempt can take, before it is
made: a cap is never passed, not even by an answer that never arrived. The caps of a sweep
are compared with the sum over all runs in its folder.

What is known of models and what their tokens cost is the dated table of `conf/prices`.
"""

from __future__ import annotations

import json
import math
import os
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final

from filelock import FileLock

from islandgp.plain import DECODE_ERRORS, read_json
from islandgp.supervision.llm.message import CHARGED, UNSENT, Failure, Reply, Request, Usage
from islandgp.supervision.llm.settings import Caps, Price, SweepCaps
from islandgp.supervision.llm.transcript import NAME, Attempt, Transcript

PER: Final = 1e6  # tokens that a price is for


def cost(usage: Usage, price: Price) -> float:
    """US dollars."""
    return (
        usage.input * price.input
        + usage.output * price.output
        + usage.cache_read * price.cache_read
        + usage.cache_write * price.cache_write
    ) / PER


def most_cost(usage: Usage, price: Price) -> float:
    """US dollars that so many tokens cost at most: a cache may keep those to be written, or not."""
    dearest = price.model_copy(update={"cache_write": max(price.input, price.cache_write)})
    return cost(usage, dearest)


def most_tokens(request: Request, *, longer: int = 0) -> Usage:
    """More tokens than a request can take, also when it quotes `longer` characters more.

    The prompts and JSON have three to four bytes a token, here it is two. A quoted answer may be
    in any script, down to a byte a token, but has no more tokens than an answer may have. The
    frame of the message is in the constant.
    """
    system = len(request.system.encode()) // 2
    own = (*request.turns[::2], json.dumps([request.schema, request.extra]))
    rest = sum(len(text.encode()) for text in own) // 2 + 500
    quoted = longer + sum(len(text.encode()) for text in request.turns[1::2])
    rest += max(quoted // 2, min(quoted, request.max_tokens))
    if request.cache:
        return Usage(input=rest, output=request.max_tokens, cache_write=system)
    return Usage(input=system + rest, output=request.max_tokens)


@dataclass(frozen=True, slots=True)
class Bill:
    """What some requests take together."""

    requests: float
    input: float  # tokens
    output: float  # tokens
    usd: float | None  # None: an unknown price

    @classmethod
    def of(cls, requests: float, usage: Usage, price: Price | None) -> Bill:
        """Requests that take so many tokens together."""
        usd = None if price is None else cost(usage, price)
        return cls(requests, usage.read, usage.output, usd)

    @classmethod
    def at_most(cls, requests: float, usage: Usage, price: Price | None) -> Bill:
        """Requests that take at most so many tokens together, at the dearest price of each."""
        usd = None if price is None else most_cost(usage, price)
        return cls(requests, usage.read, usage.output, usd)

    def __add__(self, other: Bill) -> Bill:
        both = None if self.usd is None or other.usd is None else self.usd + other.usd
        return Bill(
            self.requests + other.requests,
            self.input + other.input,
            self.output + other.output,
            both,
        )

    def __neg__(self) -> Bill:
        usd = None if self.usd is None else -self.usd
        return Bill(-self.requests, -self.input, -self.output, usd)

    def against(self, caps: SweepCaps) -> dict[str, tuple[float, float | None]]:
        """What there is of each sort, and its cap, by the cap's name."""
        return {
            "requests": (self.requests, caps.requests),
            "input_tokens": (self.input, caps.input_tokens),
            "output_tokens": (self.output, caps.output_tokens),
            "usd": (self.usd or 0.0, caps.usd),
        }


def known_usage(answer: Reply | Failure) -> Usage | None:
    """The tokens of an answer; None where a request was perhaps charged an unknown amount.

    That is so for a lost answer and for a server that counts no tokens. A server that turns
    a request away does not charge it.
    """
    if isinstance(answer, Reply):
        return answer.usage
    return None if answer.kind in CHARGED else Usage()


class Ledger:
    """Counts a transcript."""

    def __init__(
        self,
        transcript: Transcript,
        price: Price | None,
        caps: Caps,
        *,
        prices: Mapping[str, Price] | None = None,
        sweep: SweepLedger | None = None,
    ) -> None:
        """A ledger of a run.

        Args:
            transcript: of the run.
            price: of each model that the run may ask, at most; None: no dollars are counted.
            caps: of the run.
            prices: by model, where there are several.
            sweep: the ledger of the run's sweep; None: it has no caps.
        """
        self.transcript, self.price, self.caps = transcript, price, caps
        self.prices, self.sweep = prices or {}, sweep

    def usd(self, usage: Usage, model: str) -> float | None:
        """US dollars for the tokens of an answer; None: an unknown price."""
        price = self.prices.get(model, self.price)
        return None if price is None else cost(usage, price)

    def reserve(self, next_at_most: Usage, waited: float = 0.0) -> str:
        """Reserve a request in the sweep's ledger unless it could pass a cap; see `over`."""
        why = self.over(next_at_most, waited)
        if why or self.sweep is None:
            return why
        return self.sweep.reserve(Bill.at_most(1, next_at_most, self.price))

    def settle(self, attempt: Attempt, reserved: Usage) -> None:
        """Replace a reservation in the sweep's ledger by what the attempt took, where known."""
        if self.sweep is None or attempt.usage is None:
            return
        usage = attempt.usage
        taken = Bill(int(is_sent(attempt)), usage.read, usage.output, attempt.usd)
        self.sweep.add(taken + -Bill.at_most(1, reserved, self.price))

    def over(self, next_at_most: Usage, waited: float = 0.0) -> str:
        """Which cap another request could pass, in words; "" for none.

        `waited` are the seconds before it that stand in no attempt yet.
        """
        for name, (found, cap) in self._after(1, next_at_most).items():
            if cap is not None and found > cap:
                return f"another request could pass the cap {name}={cap}"
        if self.seconds_left() <= waited:
            return f"the cap seconds={self.caps.seconds:g} is reached"
        return ""

    def seconds_left(self) -> float:
        """Until the cap on seconds is reached, >= 0; infinite without one.

        Waiting counts also where a cap ended it. A request without an outcome counts as all the
        seconds that it can take.
        """
        if self.caps.seconds is None:
            return math.inf
        _, lost = self.transcript.taken()
        spent = sum(a.seconds + a.waited for a in list(self.transcript.attempts))
        return max(0.0, self.caps.seconds - spent - sum(s.seconds for s in lost))

    def room_for(self, requests: int, at_most: Usage, *, seconds: float) -> bool:
        """Whether so much more keeps every cap, in whatever order it comes."""
        bill = Bill.at_most(requests, at_most, self.price)
        if self.sweep is not None and self.sweep.over(bill):
            return False
        return seconds <= self.seconds_left() and all(
            cap is None or found <= cap for found, cap in self._after(requests, at_most).values()
        )

    def _after(self, requests: int, at_most: Usage) -> dict[str, tuple[float, float | None]]:
        """What would be used after so much more, and the caps."""
        return (self.most() + Bill.at_most(requests, at_most, self.price)).against(self.caps)

    def most(self) -> Bill:
        """The most that all requests so far may have taken."""
        made, lost = self.transcript.taken()
        sent = [a for a in made if is_sent(a)]
        known = [
            Bill(1, a.usage.read, a.usage.output, self.usd(a.usage, a.request.model))
            for a in sent
            if a.usage is not None
        ]
        unknown = [a.at_most for a in sent if a.usage is None] + [s.at_most for s in lost]
        bills = (*known, *(Bill.at_most(1, usage, self.price) for usage in unknown))
        return sum(bills, Bill.of(0, Usage(), self.price))

    def totals(self) -> dict[str, float]:
        """Sums from the run's start by name, for the costs of a generation and for MLflow."""
        made, under_way = self.transcript.taken()
        attempts, lost = [a for a in made if is_sent(a)], len(under_way)
        parts = list(self.transcript.parts)
        usages = [a.usage for a in attempts if a.usage is not None]
        failures = Counter(a.answer.kind for a in made if isinstance(a.answer, Failure))
        rejected = Counter(stage for part in parts for stage in part.rejected)
        found: dict[str, float] = {
            "requests": len(attempts) + lost,
            "calls": len({a.call for a in attempts}),
            "input_tokens": sum(u.input for u in usages),
            "output_tokens": sum(u.output for u in usages),
            "cache_read_tokens": sum(u.cache_read for u in usages),
            "cache_write_tokens": sum(u.cache_write for u in usages),
            "latency_s": sum(a.seconds for a in made),
            "waited_s": sum(a.waited for a in made),
            "uncounted_requests": len(attempts) + lost - len(usages),
            "failures": failures.total(),
            "rejections": rejected.total(),
            "repaired": sum("repaired" in part.source for part in parts),
            "fallback_rates": sum(p.source == "fallback" and p.part == "rate" for p in parts),
            "fallback_trees": sum(p.source == "fallback" and p.part == "tree" for p in parts),
        }
        played = list(self.transcript.played)
        if played:
            found["episodes"] = sum(p.episodes for p in played)
        if trials := [p for p in played if p.purpose == "trial"]:
            found["trials"] = len(trials)
            found["trial_gain"] = sum(p.gain for p in trials)
        if (most := self.most().usd) is not None:
            found["cost_usd"] = sum(a.usd or 0.0 for a in attempts)
            found["cost_usd_at_most"] = most
        found |= {f"failures_{kind}": count for kind, count in sorted(failures.items())}
        found |= {f"rejected_{stage}": count for stage, count in sorted(rejected.items())}
        return found


class SweepLedger:
    """What all runs in a folder took together, as lines of changes in `spending.jsonl`.

    A request is reserved at its most before it is sent, and settled after its answer, so that a
    killed process leaves its reservation. A lock of the file keeps processes apart.
    """

    def __init__(self, folder: Path, price: Price | None, caps: SweepCaps) -> None:
        """Count the transcripts in the folder's runs, if the file is missing."""
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
        """Which cap a bill could pass, in words; "" for none."""
        with self._lock:
            return self._over(bill)

    def reserve(self, bill: Bill) -> str:
        """Write down a bill before its request is sent, unless it could pass a cap: see `over`."""
        with self._lock:
            if not (why := self._over(bill)):
                self._write(bill)
        return why

    def add(self, change: Bill) -> None:
        """Write down a change of what was reserved."""
        with self._lock:
            self._write(change)

    def _over(self, bill: Bill) -> str:
        with self.path.open("rb") as file:
            file.seek(self._read)
            new = file.read()
        end = new.rfind(b"\n") + 1
        for line in new[:end].splitlines():
            with suppress(*DECODE_ERRORS):  # a line that a kill cut off reserved nothing
                self._total += Bill(**read_json(line))
        self._read += end
        for name, (found, cap) in (self._total + bill).against(self.caps).items():
            if cap is not None and found > cap:
                return f"another request could pass the cap sweep_caps.{name}={cap}"
        return ""

    def _write(self, bill: Bill) -> None:
        line = json.dumps(asdict(replace(bill, usd=bill.usd or 0.0))).encode()
        with self.path.open("ab") as file:
            file.write(b"\n" + line + b"\n")  # a line that was cut off before ends here
            file.flush()
            os.fsync(file.fileno())


def recorded_requests(folder: Path) -> int:
    """The requests that the costs of a run's generations count; 0 where there are none yet."""
    try:
        lines = (folder / "costs.jsonl").read_bytes().splitlines()
    except FileNotFoundError:
        return 0
    found = 0
    for line in lines:
        with suppress(*DECODE_ERRORS):  # a damaged line is told where records are read
            found = max(found, int(read_json(line)["llm"].get("requests", 0)))
    return found


def is_sent(attempt: Attempt) -> bool:
    """Whether something was sent to the server: not where the connection was refused."""
    return isinstance(attempt.answer, Reply) or attempt.answer.kind not in UNSENT
