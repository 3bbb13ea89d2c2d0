"""Checkpoints: the state of a run in a file, written atomically and checked when it is read.

The history is not in the checkpoint but in the records, one line per generation. The checkpoint has
the digest of these records, so it cannot be used with other ones.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import replace
from pathlib import Path

from islandgp.atomic_files import damaged, reading, write_atomic
from islandgp.errors import RunError
from islandgp.gate import opened, read_bytes
from islandgp.gp.record import RunState
from islandgp.plain import from_json, read_json, to_json
from islandgp.records.files import Lines, dump


def save_state(path: Path, state: RunState, *, records: str = "") -> None:
    """Writes a checkpoint, a state without its history, with its checksum.

    Args:
        path: the file.
        state: of the run.
        records: SHA-256 of the lines of the records up to this state.
    """
    plain_state = to_json(replace(state, history=()))
    del plain_state["history"]
    body = dump({"generation": state.generation, "records": records, **plain_state})
    digest = hashlib.sha256(body.encode()).hexdigest()
    write_atomic(path, f'{{"sha256":"{digest}","state":{body}}}\n'.encode())


def read_checkpoint(path: Path) -> tuple[RunState, str]:
    """The state in a checkpoint, without its history, and the digest of the records up to it.

    Raises:
        RunError: the file is damaged, or of a version that wrote other fields.
    """
    with reading("a checkpoint", path):
        document = read_json(read_bytes(path))
        state = document["state"]
        if hashlib.sha256(dump(state).encode()).hexdigest() != document["sha256"]:
            raise ValueError("its checksum differs")
        return from_json(RunState, {**state, "history": []}), str(state["records"])


def generation_of(checkpoint: Path) -> int:
    """The next generation in a checkpoint file; 0 if it cannot be read."""
    try:
        with opened(checkpoint) as file:
            head = re.search(rb'"generation":(\d+)', file.read(200))
    except FileNotFoundError:
        return 0
    return int(head[1]) if head else 0


def recorded(checkpoint: Path, generations: Lines) -> tuple[RunState | None, list[bytes]]:
    """The state in a checkpoint, without its history, and the records before it.

    None: there is no checkpoint, so the run starts at generation 0.

    Raises:
        RunError: the checkpoint or a record before it is damaged or missing.
    """
    if not checkpoint.exists():
        if (n := sum(1 for _ in generations.whole())) > 1:
            raise RunError(
                f"Expected a checkpoint beside {n} generations in {checkpoint}, found none;"
                " restore it, or use resume=never for a new folder beside this one."
            )
        return None, []
    state, expected = read_checkpoint(checkpoint)
    lines = generations.head(state.generation)
    if lines and hashlib.sha256(b"".join(lines)).hexdigest() != expected:
        reason = f"a record before generation {len(lines)} differs from its checksum"
        raise damaged(generations.description, generations.path, reason)
    return state, lines
