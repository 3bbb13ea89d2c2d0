"""Caps of a whole sweep: no number of runs, processes or kills passes them."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from math import nan
from pathlib import Path

import pytest

from islandgp.supervision.llm.ledger import Bill, SweepLedger
from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request
from islandgp.supervision.llm.settings import SweepCaps
from tests.llm.samples import USAGE, advise, answering, context, failed, state, supervisor

CAP = "sweep_caps.requests=5"


class Killed(BaseException):
    """Ends a test's process, as SIGKILL would."""


def test_runs_share_the_cap_of_their_sweep(tmp_path: Path) -> None:
    """Two runs that take turns: five requests of both together, and the fallback after them."""
    runs = [supervisor(answering(), CAP, folder=tmp_path / name) for name in "ab"]
    notes = [advise(llm, state(g)).notes for g in range(3) for llm, _ in runs]
    assert sum(len(client.requests) for _, client in runs) == 5
    assert "another request could pass the cap sweep_caps.requests=5" in notes[-1]["rate"]
    assert all(llm.spent()["requests"] <= 5 for llm, _ in runs)


@pytest.mark.parametrize("cap", ["requests=5", "output_tokens=9000"])
def test_no_number_of_kills_passes_the_cap_of_a_sweep(tmp_path: Path, cap: str) -> None:
    """Each of ten processes in two runs is killed while it waits for its second answer."""
    requests, lost_requests = [], []

    def script(request: Request, n: int) -> Reply | Failure:
        requests.append(request)
        if n:
            lost_requests.append(request)
            raise Killed
        return answering()(request, n)

    for process in range(10):
        folder = tmp_path / "ab"[process % 2]
        run_context = replace(context(folder), adapt_mutation=False)
        llm, _ = supervisor(script, f"sweep_caps.{cap}", run_context=run_context)
        with suppress(Killed):
            advise(llm, state(process // 2))
    charged = 2048 * len(lost_requests) + USAGE.output * (len(requests) - len(lost_requests))
    assert len(lost_requests) >= 2
    assert len(requests) == 5 if cap == "requests=5" else charged <= 9000


def test_a_refused_connection_takes_nothing(tmp_path: Path) -> None:
    """What was reserved for it is given back; a deleted file is counted again."""
    caps = "retry.attempts=1", "sweep_caps.usd=1"
    unreachable = failed(FailureKind.UNREACHABLE)
    llm, _ = supervisor(answering(rate=unreachable), *caps, folder=tmp_path / "a")
    advise(llm, state(0))
    assert llm._calls is not None
    ledger = SweepLedger(tmp_path, llm.settings.price, llm.settings.sweep_caps)
    assert ledger.over(Bill(0, 0, 0, 0)) == ""
    total = ledger._total
    assert total.requests == 2  # the probe and the question for a tree
    assert total.usd == pytest.approx(llm.spent()["cost_usd"])
    ledger.path.unlink()
    recounted = SweepLedger(tmp_path, llm.settings.price, llm.settings.sweep_caps)
    assert recounted.over(Bill(0, 0, 0, 0)) == ""
    assert recounted._total.requests == 2
    assert recounted._total.usd == pytest.approx(total.usd)


def test_a_line_that_was_cut_off_does_not_hide_the_next(tmp_path: Path) -> None:
    """A kill in the middle of a reservation: its request was not sent."""
    caps = SweepCaps(requests=3)
    SweepLedger(tmp_path, None, caps).add(Bill(2, 10, 10, nan))
    with (tmp_path / "spending.jsonl").open("ab") as file:
        file.write(b'{"requests": 7, "inp')
    ledger = SweepLedger(tmp_path, None, caps)
    assert ledger.reserve(Bill(1, 10, 10, nan)) == ""
    assert "sweep_caps.requests=3" in ledger.reserve(Bill(1, 10, 10, nan))
