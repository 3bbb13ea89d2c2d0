"""The transcript: one line for every attempt of a run, written before its answer is used.

Resumed runs and replays read answers from it, and the ledger sums up its tokens. The lines are
JSON objects. The field `line` is the kind of a line, the other fields are those of its class in
KINDS.
"""

from __future__ import annotations

import json
import os
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, TypeVar

from islandgp.errors import SupervisionError
from islandgp.gate import read_bytes
from islandgp.plain import DECODE_ERRORS, from_json, read_json
from islandgp.supervision.llm.message import CHARGED, Failure, FailureKind, Reply, Request, Usage

E = TypeVar("E")

NAME: Final = "transcript.jsonl"
REASON: Final = 600  # most characters of a fallback's reason in the record
MAX_SHOWN: Final = 500  # most characters of an answer in a description of all of them


@dataclass(frozen=True, slots=True)
class Start:
    """The beginning of a run."""

    settings: dict[str, Any]  # of the supervisor


@dataclass(frozen=True, slots=True)
class Call:
    """The place of a call in a run."""

    generation: int  # of the state in the request; -1 for the probe
    part: str  # "rate", "tree", "edits" or "probe"
    turn: int  # 0: the question, 1 and up: repairs

    def __str__(self) -> str:
        turn = f", repair {self.turn}" if self.turn else ""
        return f"{self.part} after generation {self.generation}{turn}"


@dataclass(frozen=True, slots=True)
class Sent:
    """An attempt that is about to be made; without an `Attempt` its outcome is unknown."""

    call: Call
    number: int  # from 1
    at_most: Usage  # upper bound of its tokens
    seconds: float  # upper bound, including the wait before it


@dataclass(frozen=True, slots=True)
class Attempt:
    """One attempt at a call."""

    call: Call
    number: int  # from 1
    request: Request
    answer: Reply | Failure
    usd: float | None  # of `usage`; None: unknown tokens or an unknown price
    seconds: float  # until the answer
    waited: float  # s before the attempt
    at: str  # ISO time of the start

    @property
    def usage(self) -> Usage | None:
        """The tokens; None if unknown, for a lost answer or a server without counts.

        Rejected requests are not charged.
        """
        if isinstance(self.answer, Reply):
            return self.answer.usage
        return None if self.answer.kind in CHARGED else Usage()

    @property
    def at_most(self) -> Usage:
        """Upper bound of the tokens."""
        return self.request.most_tokens() if self.usage is None else self.usage

    @property
    def failed(self) -> FailureKind | None:
        """The kind of the failure; None: there is a reply."""
        return self.answer.kind if isinstance(self.answer, Failure) else None


@dataclass(frozen=True, slots=True)
class Conclusion:
    """The result for one part of the guidance of a generation."""

    generation: int
    part: str
    source: str  # "llm", "llm, repaired", "fallback", ...
    why: str  # reason of a fallback, else ""
    rejected: tuple[str, ...]  # stages of the validation that rejected an answer, in order
    failed: str = ""  # kind of the failure that ended it, else ""

    @property
    def notes(self) -> dict[str, str]:
        """The entries of the guidance's record, by name."""
        why = f": {self.why[:REASON]}" if self.why else ""
        rejected = {f"{self.part}_rejected": " ".join(self.rejected)} if self.rejected else {}
        return {self.part: self.source + why, **rejected}


Entry = Start | Sent | Attempt | Conclusion

KINDS: Final[Mapping[str, type[Entry]]] = {
    "start": Start,
    "sent": Sent,
    "attempt": Attempt,
    "part": Conclusion,
}
_NAMES: Final = {kind: name for name, kind in KINDS.items()}


def read_entries(content: bytes, path: Path) -> Iterator[Entry]:
    """The entries of a transcript's lines. Raises SupervisionError for a damaged line."""
    for number, raw in enumerate(content.splitlines(), 1):
        try:
            values = read_json(raw)
            yield from_json(KINDS[values.pop("line")], values)
        except DECODE_ERRORS as error:
            raise SupervisionError(
                f"Expected {path} as it was written, found line {number} damaged"
                f" ({type(error).__name__}: {error}); restore the original, or start the run again"
                " with resume=never."
            ) from None


