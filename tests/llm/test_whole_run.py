"""Whole runs over a real socket with the real SDK: faulty, repeated, interrupted, lagged."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from islandgp.errors import SupervisionError
from islandgp.evolution.loop import evolve
from islandgp.gp.record import GenerationRecord, RunState, Step
from islandgp.records.files import dump
from islandgp.running.parts import make_supervisor, run_context
from islandgp.supervision.llm.questions import Questions
from islandgp.supervision.replay import Replay
from tests.composed import composed
from tests.evolution.fake import Fake
from tests.llm.faults import HOPELESS, Fault, every, no_faults
from tests.llm.samples import settings as llm_settings
from tests.llm.server import MessagesServer
from tests.profiles import sweep

NIGHTLY = pytest.mark.slow
QUICK = (
    "gp.population=12",
    "supervisor.policy.retry.deadline=0.25",
    "supervisor.policy.retry.first_wait=0.01",
)


def steps_of(
    supervisor: str,
    folder: Path,
    *overrides: str,
    seed: int = 3,
    start: RunState | None = None,
    stop: int | None = None,
    past: Sequence[GenerationRecord] = (),
    **policy: str,
) -> list[Step]:
    """The steps of a run in a folder, up to generation `stop` where that is given.

    `policy` are settings of the supervisor that differ from call to call: they are not composed.
    """
    quick = QUICK if supervisor == "llm" else QUICK[:1]
    settings = composed(f"supervisor={supervisor}", *quick, *overrides)
    part = settings.supervisor.model_copy(
        update={"policy": {**settings.supervisor.policy, **policy}}
    )
    settings = settings.model_copy(update={"supervisor": part, "seed": seed})
    instance = make_supervisor(settings, folder)
    steps = []
    with closing(
        evolve(
            settings.plan(settings.make_domain()), seed, instance, Fake(), start=start, past=past
        )
    ) as run:
        for step in run:
            steps.append(step)
            if step.record.snapshot.generation == stop:
                break
    return steps


def live(server: MessagesServer, folder: Path, *overrides: str, **options: object) -> list[Step]:
    """The same with supervisor=llm against a server."""
    return steps_of("llm", folder, *overrides, base_url=server.url, **options)  # type: ignore[arg-type]


def lines(steps: Sequence[Step]) -> list[bytes]:
    """The records as they are on disk."""
    return [dump(asdict(step.record)).encode() for step in steps]


def replayed(record: Path, folder: Path, *overrides: str, seed: int = 3) -> list[Step]:
    return steps_of("replay", folder, *overrides, seed=seed, transcript=str(record))


@pytest.mark.slow
def test_a_run_with_a_fault_in_every_third_answer(tmp_path: Path) -> None:
    """41 generations, each with the source of its guidance, and a replay that is the same.

    Every fault that a later request heals comes up at least once.
    """
    healing = [fault for fault in Fault if fault not in HOPELESS]
    with MessagesServer(every(3, healing)) as server:
        steps = live(server, tmp_path / "live", "supervisor.policy.retry.attempts=2")
        count = len(server.requests)
    assert len(steps) == 41
    answers = [step.record.guidance for step in steps[:-1]]
    all_sources = [g.source for g in answers if g is not None]
    assert {"llm", "llm and fallback"} <= set(all_sources)
    for g in answers:
        assert g is not None
        by_model = [not g.notes[part].startswith("fallback: ") for part in ("rate", "tree")]
        assert g.source == {2: "llm", 1: "llm and fallback", 0: "fallback"}[sum(by_model)]
        assert 0.1 <= g.applied_rate <= 0.5
        assert g.tree is not None
    assert count // 3 >= len(healing)
    spent = steps[-1].cost.llm
    assert spent["requests"] >= count  # on a busy machine one may run out of time on its way
    assert spent["failures"] > 10
    assert spent["rejections"] > 3
    assert spent["repaired"] >= 1
    text = (tmp_path / "live" / "transcript.jsonl").read_text(encoding="utf-8")
    assert text.count('"line": "attempt"') == spent["requests"]
    assert lines(replayed(tmp_path / "live", tmp_path / "again")) == lines(steps)
    assert not (tmp_path / "again" / "transcript.jsonl").exists()
    assert [g.phase for g in answers if g is not None].count("early_exploration") > 0


QUICKLY = (Fault.UNAUTHORISED, Fault.TOO_LONG, Fault.EMPTY, Fault.SLIPS)


@pytest.mark.parametrize(
    "fault", [f if f in QUICKLY else pytest.param(f, marks=NIGHTLY) for f in Fault]
)
def test_a_run_of_one_fault_ends_and_hides_the_key(
    tmp_path: Path, fault: Fault, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of 28 kinds, in all answers but the probe's: no hang, a record, and no key in a file.

    What no later request heals is asked once, and told in one line.
    """
    assert len(Fault) == 28
    key = "sk-ant-test-0123456789abcdefXYZ"
    monkeypatch.setenv("ANTHROPIC_API_KEY", key)
    short = ("gp.generations=4", "supervisor.policy.retry.attempts=2")
    with MessagesServer(lambda n: fault if n else None) as server:
        began = time.monotonic()
        steps = live(server, tmp_path, *short)
        assert time.monotonic() - began < 15
        assert {sent.removeprefix("Bearer ") for sent in server.keys} == {key}
        count = len(server.requests)
    assert len(steps) == 4
    files = [file for file in tmp_path.rglob("*") if file.is_file()]
    assert files
    assert not any(key[7:23].encode() in file.read_bytes() for file in files)
    told = [r.message for r in caplog.records if "continues with the fallback" in r.message]
    if fault in HOPELESS:
        assert count == 1 + 1
        (line,) = told
        assert re.search("status 4.*(invalid key|balance|too long|no-such-model)", line)
    healthy = {Fault.SLIPS, Fault.INJECTION, Fault.SURROGATES}
    sources = {g.source for step in steps[:-1] if (g := step.record.guidance) is not None}
    assert (sources == {"llm"}) == (fault in healthy)


