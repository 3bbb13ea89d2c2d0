"""`manifest.json`: size and SHA-256 of each file of a finished run.

It is written before summary.json, which marks a run as finished; so every finished run has one.
The page run.html is written later, and its entry is added then.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from enum import StrEnum
from functools import lru_cache
from pathlib import Path
from typing import Final

from islandgp.atomic_files import damaged, reading, write_atomic
from islandgp.errors import RunError
from islandgp.gate import check_folder, opened, read_bytes
from islandgp.plain import from_json, read_json
from islandgp.records.files import LONG, PAGE, pretty

NAME: Final = "manifest.json"

UNLISTED: Final = frozenset({NAME, "checkpoint.json", "checkpoint.previous.json"})
"""Files without an entry, as they change or are removed after the end. Hidden files have none."""

REQUIRED: Final = (
    "about.json",
    "config.yaml",
    "generations.jsonl",
    "generations.sha256",
    "costs.jsonl",
    "best.bt",
    "lineage.csv",
    "archive.json",
    "summary.json",
)
"""Files of every finished run."""

RESTORABLE: Final = frozenset({"best.bt", LONG, "lineage.csv", PAGE})
"""Files that the run's command restores from the others if they are missing."""


class Damage(StrEnum):
    """Kind of damage to a file."""

    CHANGED = "changed"
    MISSING = "missing"
    ADDED = "added"


@dataclass(frozen=True, slots=True)
class DamagedFile:
    """A file of a finished run that was changed, added or removed."""

    name: str
    damage: Damage

    @property
    def restorable(self) -> bool:
        """True if the run's command restores the file."""
        return self.damage is Damage.MISSING and self.name in RESTORABLE

    def __str__(self) -> str:
        # After a kill, the page of an unfinished run may be there, without an entry.
        restored = self.restorable or self.name == PAGE
        remedy = "; the command of the run restores it" * restored
        return f"{self.name}: {self.damage}{remedy}"


@dataclass(frozen=True, slots=True)
class ManifestEntry:
    """Size and checksum of a file at the end of the run."""

    bytes: int
    sha256: str


@dataclass(frozen=True, slots=True)
class Manifest:
    """Content of manifest.json."""

    files: dict[str, ManifestEntry]  # by name

    def damage(self, file: Path) -> DamagedFile | None:
        """The damage to a file; None if it is as written."""
        expected = self.files.get(file.name)
        if not file.is_file():
            return DamagedFile(file.name, Damage.MISSING)
        if expected is None:
            return DamagedFile(file.name, Damage.ADDED)
        same = file.stat().st_size == expected.bytes and _entry(file) == expected
        return None if same else DamagedFile(file.name, Damage.CHANGED)


def write_manifest(folder: Path, summary: bytes) -> None:
    """Writes the manifest of a run's files, including the summary, which is written after it."""
    files = {
        name: _entry(folder / name) for name in _names(folder) if name not in (PAGE, "summary.json")
    }
    files["summary.json"] = ManifestEntry(len(summary), hashlib.sha256(summary).hexdigest())
    _write(folder, Manifest(files))


def add_to_manifest(folder: Path, name: str) -> None:
    """Updates the entry of a file of a finished run. Raises RunError as `read_manifest`."""
    files = read_manifest(folder).files
    _write(folder, Manifest({**files, name: _entry(folder / name)}))


def read_manifest(folder: Path) -> Manifest:
    """The manifest of a finished run. Raises RunError: damaged or deleted."""
    file = folder / NAME
    if not file.exists():
        raise damaged("the checksums of a finished run", file, "missing")
    with reading("the checksums of a finished run", file):
        return from_json(Manifest, read_json(read_bytes(file)))


def damaged_files(folder: Path) -> list[DamagedFile]:
    """The damaged files of a finished run. Raises RunError: the manifest is damaged."""
    if not (folder / NAME).exists():
        return [DamagedFile(NAME, Damage.MISSING)]
    manifest = read_manifest(folder)
    names = sorted({*manifest.files, *REQUIRED, *_names(folder)})
    return [damage for name in names if (damage := manifest.damage(folder / name))]


def must_be_as_written(folder: Path, name: str) -> None:
    """Raises RunError if a file of a finished run is damaged, or another one is missing."""
    manifest = read_manifest(folder)
    for other in sorted({name, *REQUIRED, *manifest.files} - RESTORABLE | {name}):
        is_read = other == name or not (folder / other).exists()
        if is_read and (damaged_file := manifest.damage(folder / other)):
            raise refused(folder, damaged_file)


def refused(folder: Path, damage: DamagedFile) -> RunError:
    """The error for a damaged file of a finished run."""
    return damaged("a file of a finished run", folder / damage.name, str(damage.damage))


def _names(folder: Path) -> Iterator[str]:
    """The files of a folder that have an entry in a manifest."""
    check_folder(folder)
    for file in sorted(folder.iterdir()):
        if not file.name.startswith(".") and file.name not in UNLISTED:
            yield file.name


def _entry(file: Path) -> ManifestEntry:
    status = file.stat()
    return _hashed(file, status.st_size, status.st_mtime_ns, status.st_ino)


@lru_cache(maxsize=4096)
def _hashed(file: Path, size: int, changed: int, number: int) -> ManifestEntry:  # noqa: ARG001 -- another file has others
    with opened(file) as stream:
        return ManifestEntry(size, hashlib.file_digest(stream, "sha256").hexdigest())


def _write(folder: Path, manifest: Manifest) -> None:
    write_atomic(folder / NAME, pretty(asdict(manifest)))
