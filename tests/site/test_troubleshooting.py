"""docs/troubleshooting.md quotes messages that exist."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_each_quoted_message_is_in_the_code() -> None:
    """The text in the first cell of each row that quotes one is in the sources, `...` aside."""
    page = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
    files = [*ROOT.glob("islandgp/**/*.py"), *ROOT.glob("plugins/*/*/*.py")]
    # a message may be split into several strings
    sources = re.sub(r'"\s+f?"', "", "\n".join(p.read_text(encoding="utf-8") for p in files))
    quoted = [
        part.strip()
        for cell in re.findall(r"^\| (`.*?) \| ", page, re.MULTILINE)
        for text in re.findall(r"`([^`]+)`", cell)
        for part in text.split("...")
    ]
    assert len(quoted) > 10
    assert [text for text in quoted if text not in sources] == []
