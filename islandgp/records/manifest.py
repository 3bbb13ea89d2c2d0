"""`manifest.json`: size and SHA-256 of each file of a finished run.

It is written before summary.json, which marks a run as finished; so every finished run has one.
The page run.html is written later, and its entry is added then.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from islandgp.atomic_files import damaged, reading, write_atomic
from islandgp.gate import check_folder, opened, read_bytes
from islandgp.plain import from_json, read_json
from islandgp.records.files import LONG, PAGE, pretty

NAME: Final = "manifest.json"

UNLISTED: Final = frozenset({NAME, "checkpoint.json"})
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

RESTORABLE: Final = frozenset({"best.bt", LONG, "lineage.csv", PAGE})
"""Files that the run's command restores from the others if they are missing."""

CHANGED, MISSING, ADDED = "changed", "missing", "added"
"""What may have happened to a file."""


@dataclass(frozen=True, slots=True)
class ManifestEntry:
    """Size and checksum of a file at the end of the run."""

    bytes: int
    sha256: str


@dataclass(frozen=True, slots=True)
class Manifest:
    """Content of manifest.json."""

    files: dict[str, ManifestEntry]  # by name


def write_manifest(folder: Path, summary: bytes) -> None:
    """Writes the manifest of a run's files, including the summary, which is written after it."""
    files = {
        name: _entry(folder / name) for name in _names(folder) if name not in (PAGE, "summary.json")
    }
    files["summary.json"] = ManifestEntry(len(summary), hashlib.sha256(summary).hexdigest())
    _write(folder, files)


def add_to_manifest(folder: Path, name: str) -> None:
    """Updates the entry of a file of a finished run. Raises RunError as `read_manifest`."""
    _write(folder, {**read_manifest(folder), name: _entry(folder / name)})


def read_manifest(folder: Path) -> dict[str, ManifestEntry]:
    """The entries of a finished run's files by name. Raises RunError: damaged or deleted."""
    file = folder / NAME
    if not file.exists():
        raise damaged("the checksums of a finished run", file, MISSING)
    with reading("the checksums of a finished run", file):
        return from_json(Manifest, read_json(read_bytes(file))).files


def damaged_files(folder: Path, names: Iterable[str] | None = None) -> dict[str, str]:
    """What happened to the damaged files of a finished run, by name.

    `names`: those to look at; None: all. Raises RunError: the manifest is damaged.
    """
    if names is None and not (folder / NAME).exists():
        return {NAME: MISSING}
    entries = read_manifest(folder)
    looked_at = {*entries, *REQUIRED, *_names(folder)} if names is None else names
    found = {name: _damage(folder / name, entries.get(name)) for name in sorted(looked_at)}
    return {name: damage for name, damage in found.items() if damage}


def _damage(file: Path, expected: ManifestEntry | None) -> str:
    if not file.is_file():
        return MISSING
    if expected is None:
        return ADDED
    same = file.stat().st_size == expected.bytes and _entry(file) == expected
    return "" if same else CHANGED


def in_words(name: str, damage: str) -> str:
    """What happened to a file, and whether the run's command makes it again."""
    # After a kill, the page of an unfinished run may be there, without an entry.
    restored = name == PAGE or (damage == MISSING and name in RESTORABLE)
    return f"{name}: {damage}{'; the command of the run restores it' * restored}"


def must_be_as_written(folder: Path, name: str) -> None:
    """Raises RunError if a file of a finished run is damaged, or another one is missing."""
    listed = {*REQUIRED, *read_manifest(folder)} - RESTORABLE
    refuse(folder, damaged_files(folder, {name, *(n for n in listed if not (folder / n).exists())}))


def refuse(folder: Path, damage: Mapping[str, str]) -> None:
    """Raises RunError for the first damaged file of a finished run."""
    for name, what in damage.items():
        raise damaged("a file of a finished run", folder / name, what)


def _names(folder: Path) -> Iterator[str]:
    """The files of a folder that have an entry in a manifest."""
    check_folder(folder)
    for file in sorted(folder.iterdir()):
        if not file.name.startswith(".") and file.name not in UNLISTED:
            yield file.name


def _entry(file: Path) -> ManifestEntry:
    with opened(file) as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
        return ManifestEntry(stream.tell(), digest)


def _write(folder: Path, files: dict[str, ManifestEntry]) -> None:
    write_atomic(folder / NAME, pretty(asdict(Manifest(files))))