@pytest.mark.parametrize(
    "fault",
    [Fault.CUT, *(pytest.param(f, marks=NIGHTLY) for f in (Fault.DRIP, Fault.TRUNCATED))],
)
def test_answers_that_never_arrive_whole_are_not_paid_to_the_end(
    tmp_path: Path, fault: Fault
) -> None:
    """A server that answers the probe and no question: ten are asked, three times each."""
    with MessagesServer(lambda n: fault if n else None) as server:
        steps = live(server, tmp_path / "live", "gp.generations=7")
        assert len(server.requests) == 1 + 10 * 3
    last = steps[-2].record.guidance
    assert last is not None
    assert "useless: no usable answer to 10 questions in a row (the last: " in last.notes["rate"]
    setting = "raise supervisor.policy.retry.deadline"
    assert (setting in last.notes["rate"]) == (fault is Fault.DRIP)
    replay = replayed(tmp_path / "live", tmp_path / "again", "gp.generations=7")
    assert lines(replay) == lines(steps)


@pytest.mark.parametrize("stop", [1, *(pytest.param(at, marks=NIGHTLY) for at in (0, 4))])
def test_a_resumed_run_asks_nothing_twice(tmp_path: Path, stop: int) -> None:
    """Stopped after any generation and gone on, the records and the requests are the same."""
    caps = "supervisor.policy.caps.requests=14"
    patient = "supervisor.policy.retry.deadline=5"  # no answer is late, however busy the machine
    overrides = ("gp.generations=8", patient, caps)
    with MessagesServer() as server:
        complete = live(server, tmp_path / "whole", *overrides)
        straight = list(server.requests)
    with MessagesServer() as server:
        first = live(server, tmp_path / "cut", *overrides, stop=stop)
        rest = live(server, tmp_path / "cut", *overrides, start=first[-1].state)
        assert lines(first) + lines(rest) == lines(complete)
        assert not Counter(map(dump, server.requests)) - Counter(map(dump, straight))
    assert lines(replayed(tmp_path / "cut", tmp_path / "again", *overrides[:1])) == lines(complete)


