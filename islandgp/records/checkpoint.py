"""A run's state on disk: written in one piece or not at all, and checked when read.

The history is not in it, but in the records beside it, a line a generation. The
checkpoint holds their digest, so that it belongs to these records and to no others.
"""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

from islandgp.atomic_files import reading, write_atomic
from islandgp.gp.record import RunState
from islandgp.plain import from_json, read_json, to_json


def dump(value: Any) -> str:
    """JSON of dataclasses' plain dicts, the same bytes each time, on one line."""
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def save_state(
    path: Path, state: RunState, *, records: str = "", previous: Path | None = None
) -> None:
    """Writes a checkpoint with its checksum: a state without its history.

    Args:
        path: the file.
        state: what it holds.
        records: the digest of the generations' records before it.
        previous: where the checkpoint that stood in `path` is kept.
    """
    kept = to_json(replace(state, history=()))
    del kept["history"]
    body = dump({"generation": state.generation, "records": records, **kept})
    digest = hashlib.sha256(body.encode()).hexdigest()
    data = f'{{"sha256":"{digest}","state":{body}}}\n'.encode()
    write_atomic(path, data, previous=previous)


def read_checkpoint(path: Path) -> tuple[RunState, str]:
    """A state without its history, and the digest of the records before it.

    The digest is "" in files of the oldest versions.

    Raises:
        RunError: the file is damaged, or of a version that wrote other fields.
    """
    with reading("a checkpoint", path):
        whole = read_json(path.read_bytes())
        state = whole["state"]
        if hashlib.sha256(dump(state).encode()).hexdigest() != whole["sha256"]:
            raise ValueError("its checksum differs")
        return from_json(RunState, {**state, "history": []}), str(state.get("records", ""))


def generation_of(checkpoint: Path) -> int:
    """The generation that a checkpoint's file goes on with, 0 where none can be read."""
    try:
        with checkpoint.open(encoding="utf-8", errors="replace") as file:
            head = re.search(r'"generation":(\d+)', file.read(200))
    except FileNotFoundError:
        return 0
    return int(head[1]) if head else 0
