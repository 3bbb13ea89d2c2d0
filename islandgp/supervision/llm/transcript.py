"""The transcript: one line for every attempt of a run, written before its answer is used.

Resumed runs and replays read answers from it, and the ledger sums up its tokens. The lines are
JSON objects; the field `line` is their kind:

start    settings and dialect (capabilities of the server); null: they are not known yet
dialect  the dialect, and the first generation in which it was known
system   a system prompt, once, with its hash
sent     an attempt is about to be made; without an attempt line its outcome is unknown
attempt  one attempt at a call: place, request, reply or failure, tokens, dollars, seconds
part     result for one part of the guidance: its source, and the stages that rejected answers
played   episodes that supervision simulated: generation, purpose, number

Each line has a `checksum` of its other fields; a line without one is used as it is.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Final

from islandgp.errors import SupervisionError
from islandgp.plain import DECODE_ERRORS, from_json, read_json
from islandgp.supervision.llm.message import (
    CHARGED,
    Failure,
    FailureKind,
    Reply,
    Request,
    Usage,
    sha256_of,
)


@dataclass(frozen=True, slots=True)
class Call:
    """The place of a call in a run."""

    generation: int  # of the state in the request; -1 for the probe
    part: str  # "rate", "tree" or "probe"
    turn: int  # 0: the question, 1 and up: repairs

    def __str__(self) -> str:
        turn = f", repair {self.turn}" if self.turn else ""
        return f"{self.part} after generation {self.generation}{turn}"


@dataclass(frozen=True, slots=True)
class Sent:
    """An attempt that is about to be made."""

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
    """Episodes that supervision simulated for the descriptions in prompts."""

    generation: int
    purpose: str  # "traces"
    episodes: int


def to_line(attempt: Attempt, system: str) -> dict[str, Any]:
    """An attempt as JSON values; `system` is the hash of its system prompt."""
    request = attempt.request.plain()
    answer = attempt.answer
    return {
        **asdict(attempt.call),
        "attempt": attempt.number,
        "at": attempt.at,
        "request": {**request, "system": system},
        "digest": attempt.request.digest,
        "prompt": attempt.request.prompt_digest,
        "reply": asdict(answer) if isinstance(answer, Reply) else None,
        "failure": asdict(answer) if isinstance(answer, Failure) else None,
        "usage": None if attempt.usage is None else asdict(attempt.usage),
        "at_most": asdict(attempt.at_most),
        "usd": attempt.usd,
        "seconds": attempt.seconds,
        "waited": attempt.waited,
    }


def from_line(line: Mapping[str, Any], systems: Mapping[str, str]) -> Attempt:
    """An attempt from its JSON values; `systems` are the system prompts by hash.

    Raises:
        ValueError, KeyError, TypeError: the values are not those of an attempt.
    """
    request = {**line["request"], "system": systems[line["request"]["system"]]}
    answer = line["failure"] if line["reply"] is None else line["reply"]
    values = {"call": line, "number": line["attempt"], "request": request, "answer": answer}
    return from_json(Attempt, {**line, **values})


NAME: Final = "transcript.jsonl"
FORMAT: Final = 1
CHECKSUM: Final = "checksum"

Entry = Sent | Attempt | Conclusion | Played

_KINDS: Final[Mapping[str, type[Sent | Conclusion | Played]]] = {
    "sent": Sent,
    "part": Conclusion,
    "played": Played,
}
"""Kinds of lines whose other fields are those of a dataclass."""


@dataclass(frozen=True, slots=True)
class TranscriptLine:
    """A line of a transcript file."""

    number: int  # from 1
    plain: Mapping[str, Any]  # its JSON values; empty if it is not a JSON object
    entry: Entry | None  # None: of another kind, or damaged
    damage: str = ""  # error on reading it, or ""
    change: str = ""  # evidence that it was changed after it was written, or ""

    @property
    def kind(self) -> str:
        """The field `line`, or ""."""
        return str(self.plain.get("line", ""))


def read_lines(lines: Iterable[bytes]) -> Iterator[TranscriptLine]:
    """Reads each line; damaged lines are marked as such and do not end the iteration."""
    systems: dict[str, str] = {}
    for number, raw in enumerate(lines, 1):
        plain: Mapping[str, Any] = {}
        try:
            plain = _object(raw)
            entry = _entry(plain, systems)
        except DECODE_ERRORS as error:
            yield TranscriptLine(number, plain, None, f"{type(error).__name__}: {error}")
        else:
            yield TranscriptLine(number, plain, entry, change=_change(plain))


def _object(raw: bytes) -> Mapping[str, Any]:
    value = read_json(raw)
    if not isinstance(value, dict):
        raise TypeError("expected a JSON object")
    return value


def _entry(plain: Mapping[str, Any], systems: dict[str, str]) -> Entry | None:
    """The entry of a line; None for other kinds. Raises DECODE_ERRORS."""
    kind = plain["line"]
    if kind == "system":
        systems[plain["sha256"]] = plain["text"]
    if kind == "dialect":
        plain["generation"], plain["dialect"]
    if kind == "attempt":
        return from_line(plain, systems)
    return from_json(_KINDS[kind], plain) if kind in _KINDS else None


def _change(plain: Mapping[str, Any]) -> str:
    """Evidence that a line was changed after it was written, or ""."""
    rest = {key: value for key, value in plain.items() if key != CHECKSUM}
    same = CHECKSUM not in plain or sha256_of(rest) == plain[CHECKSUM]
    return "" if same else "its checksum differs"


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
        self.start: dict[str, Any] | None = None
        self.attempts: list[Attempt] = []
        self.parts: list[Conclusion] = []
        self.sent: list[Sent] = []
        self.played: list[Played] = []
        self.learnt: tuple[int, dict[str, Any]] | None = None  # first generation and capabilities
        self._entries: dict[type[Entry], tuple[str, list[Any]]] = {
            # the kind of the line, and the list of its entries
            Sent: ("sent", self.sent),
            Attempt: ("attempt", self.attempts),
            Conclusion: ("part", self.parts),
            Played: ("played", self.played),
        }
        self._systems: dict[str, str] = {}
        self._lock = Lock()  # the questions of a generation are asked in several threads
        self._whole: int | None = None  # bytes of complete lines, if an incomplete one follows
        if path is not None and path.exists():
            content = path.read_bytes()
            complete = content[: content.rfind(b"\n") + 1]
            if complete != content:
                self._whole = len(complete)
            self._load(complete, path)

    def of(self, call: Call) -> list[Attempt]:
        """The attempts at a call, in order."""
        return [a for a in list(self.attempts) if a.call == call]

    def begin(self, start: Mapping[str, Any]) -> None:
        """Adds the line `start`."""
        self.start = {"format": FORMAT, **start}
        self._write({"line": "start", **self.start})

    def learn(self, generation: int, capabilities: Mapping[str, Any]) -> None:
        """Adds the dialect that is known from a generation on."""
        with self._lock:
            if not self.fixed:
                self.learnt = (generation, dict(capabilities))
                self._write({"line": "dialect", "generation": generation, "dialect": capabilities})

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

    def unanswered(self) -> list[Sent]:
        """Requests without an outcome: in progress, or of a killed process."""
        return self.requests()[1]

    def requests(self) -> tuple[list[Attempt], list[Sent]]:
        """Attempts, and requests without an outcome, as one consistent pair.

        Attempts that a cap prevented are left out.
        """
        with self._lock:
            attempts = [a for a in self.attempts if not _is_refused_by_cap(a)]
            answered = Counter((a.call, a.number) for a in attempts)
            unanswered = []
            for request in reversed(self.sent):  # of two with one number the later has the outcome
                if answered[request.call, request.number]:
                    answered[request.call, request.number] -= 1
                else:
                    unanswered.append(request)
        return attempts, unanswered

    def add(self, entry: Entry) -> None:
        """Writes an entry to the file before it returns.

        A `Conclusion` or `Played` that is in the transcript already is not added again.
        """
        kind, entries = self._entries[type(entry)]
        with self._lock:
            if self.fixed or (isinstance(entry, Conclusion | Played) and entry in entries):
                return
            entries.append(entry)
            if not isinstance(entry, Attempt):
                self._write({"line": kind, **asdict(entry)})
                return
            text = entry.request.system
            digest = hashlib.sha256(text.encode()).hexdigest()
            if digest not in self._systems:
                self._systems[digest] = text
                self._write({"line": "system", "sha256": digest, "text": text})
            self._write({"line": kind, **to_line(entry, digest)})

    def _write(self, line: Mapping[str, Any]) -> None:
        if self.path is None:
            return
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("ab") as file:
            if self._whole is not None:
                file.truncate(self._whole)
            self._whole = file.seek(0, os.SEEK_END)  # a failed write may leave an incomplete line
            record = {**line, CHECKSUM: sha256_of(line)}
            file.write(json.dumps(record, ensure_ascii=False, allow_nan=False).encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
        self._whole = None

    def _load(self, data: bytes, path: Path) -> None:
        for line in read_lines(data.splitlines()):
            if line.damage:
                raise SupervisionError(
                    f"Expected a transcript in {path}, found line {line.number} damaged"
                    f" ({line.damage}); restore a copy, or start the run again with resume=never."
                    " `islandgp transcript` shows the readable lines."
                )
            if line.change:
                raise SupervisionError(
                    f"Expected {path} as it was written, found line {line.number}"
                    f"{_about(line)} changed: {line.change}; restore the original, or delete the"
                    " field `checksum` of the line to use it as it is."
                )
            self._take(line)

    def _take(self, line: TranscriptLine) -> None:
        if line.entry is not None:
            self._entries[type(line.entry)][1].append(line.entry)
        elif line.kind == "start":
            self.start = {k: v for k, v in line.plain.items() if k not in ("line", CHECKSUM)}
        elif line.kind == "system":
            self._systems[line.plain["sha256"]] = line.plain["text"]
        elif line.kind == "dialect":
            self.learnt = (line.plain["generation"], line.plain["dialect"])


def _about(line: TranscriptLine) -> str:
    """The call of a line, in brackets, or ""."""
    return f" ({line.entry.call})" if isinstance(line.entry, Sent | Attempt) else ""


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
