"""The transcript: what is written is there after a kill, and reads back as it was."""

from __future__ import annotations

import json
from dataclasses import replace
from errno import ENOSPC
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.errors import SupervisionError
from islandgp.supervision.llm.calls import Calls
from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request, Usage, clean
from islandgp.supervision.llm.transcript import NAME, Attempt, Call, Conclusion, Start, Transcript
from tests.llm.samples import settings
from tests.profiles import cases

ASK = Request("m", "system text", ("question",), 100, 0.7, {"type": "object"})


def attempt(
    generation: int = 3, number: int = 1, request: Request = ASK, answer: object = None
) -> Attempt:
    reply = answer or Reply("text\nof two lines, « é »", "end_turn", Usage(1, 2, 3, 4))
    assert isinstance(reply, (Reply, Failure))
    return Attempt(Call(generation, "rate", 0), number, request, reply, 0.5, 1.5, 0.2, "at")


def recorded(transcript: Transcript) -> Calls:
    """The calls of a replay."""
    transcript.fixed = True
    return Calls(None, transcript, settings(), seed=0)


START = Start({"model": "m"})
FAILED = attempt(number=2, answer=Failure(FailureKind.TIMEOUT, "late", 3.5))


def test_a_transcript_is_read_as_it_was_written(tmp_path: Path) -> None:
    """Attempts, parts and the start are the same after reading, in their order."""
    path = tmp_path / "run" / NAME
    transcript = Transcript(path)
    transcript.add(START)
    parts = [Conclusion(3, "rate", "fallback", "timeout: late", ("json", "range"))]
    for each in (attempt(), FAILED, attempt(4, request=ASK.followed_by("a", "b"))):
        transcript.add(each)
    transcript.add(parts[0])
    read = Transcript(path)
    assert read.attempts == transcript.attempts
    assert read.parts == parts
    assert read.start == START


def test_every_torn_end_is_survived(tmp_path: Path) -> None:
    """Killed at any byte, the transcript holds the whole lines, and goes on behind them."""
    complete = Transcript(tmp_path / "whole")
    complete.add(START)
    complete.add(attempt())
    size_before = (tmp_path / "whole").stat().st_size
    complete.add(FAILED)
    data = (tmp_path / "whole").read_bytes()
    step = max(1, 300 // cases(300))  # at night each byte
    for cut in range(size_before, len(data), step):
        path = tmp_path / "cut"
        path.write_bytes(data[:cut])
        torn = Transcript(path)
        assert torn.attempts == [attempt()]
        torn.add(FAILED)
        assert path.read_bytes() == data


def test_reading_changes_nothing(tmp_path: Path) -> None:
    """A replay may read the transcript of a run that is just being written."""
    path = tmp_path / NAME
    path.write_bytes(b'{"line": "start", "settings": {}}\n{"line": "atte')
    Transcript(path)
    assert path.read_bytes().endswith(b"atte")


@pytest.mark.parametrize(
    "data", [b"not json\n", b'{"no": "line"}\n', b'{"line": "attempt"}\n', b"[1]\n", b"\xff\n"]
)
def test_a_damaged_transcript_is_refused(tmp_path: Path, data: bytes) -> None:
    """Not a traceback but the file's name and a remedy."""
    (tmp_path / NAME).write_bytes(data)
    with pytest.raises(SupervisionError, match="damaged"):
        Transcript(tmp_path / NAME)


def test_a_write_that_fails_leaves_no_piece_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a full disk a part of a line may be written; the next line takes its place."""
    transcript = Transcript(tmp_path / NAME)
    transcript.add(attempt())
    content = (tmp_path / NAME).read_bytes()

    def full(number: int) -> None:  # noqa: ARG001 -- os.fsync's
        raise OSError(ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("os.fsync", full)
        with pytest.raises(OSError, match="No space"):
            transcript.add(FAILED)
    transcript.add(Conclusion(3, "rate", "llm", "", ()))
    after = (tmp_path / NAME).read_bytes()
    assert after.startswith(content)
    assert after[len(content) :].count(b"\n") == 1
    assert Transcript(tmp_path / NAME).attempts == [attempt()]


def test_a_recorded_call_is_answered_with_its_last_attempt() -> None:
    """The answer that the run went on with is the answer again."""
    transcript = Transcript(None)
    transcript.add(FAILED)
    transcript.add(attempt(number=3))
    assert recorded(transcript).ask(Call(3, "rate", 0), ASK) == attempt().answer


def test_a_call_that_was_not_recorded_is_an_error() -> None:
    """The error names the call."""
    with pytest.raises(SupervisionError, match="the rate after generation 5, repair 1, found none"):
        recorded(Transcript(None)).ask(Call(5, "rate", 1), ASK)


def test_a_request_that_differs_is_an_error_that_shows_where() -> None:
    """Its first line that differs, the recorded one first."""
    transcript = Transcript(None)
    transcript.add(attempt(request=replace(ASK, turns=('{"best": 1,\n"mean": 2}',))))
    now = replace(ASK, turns=('{"best": 1,\n"mean": 3}',), temperature=0.2)
    with pytest.raises(SupervisionError) as excinfo:
        recorded(transcript).ask(Call(3, "rate", 0), now)
    lines = str(excinfo.value).splitlines()
    assert "rate after generation 3" in lines[0]
    assert lines[1:3] == ["-temperature: 0.7", "+temperature: 0.2"]


def test_digests_tell_requests_apart() -> None:
    """Any part of a request changes its digest."""
    others = [
        replace(ASK, model="n"),
        replace(ASK, system="x"),
        replace(ASK, turns=("question", "", "x")),
        replace(ASK, max_tokens=99),
        replace(ASK, temperature=None),
        replace(ASK, schema=None),
    ]
    assert len({r.digest for r in [ASK, *others]}) == len(others) + 1


@given(st.text() | st.text(st.characters(categories=["Cs", "Cc", "Cf", "Zl"])))
def test_any_text_can_be_stored_once_it_is_clean(text: str) -> None:
    """What leaves the seam survives JSON, UTF-8 and a terminal."""
    cleaned = clean(text)
    assert json.loads(json.dumps(cleaned, ensure_ascii=False).encode()) == cleaned
    assert all(c.isprintable() or c in "\n\t" for c in cleaned)
    assert clean(cleaned) == cleaned
