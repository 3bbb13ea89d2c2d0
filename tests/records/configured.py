"""A user's folder of configuration."""

from __future__ import annotations

from pathlib import Path


def naming(folder: Path, *code: str) -> Path:
    """The folder, with a file that names classes as "module:Class"."""
    (folder / "domain").mkdir(parents=True)
    (folder / "domain/mine.yaml").write_text("".join(f"- {name}\n" for name in code))
    return folder
