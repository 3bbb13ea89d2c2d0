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
"""

from __future__ import annotations

import hashlib
import json
import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Final

from islandgp.errors import SupervisionError
from islandgp.plain import UNREADABLE, made_of, read_json
from islandgp.supervision.llm.message import Failure, Reply, Request, Usage


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
    return made_of(Attempt, {**line, **own})


NAME: Final = "transcript.jsonl"
FORMAT: Final = 1

Entry = Sent | Attempt | Conclusion | Played


class Transcript:
    """A transcript's lines, in memory and in a file that only grows."""

    def __init__(self, path: Path | None, *, fixed: bool = False) -> None:
        """Reads what is there; a last line that was cut off by a kill is dropped.

        A fixed one stays as it is, whatever it is told.

        Raises:
            SupervisionError: the file is no transcript.
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

    def useless_before(self, generation: int) -> int:
        """How many questions in a row, up to a generation, had answers of no use.

        One without an answer is passed over.
        """
        count = 0
        for part in sorted(self.parts, key=lambda part: (part.generation, part.part)):
            if part.generation < generation and part.source != "fallback":
                count = 0
            elif part.generation < generation and part.rejected:
                count += 1
        return count

    def lost(self) -> list[Sent]:
        """What was sent and never heard of again, e.g. because the process was killed."""
        with self._lock:
            heard = Counter((a.call, a.number) for a in self.attempts)
            found = []
            for sent in reversed(self.sent):  # of two with one number the later was heard of
                if heard[sent.call, sent.number]:
                    heard[sent.call, sent.number] -= 1
                else:
                    found.append(sent)
        return found

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
                self._whole = None
            file.write(json.dumps(line, ensure_ascii=False, allow_nan=False).encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())

    def _load(self, data: bytes, path: Path) -> None:
        known = {kind: (sort, kept) for sort, (kind, kept) in self._kept.items()}
        try:
            for line in map(read_json, data.splitlines()):
                kind = line.pop("line")
                if kind == "start":
                    self.start = line
                elif kind == "system":
                    self._systems[line["sha256"]] = line["text"]
                elif kind == "dialect":
                    self.learnt = (line["generation"], line["dialect"])
                elif kind == "attempt":
                    self.attempts.append(from_line(line, self._systems))
                elif kind in known:
                    sort, kept = known[kind]
                    kept.append(made_of(sort, line))
        except UNREADABLE as error:
            raise SupervisionError(
                f"Expected a transcript in {path}, found a damaged file"
                f" ({type(error).__name__}: {error}); move it away to ask again."
            ) from None


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
