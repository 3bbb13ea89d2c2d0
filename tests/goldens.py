"""Golden files: what a result was when somebody last looked at it and found it right.

`GOLDEN=write python -m pytest tests -k golden` writes them anew. Read the
difference (`git diff tests/golden`) before it is kept: it is the change that
every user's runs will see.
"""

from __future__ import annotations

import os
from difflib import unified_diff
from itertools import islice
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent / "golden"


def check_golden(name: str, found: str) -> None:
    """`found` is what the golden file says, to the byte; writes the file where GOLDEN=write."""
    file = FOLDER / name
    if os.environ.get("GOLDEN") == "write":
        file.parent.mkdir(exist_ok=True)
        file.write_text(found, encoding="utf-8")
        pytest.skip(f"wrote {file.name}; read `git diff tests/golden` before it is kept")
    if found == (expected := file.read_text(encoding="utf-8")):
        return
    texts = (expected.splitlines(), found.splitlines())
    lines = unified_diff(*texts, "golden", "found", n=1, lineterm="")
    shown = "\n".join(islice(lines, 30))
    pytest.fail(f"{file.name} differs; GOLDEN=write writes it anew:\n{shown}", pytrace=False)
