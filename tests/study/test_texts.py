"""The words of a report."""

from __future__ import annotations

import re
from pathlib import Path

import yaml

from islandgp import study

FOLDER = Path(study.__file__).parent
TEXTS = yaml.safe_load((FOLDER / "texts.yaml").read_text(encoding="utf-8"))


def test_each_text_is_used() -> None:
    """By a note, or a figure of that key; the report's tests find one that is not there."""
    code = "\n".join(file.read_text(encoding="utf-8") for file in FOLDER.rglob("*.py"))
    assert set(re.findall(r'\bnote\("([\w-]+)"', code)) == set(TEXTS["notes"])
    assert [key for key in TEXTS["figures"] if f'"{key}"' not in code] == []
