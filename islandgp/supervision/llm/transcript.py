"""The transcript: every attempt of a run, one line each, written before anything is made of it.

It is what a resumed run and a replay read instead of asking again, what the
ledger counts, and what a person reads to see who said what. Its lines are JSON
objects with a field `line` that says of which sort they are:

start    the settings and the dialect that the requests were made with; null: not yet known
dialect  the dialect, and the generation from which on it was known
system   a system prompt, once, under its hash
sent     an attempt is about to be made; without its attempt line, its outcome is unknown
attempt  one attempt at a call: where, request, reply or failure, tokens, dollars, seconds
part     the result for one part of the guidance: its source, and the stages that rejected it
played   episodes that supervision ran for itself: for which generation, what for, how many

Each has a `checksum` of its other fields. Transcripts of older versions have none.
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
    """Where in a run a call belongs."""

    generation: int  # whose state is asked about; -1 for the probe
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
    at_most: Usage  # tokens that it can take
    seconds: float = 0.0  # that it can take, the wait before it included; 0 in older transcripts


@dataclass(frozen=True, slots=True)
class Attempt:
    """One attempt at a call."""

    call: Call
    number: int  # from 1
    request: Request
    answer: Reply | Failure
    usage: Usage | None  # tokens; None: unknown
    at_most: Usage  # tokens that it may have taken; `usage` where that is known
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
    why: str  # of a fallback, else ""
    rejected: tuple[str, ...]  # stages of the validation, in order
    failed: str = ""  # the kind of the failure that ended it, else ""; "" in older transcripts


@dataclass(frozen=True, slots=True)
class Played:
    """Episodes that supervision ran for itself."""

    generation: int
    purpose: str  # "traces": told in a prompt; "trial": of candidates
    episodes: int
    gain: float = 0.0  # of a trial: points that the choice has above the first candidate


def to_line(attempt: Attempt, system: str) -> dict[str, Any]:
    """An attempt as JSON values; `system` is the hash under which its system prompt stands."""
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
        ValueError, KeyError, TypeError: they are not those of an attempt.
    """
    asked = {**line["request"], "system": systems[line["request"]["system"]]}
    answer = line["failure"] if line["reply"] is None else line["reply"]
    own = {"call": line, "number": line["attempt"], "request": asked, "answer": answer}
    return from_json(Attempt, {**line, **own})


NAME: Final = "transcript.jsonl"
FORMAT: Final = 1
CHECKSUM: Final = "checksum"

Entry = Sent | Attempt | Conclusion | Played

_KINDS: Final[Mapping[str, type[Sent | Conclusion | Played]]] = {
    "sent": Sent,
    "part": Conclusion,
    "played": Played,
}
"""By the field `line`: sorts of entries whose other fields are those of a dataclass."""


@dataclass(frozen=True, slots=True)
class TranscriptLine:
    """A line as it is read."""

    number: int  # from 1
    plain: Mapping[str, Any]  # its JSON values; empty if it is no JSON object
    entry: Entry | None  # None: of another sort, or it cannot be read
    damage: str = ""  # why it cannot be read
    change: str = ""  # how one sees that it was changed after it was written

    @property
    def kind(self) -> str:
        """Of which sort it is, "" where it does not say so."""
        return str(self.plain.get("line", ""))


def read_lines(lines: Iterable[bytes]) -> Iterator[TranscriptLine]:
    """Each line by itself: one that is damaged does not hide those behind it."""
    systems: dict[str, str] = {}
    for number, raw in enumerate(lines, 1):
        plain: Mapping[str, Any] = {}
        try:
            plain = _object(raw)
            entry = _entry(plain, systems)
        except DECODE_ERRORS as error:
            yield TranscriptLine(number, plain, None, f"{type(error).__name__}: {error}")
        else:
            yield TranscriptLine(number, plain, entry, change=_change(plain, entry))


def _object(raw: bytes) -> Mapping[str, Any]:
    found = read_json(raw)
    if not isinstance(found, dict):
        raise TypeError("expected a JSON object")
    return found


def _entry(plain: Mapping[str, Any], systems: dict[str, str]) -> Entry | None:
    """What a line holds; one of a sort that is not known is passed over. Raises DECODE_ERRORS."""
    kind = plain["line"]
    if kind == "system":
        systems[plain["sha256"]] = plain["text"]
    if kind == "dialect":
        plain["generation"], plain["dialect"]
    if kind == "attempt":
        return from_line(plain, systems)
    return from_json(_KINDS[kind], plain) if kind in _KINDS else None


def _change(plain: Mapping[str, Any], entry: Entry | None) -> str:
    """How one sees that a line was changed after it was written; "" if one does not see it."""
    if CHECKSUM in plain:
        rest = {key: value for key, value in plain.items() if key != CHECKSUM}
        return "" if sha256_of(rest) == plain[CHECKSUM] else "its checksum differs"
    digest = plain.get("digest")
    if isinstance(entry, Attempt) and digest not in (None, entry.request.digest):
        return "the digest of its request differs"
    return ""


