"""Golden files: results that were checked by a person and must not change by accident.

`GOLDEN=write python -m pytest tests -k golden` writes the files. Read the
difference (`git diff tests/golden`) before you commit it: every user's runs will have it.
"""

from __future__ import annotations

import os
from difflib import unified_diff
from itertools import islice
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent / "golden"


def check_golden(name: str, text: str) -> None:
    """Fails unless `text` equals the golden file; with GOLDEN=write, writes the file."""
    file = FOLDER / name
    if os.environ.get("GOLDEN") == "write":
        file.parent.mkdir(exist_ok=True)
        file.write_text(text, encoding="utf-8")
        pytest.skip(f"wrote {file.name}; read `git diff tests/golden` before you commit it")
    if text == (expected := file.read_text(encoding="utf-8")):
        return
    texts = (expected.splitlines(), text.splitlines())
    lines = unified_diff(*texts, "golden", "found", n=1, lineterm="")
    difference = "\n".join(islice(lines, 30))
    pytest.fail(f"{file.name} differs; GOLDEN=write replaces it:\n{difference}", pytrace=False)
