"""Lists a file of a finished run again, after a test has changed it."""

from __future__ import annotations

from dataclasses import asdict
from hashlib import sha256
from pathlib import Path

from islandgp.records.files import pretty
from islandgp.records.manifest import NAME, Manifest, ManifestEntry, read_manifest


def add_to_manifest(folder: Path, name: str) -> None:
    """The entry of the file in the run's manifest is that of its present content."""
    data = (folder / name).read_bytes()
    entry = ManifestEntry(len(data), sha256(data).hexdigest())
    entries = {**read_manifest(folder), name: entry}
    (folder / NAME).write_bytes(pretty(asdict(Manifest(entries))))
