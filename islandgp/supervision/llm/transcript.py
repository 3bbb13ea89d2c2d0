"""The transcript: one line for every attempt of a run, written before its answer is used.

Resumed runs and replays read answers from it, and the ledger sums up its tokens. The lines are
JSON objects. The field `line` is the kind of a line, the other fields are those of its class in
KINDS, and `checksum` covers them all. The request of an attempt has the hash of its system prompt,
whose text is in a line of its own.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Final, TypeVar

from islandgp.errors import SupervisionError
from islandgp.gate import read_bytes
from islandgp.plain import DECODE_ERRORS, from_json, read_json
from islandgp.supervision.llm.message import (
    CHARGED,
    Failure,
    FailureKind,
    Reply,
    Request,
    ServerCapabilities,
    Usage,
    sha256_of,
)

E = TypeVar("E")

NAME: Final = "transcript.jsonl"
_SHARED: Final = ("system", "grammar")  # fields of requests whose texts are written once


@dataclass(frozen=True, slots=True)
class Start:
    """The beginning of a run."""

    settings: dict[str, Any]  # of the supervisor
    capabilities: ServerCapabilities | None  # None: the server did not answer yet


@dataclass(frozen=True, slots=True)
class Learnt:
    """The capabilities of a server that answered late."""

    generation: int  # the first in which they were known
    capabilities: ServerCapabilities


@dataclass(frozen=True, slots=True)
class SystemPrompt:
    """A system prompt or a grammar, before the first attempt that sends it."""

    sha256: str  # hexadecimal
    text: str


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
    seconds: float = 0.0  # upper bound, including the wait before it


@dataclass(frozen=True, slots=True)
class Attempt:
    """One attempt at a call."""

    call: Call
    number: int  # from 1
    request: Request
    answer: Reply | Failure
    usage: Usage | None  # tokens; None: unknown
    at_most: Usage  # upper bound of the tokens; `usage` if that is known
    usd: float | None  # of `usage`; None: unknown tokens or an unknown price
    seconds: float  # until the answer
    waited: float  # s before the attempt
    at: str  # ISO time of the start


@dataclass(frozen=True, slots=True)
class Conclusion:
    """The result for one part of the guidance of a generation."""

    generation: int
    part: str
    source: str  # "llm", "llm, repaired", "fallback", ...
    why: str  # reason of a fallback, else ""
    rejected: tuple[str, ...]  # stages of the validation that rejected an answer, in order
    failed: str = ""  # kind of the failure that ended it, else ""


@dataclass(frozen=True, slots=True)
class Played:
    """Episodes that were simulated for the descriptions in prompts."""

    generation: int
    episodes: int


Entry = Start | Learnt | SystemPrompt | Sent | Attempt | Conclusion | Played

KINDS: Final[Mapping[str, type[Entry]]] = {
    "start": Start,
    "learnt": Learnt,
    "system": SystemPrompt,
    "sent": Sent,
    "attempt": Attempt,
    "part": Conclusion,
    "played": Played,
}
_NAMES: Final = {kind: name for name, kind in KINDS.items()}


@dataclass(frozen=True, slots=True)
class TranscriptLine:
    """A line of a transcript file."""

    number: int  # from 1
    entry: Entry | None  # None: with a fault, or of an unknown kind
    fault: str = ""  # what is wrong with it, or ""


def read_lines(lines: Iterable[bytes]) -> Iterator[TranscriptLine]:
    """Reads each line; a damaged or changed one has a fault and does not end the iteration."""
    systems: dict[str, str] = {}
    for number, raw in enumerate(lines, 1):
        entry, fault = None, ""
        try:
            plain = read_json(raw)
            kind, checksum = plain.pop("line"), plain.pop("checksum", None)
            if checksum not in (None, sha256_of({"line": kind, **plain})):
                fault = "changed: its checksum differs"
            elif kind in KINDS:
                if kind == "attempt":
                    for name in _SHARED:
                        if digest := plain["request"].get(name):
                            plain["request"][name] = systems[digest]
                entry = from_json(KINDS[kind], plain)
                if isinstance(entry, SystemPrompt):
                    systems[entry.sha256] = entry.text
        except DECODE_ERRORS as error:
            fault = f"damaged: {type(error).__name__}: {error}"
        yield TranscriptLine(number, entry, fault)


class Transcript:
    """A transcript, in memory and in a file to which lines are appended."""

    def __init__(self, path: Path | None, *, fixed: bool = False) -> None:
        """Reads the file; an incomplete last line of a killed process is dropped.

        Args:
            path: of the file; None: in memory only.
            fixed: True: nothing is added to it.

        Raises:
            SupervisionError: the file is not a transcript, or was changed after it was written.
        """
        self.path, self.fixed = path, fixed
        self._entries: list[Entry] = []
        self._lock = Lock()  # the questions of a generation are asked in several threads
        self._whole: int | None = None  # bytes of complete lines, if an incomplete one follows
        if path is None or not path.exists():
            return
        content = read_bytes(path)
        complete = content[: content.rfind(b"\n") + 1]
        if complete != content:
            self._whole = len(complete)
        for line in read_lines(complete.splitlines()):
            if line.fault:
                raise SupervisionError(
                    f"Expected {path} as it was written, found line {line.number} {line.fault};"
                    " restore the original, or start the run again with resume=never."
                    " `islandgp transcript` shows the other lines; a line without the field"
                    " `checksum` is used as it is."
                )
            if line.entry is not None:
                self._entries.append(line.entry)

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

    @property
    def played(self) -> list[Played]:
        """The simulated episodes by generation."""
        return self.of_kind(Played)

    def of(self, call: Call) -> list[Attempt]:
        """The attempts at a call, in order."""
        return [a for a in self.attempts if a.call == call]

    def capabilities(self, generation: float) -> ServerCapabilities | None:
        """The server's capabilities in a generation; None if they were not known yet."""
        if self.start is not None and self.start.capabilities is not None:
            return self.start.capabilities
        known = [each for each in self.of_kind(Learnt) if each.generation <= generation]
        return known[0].capabilities if known else None

    def useless_before(self, generation: int) -> list[Conclusion]:
        """The last questions in a row before a generation without a usable answer.

        Rejected answers count, and failures that may be charged. Other failures are skipped.
        """
        useless: list[Conclusion] = []
        for part in sorted(self.parts, key=lambda part: (part.generation, part.part)):
            if part.generation < generation and part.source != "fallback":
                useless = []
            elif part.generation < generation and (part.rejected or part.failed in CHARGED):
                useless.append(part)
        return useless

    def requests(self) -> tuple[list[Attempt], list[Sent]]:
        """Attempts, and requests without an outcome, as one consistent pair.

        Attempts that a cap prevented are left out.
        """
        with self._lock:
            attempts = [a for a in self.attempts if not _is_refused_by_cap(a)]
            answered = Counter((a.call, a.number) for a in attempts)
            unanswered = []
            for request in reversed(self.of_kind(Sent)):  # of two the later has the outcome
                if answered[request.call, request.number]:
                    answered[request.call, request.number] -= 1
                else:
                    unanswered.append(request)
        return attempts, unanswered

    def add(self, entry: Entry) -> None:
        """Writes an entry to the file before it returns.

        A conclusion, or another entry that is written once, is not added again.
        """
        with self._lock:
            repeated = not isinstance(entry, Sent | Attempt) and entry in self._entries
            if self.fixed or repeated:
                return
            values = asdict(entry)
            if isinstance(entry, Attempt):
                values["request"] = entry.request.plain()
                for name in _SHARED:
                    if (text := getattr(entry.request, name)) is None:
                        continue
                    values["request"][name] = sha256_of(text)
                    if (shared := SystemPrompt(sha256_of(text), text)) not in self._entries:
                        self._entries.append(shared)
                        self._write({"line": "system", **asdict(shared)})
            self._entries.append(entry)
            self._write({"line": _NAMES[type(entry)], **values})

    def _write(self, line: Mapping[str, Any]) -> None:
        if self.path is None:
            return
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("ab") as file:
            if self._whole is not None:
                file.truncate(self._whole)
            self._whole = file.seek(0, os.SEEK_END)  # a failed write may leave an incomplete line
            record = {**line, "checksum": sha256_of(line)}
            file.write(json.dumps(record, ensure_ascii=False, allow_nan=False).encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
        self._whole = None


def _is_refused_by_cap(attempt: Attempt) -> bool:
    return isinstance(attempt.answer, Failure) and attempt.answer.kind is FailureKind.BUDGET


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