@sweep(
    ("search", "parts"),
    [("paper", {"rate", "tree"}), ("racing", {"tree"}), ("random", set())],
    quick=2,
)
def test_the_model_is_asked_for_what_the_search_uses(search: str, parts: set[str]) -> None:
    """Nothing is asked that the search does not take; where that is all, no run starts."""
    context = run_context(composed("supervisor=llm", f"search={search}", *QUICK))
    if not parts:
        with pytest.raises(SupervisionError, match="nothing to ask the model for"):
            Questions(llm_settings(), context)
    else:
        assert set(Questions(llm_settings(), context).parts) == parts


def test_a_replay_of_something_else_shows_the_difference(tmp_path: Path) -> None:
    """Another seed has another population: the error shows where the first request differs."""
    with MessagesServer() as server:
        live(server, tmp_path / "live", "gp.generations=3")
    with pytest.raises(SupervisionError) as excinfo:
        replayed(tmp_path / "live", tmp_path / "again", "gp.generations=3", seed=4)
    text = str(excinfo.value)
    assert "rate after generation 0" in text
    assert '- "fitness_max": ' in text
    assert '+ "fitness_max": ' in text


def test_a_replay_that_goes_further_than_its_record_is_refused(tmp_path: Path) -> None:
    """The recorded run ended before: the error names the first answer that lacks."""
    with MessagesServer() as server:
        live(server, tmp_path / "live", "gp.generations=4", stop=1)
    with pytest.raises(SupervisionError, match="rate after generation 2, found none"):
        replayed(tmp_path / "live", tmp_path / "again", "gp.generations=4")


def test_a_replay_is_of_the_recorded_settings(tmp_path: Path) -> None:
    """Model, limits and fallback come from the record, not from today's configuration."""
    overrides = (
        "gp.generations=3",
        "supervisor.policy.model=m",
        "supervisor.policy.rates=[0.1, 0.46]",
    )
    with MessagesServer(every(2, [Fault.OUT_OF_RANGE])) as server:
        steps = live(server, tmp_path / "live", *overrides)
    replay = replayed(tmp_path / "live", tmp_path / "again", "gp.generations=3")
    assert lines(replay) == lines(steps)


@pytest.mark.parametrize(
    "start", [b"", b'{"line": "start", "settings": {}, "capabilities": null}\n']
)
def test_a_record_without_its_start_is_refused(tmp_path: Path, start: bytes) -> None:
    """A transcript without its settings cannot be replayed."""
    (tmp_path / "transcript.jsonl").write_bytes(start)
    settings = composed("supervisor=replay", f"supervisor.policy.transcript={tmp_path}")
    with pytest.raises(SupervisionError, match="settings of a recorded run"):
        make_supervisor(settings, None)


def test_a_replay_needs_a_record(tmp_path: Path) -> None:
    """Before anything starts the error names the missing one, and the key to set."""
    for value, message in (("null", "supervisor.policy.transcript=..."), (tmp_path, str(tmp_path))):
        settings = composed("supervisor=replay", f"supervisor.policy.transcript={value}")
        with pytest.raises(SupervisionError, match=message):
            Replay.check(settings.supervisor.settings(), run_context(settings))


def test_text_dialect_end_to_end(tmp_path: Path) -> None:
    """A server that knows no schemas and takes no temperature supervises just as well."""
    with MessagesServer(no_faults, structured=False, temperature=False) as server:
        steps = live(server, tmp_path, "gp.generations=4")
        last = server.requests[-1]
    assert {g.source for s in steps if (g := s.record.guidance) is not None} == {"llm"}
    assert "temperature" not in last


def test_the_loop_s_generator_is_not_the_network_s(tmp_path: Path) -> None:
    """Failed attempts draw their jitter elsewhere: a retried answer changes no other draw."""
    records = []
    for script in (no_faults, every(2, [Fault.RETRY_SOON])):
        with MessagesServer(script) as server:
            folder = tmp_path / str(len(records))
            overrides = ("gp.generations=4", "supervisor.policy.retry.attempts=5")
            records.append(lines(live(server, folder, *overrides)))
    assert records[0] == records[1]
    assert np.unique(records[0]).size == 4
