"""Lists a file of a finished run again, after a test has changed it."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

from islandgp.records.files import pretty
from islandgp.records.manifest import NAME, read_manifest


def add_to_manifest(folder: Path, name: str) -> None:
    """The entry of the file in the run's manifest is that of its present content."""
    digest = sha256((folder / name).read_bytes()).hexdigest()
    (folder / NAME).write_bytes(pretty({**read_manifest(folder), name: digest}))