class Transcript:
    """A transcript's lines, in memory and in a file that only grows."""

    def __init__(self, path: Path | None, *, fixed: bool = False) -> None:
        """Reads what is there; a last line that was cut off by a kill is dropped.

        A fixed one stays as it is, whatever it is told.

        Raises:
            SupervisionError: the file is no transcript, or was changed after it was written.
        """
        self.path, self.fixed = path, fixed
        self.start: dict[str, Any] | None = None
        self.attempts: list[Attempt] = []
        self.parts: list[Conclusion] = []
        self.sent: list[Sent] = []
        self.played: list[Played] = []
        self.learnt: tuple[int, dict[str, Any]] | None = None  # a dialect, and since when
        self._kept: dict[type[Entry], tuple[str, list[Any]]] = {
            # how a line says of which sort it is, and where it goes
            Sent: ("sent", self.sent),
            Attempt: ("attempt", self.attempts),
            Conclusion: ("part", self.parts),
            Played: ("played", self.played),
        }
        self._systems: dict[str, str] = {}
        self._lock = Lock()  # the two questions of a generation are asked at the same time
        self._whole: int | None = None  # bytes of whole lines, where a piece of one follows
        if path is not None and path.exists():
            found = path.read_bytes()
            kept = found[: found.rfind(b"\n") + 1]
            if kept != found:
                self._whole = len(kept)
            self._load(kept, path)

    def of(self, call: Call) -> list[Attempt]:
        """The attempts at a call, in order."""
        return [a for a in list(self.attempts) if a.call == call]

    def begin(self, start: Mapping[str, Any]) -> None:
        """Writes how the requests are made."""
        self.start = {"format": FORMAT, **start}
        self._write({"line": "start", **self.start})

    def learn(self, generation: int, dialect: Mapping[str, Any]) -> None:
        """Writes down how requests are made from a generation on."""
        with self._lock:
            if not self.fixed:
                self.learnt = (generation, dict(dialect))
                self._write({"line": "dialect", "generation": generation, "dialect": dialect})

    def useless_before(self, generation: int) -> list[Conclusion]:
        """The last questions in a row, up to a generation, whose answers were of no use.

        So is one that came too late, cut off or malformed: it may be charged as any other. A
        question that nobody worked on is passed over.
        """
        found: list[Conclusion] = []
        for part in sorted(self.parts, key=lambda part: (part.generation, part.part)):
            if part.generation < generation and part.source != "fallback":
                found = []
            elif part.generation < generation and (part.rejected or part.failed in CHARGED):
                found.append(part)
        return found

    def lost(self) -> list[Sent]:
        """Requests without an outcome: under way, or cut off when the process was killed."""
        return self.taken()[1]

    def taken(self) -> tuple[list[Attempt], list[Sent]]:
        """The attempts that were made, and the requests without an outcome, at one moment.

        An attempt that a cap refused was not made: it is the outcome of no request.
        """
        with self._lock:
            made = [a for a in self.attempts if not _is_refused_by_cap(a)]
            heard = Counter((a.call, a.number) for a in made)
            lost = []
            for sent in reversed(self.sent):  # of two with one number the later was heard of
                if heard[sent.call, sent.number]:
                    heard[sent.call, sent.number] -= 1
                else:
                    lost.append(sent)
        return made, lost

    def add(self, entry: Entry) -> None:
        """Writes an entry down before it returns; a conclusion or what was played but once."""
        kind, kept = self._kept[type(entry)]
        with self._lock:
            if self.fixed or (isinstance(entry, Conclusion | Played) and entry in kept):
                return
            kept.append(entry)
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
            self._whole = file.seek(0, os.SEEK_END)  # where writing fails, a piece may follow
            whole = {**line, CHECKSUM: sha256_of(line)}
            file.write(json.dumps(whole, ensure_ascii=False, allow_nan=False).encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
        self._whole = None

    def _load(self, data: bytes, path: Path) -> None:
        for line in read_lines(data.splitlines()):
            if line.damage:
                raise SupervisionError(
                    f"Expected a transcript in {path}, found line {line.number} damaged"
                    f" ({line.damage}); put a copy back, or begin again with resume=never."
                    " `islandgp transcript` shows what can be read."
                )
            if line.change:
                raise SupervisionError(
                    f"Expected {path} as it was written, found line {line.number}"
                    f"{_about(line)} changed: {line.change}; put the original back, or take the"
                    " fields `checksum` and `digest` out of the line to use it as it is."
                )
            self._take(line)

    def _take(self, line: TranscriptLine) -> None:
        if line.entry is not None:
            self._kept[type(line.entry)][1].append(line.entry)
        elif line.kind == "start":
            self.start = {k: v for k, v in line.plain.items() if k not in ("line", CHECKSUM)}
        elif line.kind == "system":
            self._systems[line.plain["sha256"]] = line.plain["text"]
        elif line.kind == "dialect":
            self.learnt = (line.plain["generation"], line.plain["dialect"])


def _about(line: TranscriptLine) -> str:
    """What a line is about, in brackets."""
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
            " a run with supervisor=llm leaves one in its folder."
        )
    return path
