"""A run's state on disk: written in one piece or not at all, and checked when read.

Its history is not in it: that stands in the records beside it, a line a generation. The
checkpoint holds their digest, so that it belongs to these records and to no others.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from shutil import copymode
from tempfile import TemporaryFile
from typing import Annotated, Any

from pydantic import Field

from islandgp.bt.language import parse, to_text
from islandgp.errors import RunError, TreeError, brief
from islandgp.evolution.population import Ancestor, Individual, Origin
from islandgp.evolution.record import Champion, RunState
from islandgp.plain import UNREADABLE, must_fit, read_json, typed
from islandgp.scoring.snapshot import Snapshot


@contextmanager
def usable(folder: Path) -> Iterator[None]:
    """Raises RunError where a folder cannot be made, read or written, or its disk is full."""
    try:
        yield
    except OSError as error:
        raise RunError(
            f"Expected a folder to read and write in {folder}, found: {error.strerror or error};"
            " mend that and give the command again, or choose another place with runs=... ."
        ) from error


def write_atomic(path: Path, data: bytes, *, previous: Path | None = None) -> None:
    """The whole file or the old one, whatever happens in between; who may read it stays.

    The old file stays as `previous`, if that is given.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():
            copymode(path, temporary)
            if previous is not None:
                path.replace(previous)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def must_take_files(folder: Path) -> None:
    """Makes a file in a folder, or where it would be made, and removes it.

    Raises:
        OSError: that is not possible.
    """
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    with TemporaryFile(dir=there, prefix=".islandgp-"):
        pass


def remove_leftovers(folder: Path, pattern: str = "*") -> None:
    """Removes what `write_atomic` left of files when the machine stopped in the middle of it.

    Only for the one process that may write them.
    """
    for file in folder.glob(f".{pattern}.tmp"):
        file.unlink(missing_ok=True)


def dump(value: Any) -> str:
    """JSON of dataclasses' plain dicts, the same bytes each time, on one line."""
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def save_state(
    path: Path, state: RunState, *, records: str = "", previous: Path | None = None
) -> None:
    """Writes a checkpoint with its checksum.

    Args:
        path: the file.
        state: what it holds.
        records: the digest of the generations' records before it.
        previous: where the checkpoint that stood in `path` is kept.
    """
    body = dump(_plain(state, records))
    digest = hashlib.sha256(body.encode()).hexdigest()
    data = f'{{"sha256":"{digest}","state":{body}}}\n'.encode()
    write_atomic(path, data, previous=previous)


def read_checkpoint(path: Path) -> dict[str, Any]:
    """A checkpoint as plain values, among them `generation`, and `records` as in `save_state`.

    Raises:
        RunError: the file is damaged, or of a version that wrote other fields.
    """
    with reading("a checkpoint", path):
        whole = read_json(path.read_bytes())
        body = dump(whole["state"])
        if hashlib.sha256(body.encode()).hexdigest() != whole["sha256"]:
            raise ValueError("its checksum differs")
        must_fit(_Plain, body)
        return dict(whole["state"])


@contextmanager
def reading(what: str, file: Path) -> Iterator[None]:
    """Around what makes something of a file that was expected to hold `what`.

    Raises:
        RunError: the file holds something else.
    """
    try:
        yield
    except (*UNREADABLE, TreeError) as error:
        raise damaged(what, file, brief(error)) from error


def damaged(what: str, file: Path, why: str) -> RunError:
    """The error for a file that was expected to hold `what`."""
    return RunError(
        f"Expected {what} in {file}, found a damaged file ({why});"
        " delete the run's folder or use resume=never."
    )


@dataclass(frozen=True, slots=True)
class _PlainIndividual:
    id: str
    tree: str
    origin: Origin
    parents: list[str]
    mutation: str


@dataclass(frozen=True, slots=True)
class _PlainAncestor:
    id: str
    tree: str
    stage: int
    fitness: float


@dataclass(frozen=True, slots=True)
class _Plain:
    """A run's state as it stands in its checkpoint."""

    generation: Annotated[int, Field(ge=0)]
    population: Annotated[list[_PlainIndividual], Field(min_length=1)]
    rate: float
    archive: dict[str, _PlainAncestor]
    champion: Champion | None
    records: str | None = None


def _plain(state: RunState, records: str) -> dict[str, Any]:
    champion = state.champion
    return {
        "generation": state.generation,
        **({"records": records} if records else {}),
        "population": [
            {
                "id": i.id,
                "tree": to_text(i.tree),
                "origin": i.origin,
                "parents": i.parents,
                "mutation": i.mutation,
            }
            for i in state.population
        ],
        "rate": state.rate,
        "archive": {
            name: {"id": a.id, "tree": to_text(a.tree), "stage": a.stage, "fitness": a.fitness}
            for name, a in state.archive.items()
        },
        "champion": None if champion is None else asdict(champion),
    }


def state_of(plain: dict[str, Any], history: Iterable[Snapshot]) -> RunState:
    """The state that `read_checkpoint` has read.

    `history` are the run's generations from 0 on; those behind the checkpoint are not read.
    """
    champion = plain["champion"]
    return RunState(
        generation=plain["generation"],
        population=tuple(_individual(i) for i in plain["population"]),
        rate=plain["rate"],
        history=tuple(islice(history, plain["generation"])),
        archive={
            name: Ancestor(**{**a, "tree": parse(a["tree"])})
            for name, a in plain["archive"].items()
        },
        champion=None if champion is None else typed(Champion, champion),
    )


def _individual(plain: dict[str, Any]) -> Individual:
    own = {"origin": Origin(plain["origin"]), "parents": tuple(plain["parents"])}
    return Individual(**{**plain, **own, "tree": parse(plain["tree"])})