class Transcript:
    """A transcript, in memory and in a file to which lines are appended."""

    def __init__(self, path: Path | None, *, fixed: bool = False) -> None:
        """Reads the file; an incomplete last line of a killed process is dropped.

        Args:
            path: of the file; None: in memory only.
            fixed: True: nothing is added to it, as by a replay or after the run's end.

        Raises:
            SupervisionError: the file is not a transcript, or is damaged.
        """
        self.path, self.fixed = path, fixed
        self._entries: list[Entry] = []
        self._torn: int | None = None  # bytes of complete lines, if an incomplete one follows
        if path is not None and path.exists():
            content = read_bytes(path)
            size = content.rfind(b"\n") + 1
            self._torn = size if size < len(content) else None
            self._entries += read_entries(content[:size], path)

    def of_kind(self, kind: type[E]) -> list[E]:
        """The entries of a class, in order."""
        return [entry for entry in list(self._entries) if isinstance(entry, kind)]

    @property
    def start(self) -> Start | None:
        """The first line; None before it is written."""
        return next(iter(self.of_kind(Start)), None)

    @property
    def attempts(self) -> list[Attempt]:
        """All attempts, in order."""
        return self.of_kind(Attempt)

    @property
    def parts(self) -> list[Conclusion]:
        """The results of all questions, in order."""
        return self.of_kind(Conclusion)

    def of(self, call: Call) -> list[Attempt]:
        """The attempts at a call, in order."""
        return [a for a in self.attempts if a.call == call]

    def unanswered(self) -> list[Sent]:
        """The requests without an outcome: the next entry is not their attempt."""
        kinds = (Sent, Attempt)
        entries = [entry for entry in self.of_kind(object) if isinstance(entry, kinds)]
        return [
            sent
            for sent, after in pairwise([*entries, None])
            if isinstance(sent, Sent)
            and (not isinstance(after, Attempt) or after.failed is FailureKind.BUDGET)
        ]

    def add(self, entry: Entry) -> None:
        """Writes an entry to the file before it returns.

        A conclusion, or another entry that is written once, is not added again.
        """
        repeated = not isinstance(entry, Sent | Attempt) and entry in self._entries
        if self.fixed or repeated:
            return
        self._entries.append(entry)
        self._write({"line": _NAMES[type(entry)], **asdict(entry)})

    def _write(self, line: Mapping[str, Any]) -> None:
        if (path := self.path) is None:
            return
        data = json.dumps(line, ensure_ascii=False, allow_nan=False).encode() + b"\n"
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("ab") as file:
            if self._torn is not None:
                file.truncate(self._torn)
            self._torn = file.seek(0, os.SEEK_END)  # a failed write may leave an incomplete line
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        self._torn = None


def find_transcript(place: Path) -> Path:
    """The transcript in a run's folder, or the file itself.

    Raises:
        SupervisionError: there is none.
    """
    path = place / NAME if place.is_dir() else place
    if not path.is_file():
        raise SupervisionError(
            f"Expected a run's folder with a {NAME}, or such a file, found nothing at {path};"
            " a run with supervisor=llm writes one to its folder."
        )
    return path


def describe(transcript: Transcript, generation: int | None) -> Iterator[str]:
    """Texts of the attempts and results of a transcript, in order.

    Of one generation the whole prompts and replies are shown, -1 being the probe; of all of them
    (None) the beginnings of the replies.
    """
    for entry in transcript.of_kind(object):
        if isinstance(entry, Attempt) and generation in (None, entry.call.generation):
            yield _attempt(entry, whole=generation is not None)
        if isinstance(entry, Conclusion) and generation in (None, entry.generation):
            yield f"  {entry.part}: {entry.source}" + f": {entry.why}" * bool(entry.why)
    for request in transcript.unanswered():
        yield f"{request.call}: sent, no answer is recorded"


def _attempt(a: Attempt, *, whole: bool) -> str:
    """An attempt: model, tokens, dollars, seconds, and its answer; `whole`: with the prompts."""
    usage, usd = a.usage, a.usd
    tokens = f"{usage.read:,} tokens in, {usage.output:,} out" if usage else "unknown tokens"
    dollars = "unknown dollars" if usd is None else f"{usd:.4f} dollars"
    head = (
        f"{a.call}, attempt {a.number}: {a.request.model}, {tokens}, {dollars}, {a.seconds:.1f} s"
    )
    if isinstance(a.answer, Failure):
        answer = [f"failed: {a.answer.kind}: {a.answer.message}"]
    else:
        text, stop = a.answer.text, a.answer.stop_reason or "unknown"
        cut = text if whole or len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}..."
        answer = [f"thinking:\n{a.answer.thinking}"] * bool(whole and a.answer.thinking)
        answer += [*[f"stop reason: {stop}"] * (stop != "end_turn"), cut]
    parts = [*((a.request.system, *a.request.turns) if whole else ()), *answer]
    texts = [part.strip() for part in parts]
    return head + "".join(f"\n{textwrap.indent(text, '  ')}" for text in texts if text)
