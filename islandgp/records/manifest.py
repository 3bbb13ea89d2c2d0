"""`manifest.json`: the SHA-256 of each file of a finished run.

It is written before summary.json, which marks a run as finished; so every finished run has one.
The page run.html has no entry: it is written again before it is opened or sent.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from islandgp.atomic_files import damaged, reading, write_atomic
from islandgp.gate import check_folder, opened, read_bytes
from islandgp.plain import from_json, read_json
from islandgp.records.files import PAGE, pretty

NAME: Final = "manifest.json"

UNLISTED: Final = frozenset({NAME, "checkpoint.json", PAGE})
"""Files without an entry, as they change or are removed after the end. Hidden files have none."""

REQUIRED: Final = (
    "about.json",
    "config.yaml",
    "generations.jsonl",
    "costs.jsonl",
    "best.bt",
    "lineage.csv",
    "archive.json",
    "summary.json",
)
"""Files of every finished run."""

CHANGED, MISSING, ADDED = "changed", "missing", "added"  # what may have happened to a file


def write_manifest(folder: Path, summary: bytes) -> None:
    """Writes the manifest of a run's files, including the summary, which is written after it."""
    digests = {name: _digest(folder / name) for name in _names(folder)}
    digests["summary.json"] = hashlib.sha256(summary).hexdigest()
    write_atomic(folder / NAME, pretty(digests))


def read_manifest(folder: Path) -> dict[str, str]:
    """The digests of a finished run's files by name. Raises RunError: damaged or deleted."""
    file = folder / NAME
    if not file.exists():
        raise damaged("the checksums of a finished run", file, MISSING)
    with reading("the checksums of a finished run", file):
        return from_json(dict[str, str], read_json(read_bytes(file)))


def damaged_files(folder: Path, read: str | None = None) -> dict[str, str]:
    """What happened to the damaged files of a finished run, by name.

    `read`: the only file whose content is compared; None: all are. Raises RunError: the manifest is
    damaged.
    """
    if not (folder / NAME).exists():
        return {NAME: MISSING}
    digests, found = read_manifest(folder), {}
    for name in sorted({*digests, *REQUIRED, *_names(folder)} - UNLISTED):
        if not (folder / name).is_file():
            found[name] = MISSING
        elif name not in digests:
            found[name] = ADDED
        elif read in (None, name) and _digest(folder / name) != digests[name]:
            found[name] = CHANGED
    return found


def must_be_sound(folder: Path, read: str | None = None) -> None:
    """Raises RunError for damage as in `damaged_files`; further files are allowed."""
    for name, what in damaged_files(folder, read).items():
        if what != ADDED or name in REQUIRED:
            raise damaged("a file of a finished run", folder / name, what)


def _names(folder: Path) -> Iterator[str]:
    """The files of a folder that have an entry in a manifest."""
    check_folder(folder)
    for file in sorted(folder.iterdir()):
        if not file.name.startswith(".") and file.name not in UNLISTED:
            yield file.name


def _digest(file: Path) -> str:
    with opened(file) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
